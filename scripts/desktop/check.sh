#!/usr/bin/env bash
# Installs the thumbnailer into a folder of its own and lets a real thumbnail service (tumbler) make pictures of a
# model, of a packed one and of a damaged one. Needs the packages tumbler, dbus, libglib2.0-bin and shared-mime-info.
#
#   scripts/desktop/check.sh [PROGRAM]     target/release/oct by default
set -euo pipefail
cd "$(dirname "$0")/../.."
oct=$(realpath "${1:-target/release/oct}")
for tool in gdbus gio dbus-run-session update-mime-database; do
    command -v "$tool" >/dev/null || { echo "$tool is missing" >&2; exit 2; }
done
home=$(mktemp -d)
trap 'rm -rf "$home"' EXIT
export HOME=$home XDG_DATA_HOME=$home/share XDG_CACHE_HOME=$home/cache
OCT=$oct scripts/desktop/install.sh >/dev/null

"$oct" build synthetic:torus@64 -o "$home/torus.oct" --quiet
"$oct" pack "$home/torus.oct" -o "$home/packed.oct" >/dev/null
head -c 3000 "$home/torus.oct" >"$home/broken.oct"
cp "$home/torus.oct" "$home/without a suffix"

cat >"$home/ask.sh" <<'ASK'
set -euo pipefail
for flavor in normal large x-large xx-large; do
    uris='' types=''
    for file in torus.oct packed.oct broken.oct 'without a suffix'; do
        uris+=${uris:+, }"'file://$HOME/${file// /%20}'"
        types+=${types:+, }"'$(gio info -a standard::content-type "$HOME/$file" | sed -n 's/.*content-type: //p')'"
    done
    gdbus call --session --dest org.freedesktop.thumbnails.Thumbnailer1 \
        --object-path /org/freedesktop/thumbnails/Thumbnailer1 \
        --method org.freedesktop.thumbnails.Thumbnailer1.Queue "[$uris]" "[$types]" "$flavor" default 0 >/dev/null
    # A new request of a kind takes the place of the one before.
    sleep 5
done
ASK
dbus-run-session -- bash "$home/ask.sh" 2>"$home/log" || { cat "$home/log" >&2; exit 1; }

status=0
made() {
    local sum
    sum=$(printf 'file://%s' "$home/${1// /%20}" | md5sum | cut -d ' ' -f 1)
    find "$XDG_CACHE_HOME/thumbnails" -name "$sum.png" -not -path '*/fail/*' 2>/dev/null | sort || true
}
for file in torus.oct packed.oct 'without a suffix'; do
    found=$(made "$file")
    echo "$file: $(wc -w <<<"$found") pictures"
    while read -r picture; do
        [ -z "$picture" ] || python3 - "$picture" <<'SIZE'
import struct, sys
with open(sys.argv[1], "rb") as file:
    print("  ", sys.argv[1].split("/")[-2], struct.unpack(">II", file.read(24)[16:]))
SIZE
    done <<<"$found"
    [ -n "$found" ] || status=1
done
if [ -n "$(made broken.oct)" ]; then
    echo "broken.oct: a picture of a damaged model"
    status=1
else
    echo "broken.oct: no picture, as it should be"
fi
exit $status
