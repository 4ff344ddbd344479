#!/bin/sh
# Builds the program with address and undefined-behaviour sanitizers, and lets it drive emulated boards through random
# sequences of faults, unplugging included: tests/asan/run.sh [SEQUENCES], 100 by default.
set -eu
cd "$(dirname "$0")/../.."
.ci/install-packages libumockdev-dev umockdev pkgconf
cmake --preset asan -DPALPATE_TESTS=OFF -DCMAKE_CXX_FLAGS_RELWITHDEBINFO="-O1 -g1 -DNDEBUG" > /dev/null
cmake --build --preset asan --target palpate palpate-tetgen
cmake --preset release -DPALPATE_TESTS=ON -DPALPATE_BENCH=OFF > /dev/null
cmake --build --preset release --target usb_test
# umockdev is loaded before the sanitizer's library, which says so; exit code 99 is no other's.
export ASAN_OPTIONS=verify_asan_link_order=0:detect_leaks=0:exitcode=99 UBSAN_OPTIONS=halt_on_error=1:exitcode=99
PALPATE_PROGRAM="$PWD/build/asan/palpate" PALPATE_FAULT_RUNS="${1:-100}" \
    build/release/tests/usb_test --gtest_filter='Usb.AnySequenceOfFaultsStaysSafe:Usb.FaultsLatch*:Usb.AReplug*:Usb.OneBoard*'
