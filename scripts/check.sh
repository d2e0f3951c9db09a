#!/usr/bin/env bash
# The one command before a merge: format, lints, documentation, tests, and a build under its memory cap.
# usage: scripts/check.sh [--without-tests]
set -euo pipefail
cd "$(dirname "$0")/.."

tests=yes
[ "${1:-}" = "--without-tests" ] && tests=no

step() {
    printf '\n== %s\n' "$1"
    shift
    local start=$SECONDS
    "$@"
    printf -- '-- %d s\n' $((SECONDS - start))
}

step "format" cargo fmt --all -- --check
step "lints, warnings are errors" cargo clippy --locked --all-targets -- -D warnings
step "documentation, warnings are errors" env RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items
if [ "$tests" = yes ]; then
    step "tests" cargo test --locked
fi
step "release build" cargo build --locked --release
step "memory cap: the synthetic head, 512 cubed, in 8 MiB" \
    python3 scripts/memory.py --demo 512 --only-demo --no-refusals --budgets 8MiB --threads 1,2
step "memory cap: raw volumes of every kind, 8 and 16 MiB" \
    python3 scripts/memory.py --side 128 --wide 1024 --no-refusals --budgets 8MiB,16MiB --threads 1,2
printf '\nall checks passed in %d s\n' "$SECONDS"
