#pragma once
// Hands over a WebSocket: the JSON of udp_hand.h, for pages (WebXR, MediaPipe) and programs that speak no UDP.

#include "scenes/trackers/hand_source.h"

namespace palpate {

/// Listens at ws://127.0.0.1:PORT/hand to this machine, and pages served by it, alone; with `any_address` also to
/// others that give the token (/hand?token=...), which about() tells. Port 0: any free one. Messages of more than 64 kB
/// end their connection. Throws InputError where it cannot listen.
std::unique_ptr<HandSourceThread> receive_websocket_hands(HandMailbox& mailbox, int port, bool any_address);

}  // namespace palpate
