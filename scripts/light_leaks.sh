#!/usr/bin/env bash
# Rays from outside to points inside of bodies at many orientations and of noise, for either surface: none may pass.
# usage: scripts/light_leaks.sh [RAYS [ORIENTATIONS]]     10,000,000 and 1,000 by default, some 5 minutes on 2 cores
set -euo pipefail
cd "$(dirname "$0")/.."

rays=${1:-10000000} turns=${2:-1000} parts=20
[[ $rays =~ ^[1-9][0-9]*$ && $turns =~ ^[1-9][0-9]*$ ]] || { echo "give a number of rays and one of orientations" >&2; exit 2; }

log=$(mktemp)
trap 'rm -f "$log"' EXIT
echo building >&2
cargo test --locked --no-run --test it >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
export INFOBYTE_LEAK_RAYS=$(((rays + parts - 1) / parts)) INFOBYTE_LEAK_TURNS=$(((turns + parts - 1) / parts))
start=$SECONDS
for ((i = 1; i <= parts; i++)); do
    INFOBYTE_LEAK_SEED=$i cargo test --locked --test it light_leaks:: >"$log" 2>&1 || { echo >&2; cat "$log" >&2; exit 1; }
    printf '\r[%s%s] %d/%d %d s' "$(printf '%*s' $((30 * i / parts)) '' | tr ' ' '#')" \
        "$(printf '%*s' $((30 - 30 * i / parts)) '' | tr ' ' '.')" "$i" "$parts" $((SECONDS - start)) >&2
done
printf '\n0 of %d rays pass for either surface, at %d orientations, in %d s\n' \
    $((INFOBYTE_LEAK_RAYS * parts)) $((INFOBYTE_LEAK_TURNS * parts)) $((SECONDS - start))
