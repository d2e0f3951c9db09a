#!/usr/bin/env bash
# Every test that tries random rays, volumes, bodies or bytes, with more of them than a test run takes, and pages as they
# are seen; last the program for Windows.
# usage: scripts/long.sh [TIMES]     as many times as much as usual; 20 by default, some 20 minutes on 2 cores, and
#                             some hours where there is a chromium
set -euo pipefail
cd "$(dirname "$0")/.."

times=${1:-20}
[[ $times =~ ^[1-9][0-9]*$ ]] || { echo "'$times' is not a number of times; give 1 or more" >&2; exit 2; }
export INFOBYTE_LONG=$times
tests=(hard_cases oracle traversal visible light_leaks mesh_containers mesh_foreign volumes export larger_leaves parts batch page
    damage label_maps memory picture_memory build_same_bytes cleaning mutations)
# Mutations fill disks and kill the command, and are in the program of processes.
program_of() { [ "$1" = mutations ] && echo process || echo it; }

bar() {
    local done=$1 all=$2 width=30
    local full=$((done * width / all))
    printf '\r[%s%s] %d/%d %-20s' "$(printf '%*s' "$full" '' | tr ' ' '#')" \
        "$(printf '%*s' $((width - full)) '' | tr ' ' '.')" "$done" "$all" "${3:-}" >&2
}

log=$(mktemp)
trap 'rm -f "$log"' EXIT
bar 0 ${#tests[@]} building
cargo test --locked --release --no-run --test it --test process >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
start=$SECONDS
for i in "${!tests[@]}"; do
    bar "$i" ${#tests[@]} "${tests[$i]}"
    cargo test --locked --release --test "$(program_of "${tests[$i]}")" "${tests[$i]}::" >"$log" 2>&1 || { echo >&2; cat "$log" >&2; exit 1; }
    ! grep -q 'ok. 0 passed' "$log" || { echo >&2; echo "no test is called ${tests[$i]}" >&2; exit 1; }
done
bar ${#tests[@]} ${#tests[@]} ""
printf '\nall of %s passed, %d times as much as usual, in %d s\n' "${tests[*]}" "$times" $((SECONDS - start))

# What the program for Windows writes is what this one writes, and it passes the tests.
scripts/windows.sh
scripts/windows.sh --tests
