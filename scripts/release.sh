#!/usr/bin/env bash
# Makes a release in dist/: archives of the program for Linux and Windows, a portable wheel, and their checksums.
#
#   scripts/release.sh           compiles all three; some twenty minutes on two cores
#   scripts/release.sh --quick   a test: the archive alone, of the program that INFOBYTE_OCT names, in a folder that is
#                                removed; and what a package of the crate would hold
set -euo pipefail
cd "$(dirname "$0")/.."

quick=no
case ${1:-} in
    '') ;;
    --quick) quick=yes ;;
    *) echo "usage: release.sh [--quick]" >&2; exit 2 ;;
esac
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
max_bytes=10000000

if [ $quick = yes ]; then
    oct=${INFOBYTE_OCT:?names the program} out=$work
else
    cargo build --locked --release
    oct=${CARGO_TARGET_DIR:-target}/release/oct out=dist
    mkdir -p dist
fi

name=infobyte-$("$oct" --version | sed 's/.* //')-$(uname -m)-linux
folder=$work/$name
mkdir -p "$folder/completions"
cp "$oct" LICENSE-APACHE LICENSE-MIT README.md CHANGELOG.md "$folder"
[ $quick = yes ] || strip "$folder/oct"
for shell in bash zsh fish; do
    "$oct" completions $shell >"$folder/completions/oct.$shell"
done
"$oct" man "$folder/man" >/dev/null
cp -r scripts/desktop "$folder"
rm "$folder/desktop/check.sh"
# The same archive from the same files: without the names, times and order of this machine.
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct 2>/dev/null || echo 0)" \
    -C "$work" -c "$name" | gzip -9n >"$out/$name.tar.gz"

# The program for Windows needs no other file; its licences, completions and manual are those of Linux.
archives=("$name.tar.gz")
if [ $quick = no ]; then
    scripts/windows.sh --build
    windows=${name%-linux}-windows
    mkdir "$work/$windows"
    cp -r "$folder"/{LICENSE-APACHE,LICENSE-MIT,README.md,CHANGELOG.md} "$work/$windows"
    cp "${CARGO_TARGET_DIR:-target}/x86_64-pc-windows-gnu/release/oct.exe" "$work/$windows"
    # Windows has no library of the compiler's.
    if x86_64-w64-mingw32-objdump -p "$work/$windows/oct.exe" | grep 'DLL Name: .*\(lib\|pthread\)'; then
        echo "release: oct.exe needs libraries of mingw" >&2
        exit 1
    fi
    "$oct" completions powershell >"$work/$windows/oct.ps1"
    rm -f "dist/$windows.zip"
    (cd "$work" && python3 -m zipfile -c "$OLDPWD/dist/$windows.zip" "$windows")
    archives+=("$windows.zip")
fi

# As a user unpacks it.
mkdir "$work/unpacked"
tar -C "$work/unpacked" -xf "$out/$name.tar.gz"
unpacked=$work/unpacked/$name
"$unpacked/oct" build synthetic:sphere@24 -o "$work/ball.oct" --quiet
"$unpacked/oct" verify "$work/ball.oct" >/dev/null
for file in completions/oct.bash man/oct.1 man/oct-build.1 desktop/install.sh LICENSE-MIT; do
    [ -s "$unpacked/$file" ] || { echo "release: $file is missing or empty" >&2; exit 1; }
done

if [ $quick = yes ]; then
    cargo package --locked --offline --allow-dirty --list >"$work/package"
    for file in src/lib.rs bin/oct.rs src/format/SPEC.md LICENSE-APACHE; do
        grep -qx "$file" "$work/package" || { echo "release: the package has no $file" >&2; exit 1; }
    done
    echo "release: the archive is complete ($(find "$unpacked" -type f | wc -l) files), the package holds $(wc -l <"$work/package")"
    exit 0
fi

scripts/wheel.sh --portable
(
    cd dist
    rm -f SHA256SUMS
    sha256sum -- "${archives[@]}" *manylinux*.whl >SHA256SUMS
    cat SHA256SUMS
    for file in "${archives[@]}" *manylinux*.whl; do
        bytes=$(stat -c %s "$file")
        echo "release: $file, $bytes bytes"
        [ "$bytes" -le $max_bytes ] || { echo "release: $file is larger than $max_bytes bytes" >&2; exit 1; }
    done
)
