#!/bin/sh
# Random sequences of device faults, unplugging with udev's events included, against everything in devices/ compiled with
# address and undefined-behaviour sanitizers: tests/asan/run.sh [SEQUENCES], 100 by default; half a second each.
set -eu
cd "$(dirname "$0")/../.."
.ci/install-packages libumockdev-dev umockdev pkgconf
[ -e build/release/CMakeCache.txt ] || cmake --preset release -DPALPATE_TESTS=ON -DPALPATE_BENCH=OFF > /dev/null
cmake --build build/release --target fault-sequences
# umockdev is loaded before the sanitizer's library, which says so; exit code 99 is no other's. What USB never gives back
# is left behind on purpose, which looks like a leak.
# Memory that is given back is filled: libusb itself is not sanitized, and is to stumble over what it still uses.
export ASAN_OPTIONS=verify_asan_link_order=0:detect_leaks=0:exitcode=99:max_free_fill_size=65536:free_fill_byte=219 UBSAN_OPTIONS=halt_on_error=1:exitcode=99
build/release/tests/fault-sequences build/release/tests/maestro-emulator build/release/tests/board_probe_sanitized \
    "${1:-100}" "${2:-1}"
