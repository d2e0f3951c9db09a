#!/usr/bin/env bash
# Thumbnails of models in file managers that follow freedesktop.org: installs the MIME type and the thumbnailer.
#
#   scripts/desktop/install.sh                    for this user, with the `oct` on the path
#   scripts/desktop/install.sh --prefix /usr      for all users: copies `oct` to /usr/bin, too (GNOME runs thumbnailers
#                                                 in a sandbox that sees /usr only)
#   scripts/desktop/install.sh --remove [--prefix DIR]
#
# OCT names another program than the one on the path.
set -euo pipefail
cd "$(dirname "$0")"

prefix='' remove=no
while [ $# -gt 0 ]; do
    case $1 in
        --prefix) prefix=${2:?--prefix needs a folder}; shift ;;
        --remove) remove=yes ;;
        *) echo "usage: install.sh [--prefix DIR] [--remove]" >&2; exit 2 ;;
    esac
    shift
done
data=${prefix:+$prefix/share}
data=${data:-${XDG_DATA_HOME:-$HOME/.local/share}}
type=$data/mime/packages/infobyte.xml
thumbnailer=$data/thumbnailers/infobyte.thumbnailer

refresh() {
    if command -v update-mime-database >/dev/null; then
        update-mime-database "$data/mime"
    else
        echo "update-mime-database is missing; install the package shared-mime-info and run this again" >&2
        exit 1
    fi
}

if [ "$remove" = yes ]; then
    rm -f "$type" "$thumbnailer"
    [ -z "$prefix" ] || rm -f "$prefix/bin/oct"
    [ ! -d "$data/mime" ] || refresh
    exit
fi

oct=${OCT:-$(command -v oct || true)}
[ -x "$oct" ] || {
    echo "oct is not on the path; run 'cargo install --path .' first, or name the program by OCT=..." >&2
    exit 1
}
if [ -n "$prefix" ]; then
    install -D -m 755 "$oct" "$prefix/bin/oct"
    oct=$prefix/bin/oct
fi
install -D -m 644 infobyte.xml "$type"
mkdir -p "$(dirname "$thumbnailer")"
sed "s|@OCT@|$(realpath "$oct")|" infobyte.thumbnailer >"$thumbnailer"
chmod 644 "$thumbnailer"
refresh
echo "installed: $type, $thumbnailer"
