#pragma once
// Hands over UDP: one JSON object per datagram, for scripts, gloves and other trackers.

#include "scenes/trackers/hand_source.h"

namespace palpate {

/// Takes datagrams as take_joints expects them, on a thread of its own; from this machine alone unless `any_address`.
/// Port 0: any free one. Throws InputError where it cannot listen.
std::unique_ptr<HandSourceThread> receive_udp_hands(HandMailbox& mailbox, int port, bool any_address);

}  // namespace palpate
