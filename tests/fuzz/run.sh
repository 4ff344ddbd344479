#!/bin/sh
# Fuzzes every parser for some seconds (default 60) from the corpus beside this file, two at a time. What it finds it
# leaves in build/fuzz/found; a corpus that it has widened, in build/fuzz/corpus.
set -eu
cd "$(dirname "$0")/../.."
seconds=${1:-60}
cmake -G Ninja -S tests/fuzz -B build/fuzz -DCMAKE_CXX_COMPILER=clang++ > /dev/null
cmake --build build/fuzz
mkdir -p build/fuzz/found
jobs=""
for target in hands serial mesh_files web text; do
    mkdir -p "build/fuzz/corpus/$target"
    build/fuzz/fuzz_$target -max_total_time="$seconds" -max_len=20000 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
        -artifact_prefix="build/fuzz/found/$target-" "build/fuzz/corpus/$target" "tests/fuzz/corpus/$target" \
        > "build/fuzz/$target.log" 2>&1 &
    jobs="$jobs $target:$!"
done
failed=0
for job in $jobs; do
    target=${job%%:*}
    if wait "${job##*:}"; then
        grep -aE "number_of_executed_units|average_exec" "build/fuzz/$target.log" | sed "s/^/$target: /"
    else
        failed=1
        echo "$target: failed" >&2
        tail -30 "build/fuzz/$target.log" >&2
    fi
done
exit $failed
