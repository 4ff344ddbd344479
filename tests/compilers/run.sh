#!/bin/sh
# Builds the program with clang++ and replays with it what the release build (g++) records: the same bits, or where they
# differ first.
set -eu
cd "$(dirname "$0")/../.."
command -v clang++ >/dev/null || { echo "clang++ is not installed (apt install clang)" >&2; exit 1; }
cmake --preset release >/dev/null
cmake --build --preset release --target palpate
cmake -S . -B build/clang -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=clang++ -DPALPATE_TESTS=OFF >/dev/null
cmake --build build/clang --target palpate
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for scene in press edge ball soft_ball roll hand pinch egg pen hold_ball hold_mug two_hands; do
    for detail in full auto; do
        build/release/palpate run "scenes/$scene.toml" --quiet --out "$folder/out" --set "solver.level_of_detail=$detail" \
            --record "$folder/$scene.palpate"
        printf '%s, detail %s: ' "$scene" "$detail"
        build/clang/palpate replay "$folder/$scene.palpate"
    done
done
