#!/usr/bin/env bash
# Rays from outside against heads built with --visible-from outside: none may meet anything else than before.
# usage: scripts/visible.sh [MILLIONS]     of rays; 10 by default, some minutes on 2 cores
set -euo pipefail
cd "$(dirname "$0")/.."

millions=${1:-10}
[[ $millions =~ ^[1-9][0-9]*$ ]] || { echo "'$millions' is not a number of millions; give 1 or more" >&2; exit 2; }
# 20,000 rays each time: 5,000 for each of two heads and two surfaces (10,000 without the real head).
export INFOBYTE_HARD=$((millions * 50))

log=$(mktemp)
trap 'rm -f "$log"' EXIT
printf 'building\r' >&2
cargo test --locked --release --no-run --test it >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
cargo test --locked --release --test it visible::heads_lose -- --nocapture >"$log" 2>&1 &
job=$!
start=$SECONDS
while kill -0 "$job" 2>/dev/null; do
    done=$(grep -c 'hidden' "$log" || true)
    printf '\r[%-20s] %d of 4 models, %d s' "$(printf '%*s' $((done * 5)) '' | tr ' ' '#')" "$done" $((SECONDS - start)) >&2
    sleep 1
done
echo >&2
wait "$job" || { cat "$log" >&2; exit 1; }
grep 'hidden' "$log"
printf '%d million rays from outside: all meet what they met before, %d s\n' "$millions" $((SECONDS - start))
