#!/bin/sh
# Installs what is missing, builds the program and its tests, and passes them; further arguments go to ctest.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/.."
.ci/install-packages libumockdev-dev umockdev pkgconf python3 python3-numpy
wide=ON
grep -q avx512dq /proc/cpuinfo || wide=OFF  # nothing here would run these kernels
cmake --preset release -DPALPATE_TESTS=ON -DPALPATE_BENCH=OFF -DPALPATE_AVX512=$wide
cmake --build --preset release
ctest --preset release -j"$(($(nproc) + 3))" "$@"  # a third of them mostly wait
