#!/usr/bin/env bash
# Builds the wheel of the Python package, and tests it in a fresh virtual environment.
#
#   scripts/wheel.sh             a wheel for this machine's C library
#   scripts/wheel.sh --portable  a wheel for Linux of 2018 and newer (manylinux_2_28), linked by the zig of the index
#   PYTHON=python3.12 EXTRAS="trimesh nibabel" scripts/wheel.sh
#   MATURIN_ARGUMENTS="--profile dev" INFOBYTE_OCT=target/debug/oct scripts/wheel.sh
#                                for tests only: reuses the libraries that `cargo build` compiled
#
# What is skipped is said by name. Without a package index nothing is built, and nothing fails.
set -euo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "wheel: skipped: Python 3.11 or newer is missing"
    exit 0
fi
if ! "$python" -m venv "$work/venv" >/dev/null 2>&1; then
    echo "wheel: skipped: $python has no venv with pip"
    exit 0
fi
bin=$work/venv/bin
wanted=("maturin>=1.9,<2" numpy pytest zopfli)
[ "${1:-}" != --portable ] || wanted+=(ziglang)
if ! "$bin/pip" install --quiet --disable-pip-version-check --retries 1 --timeout 20 "${wanted[@]}" >"$work/pip.log" 2>&1; then
    echo "wheel: skipped: no package index can be reached for ${wanted[*]}"
    tail -n 2 "$work/pip.log"
    exit 0
fi
export PATH=$bin:$PATH

mkdir -p dist
if [ "${1:-}" = --portable ]; then
    triple=$(rustc -vV | sed -n 's/^host: //p')
    # `oct` is linked against the same old C library as the module.
    # Without the target as Rust names it, which zig cannot read.
    for language in cc c++; do
        cat >"$work/zig$language" <<ZIG
#!/bin/sh
for word do
    shift
    case \$word in --target=*) ;; *) set -- "\$@" "\$word" ;; esac
done
exec "$bin/python" -m ziglang $language -target x86_64-linux-gnu.2.28 "\$@"
ZIG
        chmod +x "$work/zig$language"
    done
    # Small: LLVM inlines less unless it is told to; zstd has no compressors of other levels than ours, and one decoder.
    export RUSTFLAGS="${RUSTFLAGS:-} -C llvm-args=--inline-threshold=90"
    CFLAGS="${CFLAGS:-} -DDYNAMIC_BMI2=0 -DZSTD_FORCE_DECOMPRESS_SEQUENCES_SHORT"
    for strategy in DFAST GREEDY LAZY BTOPT BTULTRA; do
        CFLAGS="$CFLAGS -DZSTD_EXCLUDE_${strategy}_BLOCK_COMPRESSOR"
    done
    export CFLAGS
    CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_LINKER=$work/zigcc CC_x86_64_unknown_linux_gnu=$work/zigcc \
        CXX_x86_64_unknown_linux_gnu=$work/zigc++ \
        "$bin/python" src/python/backend.py --target "$triple"
    "$bin/maturin" build --quiet --zig --compatibility manylinux_2_28 --target "$triple" --out dist
else
    "$bin/python" src/python/backend.py
    # shellcheck disable=SC2086  # words
    "$bin/maturin" build --quiet --out dist ${MATURIN_ARGUMENTS:-} 2>&1 | tee "$work/build.log"
    # Nowhere else is the library compiled without the command.
    if grep -q '^warning' "$work/build.log"; then
        echo "wheel: the compiler warns" >&2
        exit 1
    fi
fi
wheel=$(ls -t dist/*.whl | head -n 1)
# What is given is for a test.
[ -n "${INFOBYTE_OCT:-}" ] || "$bin/python" src/python/backend.py --squeeze "$wheel"
echo "wheel: $wheel, $(stat -c %s "$wheel") bytes"

"$bin/pip" install --quiet --disable-pip-version-check "$wheel"
for extra in ${EXTRAS:-}; do
    "$bin/pip" install --quiet --disable-pip-version-check "$extra" || echo "wheel: without $extra, which cannot be installed"
done
"$bin/python" -m pytest -rs -p no:cacheprovider
"$bin/oct" --version
