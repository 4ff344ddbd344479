#!/bin/sh
# What a mesh costs and what it loses: the index finger presses (at 0, 15, 30 degrees), rolls, presses on an edge, on a ball.
# usage: bench/mesh_error.sh [PALPATE] [ELEMENTS] [KEY=VALUE ...], such as: PALPATE 347,1400 finger.index.bone.cut=0.06
# One row per scene and mesh: errors in % of the net force, of the force field on a grid of 3 mm and of the area, mean over
# the steps in contact, against twice the finest mesh of the list (4,000 and more) with the same settings; the median of a step; and what
# that reference is itself uncertain by. SCENES names fewer. Results stand in OUT (default: results/mesh_error); each call runs all anew.
set -e
root=$(cd "$(dirname "$0")/.." && pwd)
palpate=$(realpath "${1:-$root/build/release/palpate}")
elements=${2:-347,700,1400,2800}
[ $# -gt 2 ] && shift 2 || shift $#
name=$(printf '%s' "$elements $*" | tr -c 'A-Za-z0-9.=' '_')
out=${OUT:-results/mesh_error}/$name
rm -rf "$out"  # a sweep would go on from rows of another build
mkdir -p "$out"
settings=""
for s in "$@"; do settings="$settings --set $s"; done
for a in 0 15 30; do
    cat > "$out/press-$a.toml" <<EOF
duration_s = 0.6
dt_ms = 5
[limits]
low = 0.6
high = 1.4
[[object]]
name = "table"
kind = "plane"
[[finger]]
name = "index"
shape = { finger = "index" }
track = [
    { t_s = 0.0, position_mm = [0, 0, 9.5], rotation_deg = [0, $a, 0] },
    { t_s = 0.1, position_mm = [0, 0, 9.0], rotation_deg = [0, $a, 0] },
    { t_s = 0.4, position_mm = [0, 0, 6.2], rotation_deg = [0, $a, 0] },
]
EOF
done
echo "settings: ${*:-as in the scenes}"
printf '%-9s %9s %8s %8s %8s %9s   %s\n' scene elements 'net %' 'field %' 'area %' 'step us' 'uncertain: net %, field %'
for scene in ${SCENES:-press-0 press-15 press-30 roll edge ball}; do
    file=$out/$scene.toml
    [ -f "$file" ] || file=$root/scenes/$scene.toml
    # shellcheck disable=SC2086
    "$palpate" sweep "$file" --axes "finger.*.elements=$elements" $settings --out "$out/$scene" --threads 1 \
        > "$out/$scene.txt" 2> "$out/$scene.log" || { cat "$out/$scene.log" >&2; exit 1; }
    sure=$(sed -n \
        's/.*uncertainty is \([^ ]*\) % of the field, \([^ ]*\) % of the net force/\2, \1/p' "$out/$scene.txt")
    awk -F, -v scene=$scene -v sure="$sure" '/,mesh,/ {
        printf "%-9s %9s %8.1f %8.1f %8.1f %9.0f   %s\n", scene, $1, 100 * $4, 100 * $3, 100 * $5, $8, sure }' \
        "$out/$scene/sweep.csv"
done
