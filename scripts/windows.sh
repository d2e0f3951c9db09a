#!/usr/bin/env bash
# Windows, from Linux: type-checks the program, or builds it, runs it under Wine, and compares what it writes with what the
# Linux program writes, byte for byte.
#
#   scripts/windows.sh --check    type-checks library, program and tests, for macOS the first two; what continuous integration runs
#   scripts/windows.sh --build    builds the release program
#   scripts/windows.sh            builds both release programs and compares; some fifteen minutes on two cores
#   scripts/windows.sh OCT OCT_EXE    compares these two
#   scripts/windows.sh --tests    compiles the integration tests and runs all that tests/windows.txt does not exclude
#
# Needs mingw and, to compare, Wine: installed with apt where they are missing and that can be done. INFOBYTE_DATA names a
# folder of real data for more cases. Wine is no Windows: what passes here was not run there.
set -euo pipefail
cd "$(dirname "$0")/.."
target=x86_64-pc-windows-gnu

needs() {
    command -v "$1" >/dev/null && return
    local as_root=()
    [ "$(id -u)" = 0 ] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${@:2}" >/dev/null
}

if [ $# != 2 ]; then
    if ! { needs x86_64-w64-mingw32-g++ gcc-mingw-w64-x86-64 g++-mingw-w64-x86-64 &&
        { rustup target list --installed | grep -qx $target || rustup target add $target; }; }; then
        echo "windows: skipped: mingw, or the target $target, cannot be installed"
        exit 0
    fi
fi
if [ "${1:-}" = --check ]; then
    cargo check --locked --lib --bins --tests --target $target
    # Types need no compiler of C: what stands for one makes empty files.
    apple=aarch64-apple-darwin
    if rustup target list --installed | grep -qx $apple || rustup target add $apple; then
        none=$(mktemp -d)
        trap 'rm -rf "$none"' EXIT
        printf '#!/bin/sh\nwhile [ $# -gt 0 ]; do [ "$1" = -o ] && : >"$2"; shift; done\n' >"$none/cc"
        printf '#!/bin/sh\nfor file; do case $file in *.a) : >"$file" ;; esac; done\n' >"$none/ar"
        chmod +x "$none"/*
        SDKROOT=/ CC_aarch64_apple_darwin=$none/cc CXX_aarch64_apple_darwin=$none/cc AR_aarch64_apple_darwin=$none/ar \
            cargo check --locked --lib --bins --target $apple
    else
        echo "windows: skipped: macOS, as its target cannot be installed"
    fi
    exit 0
fi
if [ "${1:-}" = --build ]; then
    exec cargo build --locked --release --bin oct --target $target
fi
it=''
if [ $# = 2 ]; then
    oct=$(realpath "$1") exe=$(realpath "$2")
elif [ "${1:-}" = --tests ]; then
    built=$(cargo test --locked --no-run --test it --target $target 2>&1) || { echo "$built" && exit 1; }
    it=$(realpath "$(sed -n 's/.*Executable tests.*(\(.*\))$/\1/p' <<<"$built")")
    exe=$(dirname "$it")/../oct.exe
else
    cargo build --locked --release
    cargo build --locked --release --bin oct --target $target
    folder=$(realpath "${CARGO_TARGET_DIR:-target}")
    oct=$folder/release/oct exe=$folder/$target/release/oct.exe
fi
needs wine wine wine64

work=$(mktemp -d)
export WINEPREFIX=$work/prefix WINEDEBUG=-all
# Its server is that of this prefix alone.
trap 'umount "$work/killed/full" 2>/dev/null || true; wineserver -k 2>/dev/null || true; wineserver -w 2>/dev/null || true; rm -rf "$work"' EXIT
cp "$exe" "$work/oct.exe"
if ! wine "$work/oct.exe" --version >/dev/null 2>&1; then
    # Wine before 9 lacks the library from which the standard library takes random numbers.
    cat >"$work/random.c" <<'RANDOM_NUMBERS'
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE to, SIZE_T bytes) { return SystemFunction036(to, (ULONG)bytes); }
RANDOM_NUMBERS
    x86_64-w64-mingw32-gcc -O1 -shared -o "$work/bcryptprimitives.dll" "$work/random.c" -ladvapi32
fi
wine "$work/oct.exe" --version

if [ "$it" ]; then
    # Of each module what is not excluded, within a time limit.
    cp "$it" "$work/it.exe"
    export OCT_BINARY=$work/oct.exe
    wine "$work/it.exe" --list 2>/dev/null </dev/null | tr -d '\r' | sed -n 's/: test$//p' | sort >"$work/all"
    sed -n 's/^\([a-z_0-9:]*\) .*/\1/p' tests/windows.txt | sort >"$work/excluded"
    if ! diff <(comm -23 "$work/excluded" "$work/all") /dev/null; then
        echo "windows: tests/windows.txt excludes tests that do not exist" && exit 1
    fi
    comm -23 "$work/all" "$work/excluded" >"$work/due"
    for module in $(cut -d: -f1 "$work/due" | uniq); do
        # shellcheck disable=SC2046  # words
        timeout -k 5 "${INFOBYTE_MODULE_S:-900}" wine "$work/it.exe" --exact $(grep "^$module::" "$work/due") </dev/null >"$work/said" 2>&1 || true
        tr -d '\r' <"$work/said" >>"$work/log"
        printf '\r%-70s' "$module, $(grep -c '^test .* ok$' "$work/log") of $(wc -l <"$work/due")" >&2
    done
    echo >&2
    passed() { sed -n 's/^.*test \([a-z_0-9:]*\) \.\.\. ok$/\1/p' "$work/log" | sort -u >"$work/passed"; }
    passed
    # On a busy machine Wine now and then cannot start a process (1359): what failed by that is tried once more, and named.
    for name in $(comm -23 "$work/due" "$work/passed"); do
        # No pipe into `grep -q`: it ends at the first line found, and what writes into it then counts as failed.
        if grep -q 'os error 1359\|code: 1359' <(
            sed -n "/^---- $name stdout/,/^----/p" "$work/log"
            grep -A 3 "thread '$name'" "$work/log"
        ); then
            echo "windows: Wine could not start a process, tried again: $name"
            timeout -k 5 300 wine "$work/it.exe" --exact "$name" </dev/null 2>&1 | tr -d '\r' >>"$work/log" || true
        fi
    done
    passed
    passed=$(wc -l <"$work/passed")
    if ! diff "$work/due" "$work/passed" >"$work/failed"; then
        grep -A 3 "panicked at" "$work/log" || true
        sed -n 's/^< /windows: failed, or not over in time: /p' "$work/failed"
        exit 1
    fi
    [ "$passed" -ge 600 ] || { echo "windows: only $passed tests passed" && exit 1; }
    echo "windows: $passed integration tests passed under Wine, $(wc -l <"$work/excluded") are excluded with reasons"
    exit 0
fi

fixtures=$(realpath fixtures)
data=${INFOBYTE_DATA:-}
mkdir "$work/linux" "$work/wine"
cases=0
# A command on each system, in a folder of its own, and the exit code that is due.
ends_with() {
    local due=$1 on_linux=0 on_wine=0
    shift
    (cd "$work/linux" && "$oct" "$@" >"$work/said.linux" 2>&1) || on_linux=$?
    (cd "$work/wine" && wine "$work/oct.exe" "$@" >"$work/said.wine" 2>&1) || on_wine=$?
    cases=$((cases + 1))
    if [ "$on_linux" != "$due" ] || [ "$on_wine" != "$due" ]; then
        echo "windows: exit code $on_wine, $on_linux on Linux, where $due is due: oct $*"
        tail -n 3 "$work/said.linux" "$work/said.wine"
        exit 1
    fi
}
both() { ends_with 0 "$@"; }

both demo --size 64 -o head.oct --quiet --memory 64MiB
both demo --size 48 --write-raw head.raw
both build head.raw -o raw.oct --dims 48x48x48 --dtype i16 --iso 400 --quiet
both build synthetic:gyroid@48 -o cells.oct --quiet
both build synthetic:gyroid@48 -o leaves.oct --error 0.1 --quiet
both build synthetic:head@64 -o skin.oct --surface skin --channels normal,value --quiet
both build "$fixtures/csg/bracket.csg" -o bracket.oct --grid 64 --quiet
both build synthetic:head@64 -o noisy.oct --uncertainty --memory 48MiB --threads 1 --quiet
for model in cells leaves skin; do
    both pack $model.oct -o $model.packed.oct
    both unpack $model.packed.oct -o $model.unpacked.oct
    both verify $model.packed.oct
    both render $model.oct -o $model.png --size 96 --view iso
    for form in stl ply obj glb 3mf nrrd nii.gz html; do
        both export $model.oct -o $model.$form
    done
done
both build cells.stl -o stl.oct --grid 64 --quiet
both build cells.glb -o glb.oct --grid 64 --quiet
both build cells.3mf -o threemf.oct --grid 64 --quiet
both build skin.nrrd -o nrrd.oct --quiet
both build skin.nii.gz -o nifti.oct --labels all --quiet
both strip skin.oct -o stripped.oct --channels normal --levels 1
both render skin.oct -o shaded.png --size 96 --projection perspective --shading ao --background steelblue
both render cells.oct -o section.png --size 96 --section z=20
both render cells.oct -o turn.gif --size 64 --turntable 4
both thumbnail skin.packed.oct -o thumb.png
both compare cells.oct cells.stl -o deviation.oct --csv deviation.csv
both render deviation.oct -o deviation.png --size 96 --legend
both thickness cells.oct --csv thickness.csv
both pores bracket.oct --csv pores.csv
both plan synthetic:head@64 --parts 2 --out job --iso 400
both part job/plan.json 0
both part job/plan.json 1
both merge job/plan.json -o merged.oct
both build synthetic:gyroid@48 -o 'größe 中.oct' --quiet
# Paths of more than 260 characters.
long=$(printf 'long%.0s' {1..30})
mkdir -p "$work"/{linux,wine}/"$long/$long/$long" "$work"/{linux,wine}/{job,odd}
both build synthetic:gyroid@48 -o "$long/$long/$long/m.oct" --quiet
both verify "$long/$long/$long/m.oct"
# Standard input and output are bytes.
(cd "$work/linux" && "$oct" pack - -o - <cells.oct >piped.oct)
(cd "$work/wine" && wine "$work/oct.exe" pack - -o - <cells.oct >piped.oct)
(cd "$work/wine" && wine "$work/oct.exe" render - -o - --size 400 <cells.oct | head -c 9 >/dev/null)
# A name that is no Unicode.
cp "$work/linux/skin.nrrd" "$work/linux/odd/$(printf 'caf\351').nrrd"
cp "$work/linux/odd"/* "$work/wine/odd"
both batch odd --out job/odd --quiet
cmp "$work"/{linux,wine}/job/odd/*.oct
ends_with 3 verify absent.oct
ends_with 3 build absent.nrrd -o never.oct
ends_with 3 verify "$fixtures/x_cut.oct"
ends_with 2 build synthetic:head@32 -o m.oct --iso x
ends_with 3 build NUL -o never.oct
ends_with 3 verify COM1
if [ -d "$data" ]; then
    while read -r name input arguments; do
        # shellcheck disable=SC2086  # words
        both build "$data/$input" -o "real-$name.oct" --quiet $arguments
    done <<REAL
dicom ct-philips-28
jpeg2000 ct-j2k-2
multiframe multiframe
nifti nifti-iguana
nrrd nrrd-brain
labels labels/liver_spine_seg.nrrd --labels all
gzip labels/totalseg-example.nii.gz --labels all
REAL
fi

# Plans and records of parts name folders and times.
list() { (cd "$work/$1" && find . -type f ! -path './job/*' -print0 | sort -z | xargs -0 sha256sum); }
list linux >"$work/linux.sums"
list wine >"$work/wine.sums"
if ! diff "$work/linux.sums" "$work/wine.sums"; then
    echo "windows: files differ from Linux's"
    exit 1
fi

# Devices, names that the system does not take, and a model that is open elsewhere are no outputs.
at() { (cd "$work/killed" && exec wine "$work/oct.exe" "$@"); }
no_output() {
    local code=0
    at build synthetic:head@96 -o "$@" --quiet --force 2>"$work/said.wine" || code=$?
    if [ "$code" != 5 ] || [ "$(grep -c '^oct: ' "$work/said.wine")" != 1 ]; then
        echo "windows: exit code $code for the output $*, where 5 is due, with one sentence" && exit 1
    fi
}
mkdir -p "$work/killed/full"
# A full disk.
if mount -t tmpfs -o size=64k none "$work/killed/full" 2>/dev/null; then
    no_output full/m.oct
    no_output full/m.oct --scratch .
    no_output m.oct --scratch full
    left=$(find "$work/killed" -type f)
    umount "$work/killed/full"
    [ -z "$left" ] || { echo "windows: a full disk left $left" && exit 1; }
else
    echo "windows: skipped: no disk can be mounted that is full"
fi
for name in con.oct lpt1.oct 'a<b.oct' "$(printf 'a%.0s' {1..300}).oct"; do no_output "$name"; done
at build synthetic:gyroid@48 -o old.oct --quiet
at build synthetic:gyroid@96 -o new.oct --quiet
at view old.oct >"$work/view" 2>&1 &
viewer=$!
for _ in {1..100}; do grep -q http "$work/view" && break || sleep 0.1; done
no_output old.oct
kill -9 $viewer
wait $viewer 2>/dev/null || true

# Two threads keep to the cap, or one is used; a refusal names a cap that works.
for mib in 1 20 21 22 22 23 23 24 24 24; do
    capped() { at build synthetic:head@256 -o capped.oct --quiet --force --threads 2 --memory "$1KiB" --json 2>/dev/null; }
    kib=$((mib << 10)) code=0
    said=$(capped $kib) || code=$?
    if [ $code = 4 ]; then
        kib=$(sed -n 's/.*--memory \([0-9]*\)KiB works.*/\1/p' <<<"$said")
        said=$(capped "$kib")
    fi
    peak=$(sed -n 's/.*"peak_rss_bytes":\([0-9]*\).*/\1/p' <<<"$said")
    if [ "$((peak >> 10))" -gt "$kib" ]; then
        echo "windows: a peak of $((peak >> 10)) KiB above the cap of $kib" && exit 1
    fi
done

# On a console there are bars.
(cd "$work/killed" && timeout 120 script -qec "wine '$work/oct.exe' build synthetic:gyroid@160 -o bars.oct" /dev/null </dev/null) >"$work/console"
grep -q '█.*%' "$work/console" || { echo "windows: no bar on a console" && exit 1; }

# Whenever a build is killed, or ended by Ctrl-C, the old model is there, or the new one.
begun=${EPOCHREALTIME/./}
at build synthetic:gyroid@96 -o killed.oct --quiet
usual=$((${EPOCHREALTIME/./} - begun))
for number in {1..100}; do
    cp "$work/killed/old.oct" "$work/killed/killed.oct"
    at build synthetic:gyroid@96 -o killed.oct --quiet --force 2>/dev/null &
    building=$!
    sleep "$(printf '0.%06d' $((usual * RANDOM / 32768 % 1000000)))"
    kill -$((number % 4 ? 9 : 2)) $building 2>/dev/null || true
    wait $building 2>/dev/null || true
    if ! cmp -s "$work/killed/killed.oct" "$work/killed/old.oct" && ! cmp -s "$work/killed/killed.oct" "$work/killed/new.oct"; then
        echo "windows: a build that was killed left a damaged model" && exit 1
    fi
done
at build synthetic:gyroid@96 -o killed.oct --quiet --force
cmp "$work/killed/killed.oct" "$work/killed/new.oct"
if [ "$(find "$work/killed" -name '.oct-*' | wc -l)" -gt 5 ]; then
    echo "windows: what killed builds left is not removed by the next one" && exit 1
fi

echo "windows: $cases commands under Wine, $(wc -l <"$work/linux.sums") files equal to Linux's"
