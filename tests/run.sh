#!/bin/sh
# Installs what is missing, builds everything and runs the tests.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/.."
.ci/install-packages libumockdev-dev pkgconf
cmake --preset release -DPALPATE_TESTS=ON -DPALPATE_BENCH=ON
cmake --build --preset release
ctest --preset release -j2 "$@"
