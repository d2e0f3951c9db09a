#!/usr/bin/env bash
# Random rays through the fast traversal and through the exact reference, 10^8 by default; any difference
# is a failure. A longer run than the tests make: minutes, not seconds.
# usage: scripts/selfcheck.sh [MODEL.oct]     without a model: the synthetic head, 256 cubed
#        RAYS=1000000 SEED=7 scripts/selfcheck.sh     fewer rays, another sequence
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
rays=${RAYS:-100000000}
seed=${SEED:-1}

(cd "$top" && cargo build --locked --release)
oct=${CARGO_TARGET_DIR:-$top/target}/release/oct

model=${1:-}
if [ -z "$model" ]; then
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    model=$folder/head.oct
    "$oct" demo --size 256 -o "$model" --quiet
fi
echo "$model: $rays rays from seed $seed"
time "$oct" selfcheck "$model" --rays "$rays" --seed "$seed"
