#!/bin/sh
# Presses a tetrahedral mesh (TetGen .node/.ele, Gmsh .msh, VTU; finger frame) on a plane, and compares displacements and
# forces with CalculiX: at small strain, and at large strain with both materials, with and without its own contact.
#   sh tests/judge.sh MESH [UNIT]        unit of length of the file, mm if not given
set -eu
[ $# -ge 1 ] || { echo "usage: sh tests/judge.sh MESH [UNIT]" >&2; exit 2; }
[ -r "$1" ] || { echo "cannot read $1" >&2; exit 2; }
command -v ccx >/dev/null || { echo "CalculiX is not installed: apt install calculix-ccx" >&2; exit 2; }
program="$(dirname "$0")/../build/release/tests/engine_test"
[ -x "$program" ] || { echo "$program is not built: sh tests/run.sh" >&2; exit 2; }
PALPATE_JUDGE_MESH="$1" PALPATE_JUDGE_UNIT="${2:-mm}" "$program" --gtest_brief=1 --gtest_filter=CalculiX.AgreesOnAGivenMesh
