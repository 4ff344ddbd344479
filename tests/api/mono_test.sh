#!/bin/sh
# Compiles the C# package with mcs, its components against a stub of Unity, and runs a scene with it under mono beside a recording by the program: the same bits.
# mono_test.sh PROGRAM ROOT. Exits with 77 where mono is not installed (apt install mono-mcs mono-runtime).
set -eu
command -v mcs >/dev/null && command -v mono >/dev/null || exit 77
program=$1 root=$2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/small.toml" <<TOML
duration_s = 0.1
dt_ms = 1
[[object]]
kind = "plane"
[[finger]]
name = "index"
elements = 120
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [0, 0, 10] }, { t_s = 0.05, position_mm = [0, 0, 6] } ]
TOML
"$program" run "$folder/small.toml" --quiet --record "$folder/run.palpate" --out "$folder/out"
mcs -langversion:6 -warnaserror+ -out:"$folder/Bits.exe" "$root"/scenes/api/unity/Runtime/*.cs "$root/tests/api/Bits.cs" \
    "$root/tests/api/UnityStub.cs"
LD_LIBRARY_PATH=$(dirname "$program") mono "$folder/Bits.exe" "$folder/small.toml" "$folder/run.palpate" "$root/tests/api/abi.txt"
