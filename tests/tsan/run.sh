#!/bin/sh
# The tests of step and device loop under ThreadSanitizer, with a oneTBB that is built with it, too: without, every task
# that changes threads looks like a race. First a planted race must be found, or the whole run would prove nothing.
# Takes the sources of Debian's own oneTBB (about 2 MB) by apt-get; a quarter of an hour on two cores.
set -eu
cd "$(dirname "$0")/../.."
folder=$PWD/build/tsan-tbb
if [ ! -e "$folder/lib/libtbb.so" ]; then
    mkdir -p "$folder/apt/lists/partial" "$folder/source"
    echo "deb-src http://deb.debian.org/debian bookworm main" > "$folder/apt/sources.list"
    apt="apt-get -qq -o Dir::Etc::sourcelist=$folder/apt/sources.list -o Dir::Etc::sourceparts=/dev/null
         -o Dir::State::Lists=$folder/apt/lists"
    (cd "$folder/source" && $apt update && $apt source --download-only onetbb && tar xf onetbb_*.orig.tar.xz --strip-components=1)
    cmake -G Ninja -S "$folder/source" -B "$folder/build" -DCMAKE_BUILD_TYPE=RelWithDebInfo -DTBB_TEST=OFF \
        -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF -DCMAKE_CXX_FLAGS="-fsanitize=thread" -DCMAKE_INSTALL_PREFIX="$folder" \
        -DCMAKE_INSTALL_LIBDIR=lib
    cmake --build "$folder/build"
    cmake --install "$folder/build" > /dev/null
fi
cmake --preset tsan -DTBB_DIR="$folder/lib/cmake/TBB"
cmake --build --preset tsan --target planted_race step_test devices_test scenes_test
export TSAN_OPTIONS="halt_on_error=0 exitcode=66"
code=0
build/tsan/tests/planted_race > "$folder/planted.log" 2>&1 || code=$?
if [ "$code" != 66 ] || ! grep -q "data race" "$folder/planted.log"; then
    echo "ThreadSanitizer did not find the planted race (exit code $code): what follows would prove nothing" >&2
    exit 1
fi
echo "the planted race was found"
build/tsan/tests/step_test
build/tsan/tests/devices_test --gtest_filter='*Loop*:Mailbox*:Board*:DeviceThreads*:*SerialBuses*'
build/tsan/tests/scenes_test --gtest_filter='Ultraleap*:UdpHand*:WebsocketHand*:HandMailbox*:ViewServer*'
