#!/usr/bin/env bash
# The one command before a merge: format, lints, documentation, tests, and a build under its memory cap.
# usage: scripts/check.sh [text|tests|program]     one of its parts, all by default
set -euo pipefail
cd "$(dirname "$0")/.."

part=${1:-all}
case $part in
    all | text | tests | program) ;;
    *) echo "'$part' is no part; give text, tests or program, or nothing for all" >&2; exit 2 ;;
esac
has() { [ "$part" = "$1" ] || [ "$part" = all ]; }

step() {
    printf '\n== %s\n' "$1"
    shift
    local start=$SECONDS
    "$@"
    printf -- '-- %d s\n' $((SECONDS - start))
}

# The reader in Python knows only the specification; both have to tell the same of a model built here.
second_reader() {
    local folder
    folder=$(mktemp -d)
    "$oct" demo --size 128 --memory "$cap" -o "$folder/head.oct" --quiet
    "$oct" info "$folder/head.oct" --json > "$folder/info.json"
    python3 scripts/read_oct.py "$folder/head.oct" > "$folder/read.json"
    "$oct" selfcheck "$folder/head.oct" --rays 1000000
    python3 - "$folder" <<'COMPARE'
import json, sys
info, read = (json.load(open(f"{sys.argv[1]}/{name}.json")) for name in ("info", "read"))
keys = ["checksum", "skin_voxels", "nodes", "bytes", "dims", "level_nodes", "affine", "range", "channels", "dtype"]
wrong = [f"{k}: {info.get(k)} and {read.get(k)}" for k in keys if info.get(k) != read.get(k)]
print("\n".join(wrong) or f"both readers agree in {', '.join(keys)}")
sys.exit(bool(wrong))
COMPARE
    # Of packed models it decodes infobytes, normals and offsets, and holds them to their checksums.
    local surface
    for surface in skin cells; do
        "$oct" build synthetic:head@60 --surface "$surface" -o "$folder/$surface.oct" --quiet
        "$oct" pack "$folder/$surface.oct" -o "$folder/packed.oct" > "$folder/text"
        python3 scripts/read_oct.py "$folder/packed.oct" > "$folder/read.json"
    done
    rm -r "$folder"
}

if has text; then
    step "format" cargo fmt --all -- --check
    # With the Python module, which `.ci/run` compiles alone, too, with warnings as errors.
    step "lints, warnings are errors" cargo clippy --locked --all-targets --features python -- -D warnings
    step "documentation, warnings are errors" env RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items
    step "public items, as docs/PUBLIC.txt lists them" python3 scripts/public_items.py --check
fi
if has tests; then
    step "tests" cargo test --locked
fi
if has program; then
    # The tests' own program, if that is what INFOBYTE_OCT names, is larger than the one that is released.
    oct=${INFOBYTE_OCT:-} cap=10MiB
    if [ -z "$oct" ]; then
        step "release build" cargo build --locked --release
        oct=${CARGO_TARGET_DIR:-target}/release/oct cap=8MiB
    fi
    step "a second reader of the format, and random rays against the exact reference" second_reader

    # Where control groups can be made (root), the kernel itself ends a build that takes more than cap + 1 MiB.
    kernel=()
    if python3 scripts/memory.py --oct "$oct" --side 32 --wide 0 --dtypes u8 --budgets 16MiB --cgroup >/dev/null 2>&1; then
        kernel=(--cgroup)
    else
        echo "no control group can be made here: peaks are measured, not enforced"
    fi
    step "release: the archive is complete" env INFOBYTE_OCT="$oct" scripts/release.sh --quick
    step "memory cap: the synthetic head, 512 cubed, in $cap" \
        python3 scripts/memory.py --oct "$oct" "${kernel[@]}" --demo 512 --only-demo --no-refusals --budgets "$cap" --threads 1,2
    step "memory cap: raw volumes of every kind, $cap and 16 MiB" \
        python3 scripts/memory.py --oct "$oct" "${kernel[@]}" --side 128 --wide 1024 --no-refusals --budgets "$cap,16MiB" --threads 1,2
fi
printf '\nchecks passed in %d s\n' "$SECONDS"
