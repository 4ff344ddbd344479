#!/bin/sh
# Installs what is missing, builds palpate and runs the main job: five fingers, a table, a ball, five thimbles.
# Further arguments go to `palpate run`; a first argument that is a scene file replaces the scene.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/.."
.ci/install-packages
cmake --preset release -DPALPATE_TESTS=OFF -DPALPATE_BENCH=OFF >/dev/null
cmake --build --preset release --target palpate palpate-tetgen
scene=scenes/hand.toml
case "${1:-}" in *.toml) scene=$1; shift ;; esac
exec build/release/palpate run "$scene" "$@"
