#!/usr/bin/env bash
# The paper's figures 6 to 11 in our terms, each from nothing but this script: pictures into a folder.
# usage: scripts/gallery.sh DIR [MESH]     MESH in the place of figure 6's coloured cube; some seconds on 2 cores
# OCT names the program; else the release build of this folder is made and taken. SIDE is that of a picture, 640 pixels.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

[[ $# -ge 1 && $# -le 2 ]] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
out=$1
side=${SIDE:-640}
mesh=${2:+$(realpath "$2")}
oct=${OCT:-}
if [[ -z $oct ]]; then
    (cd "$root" && cargo build --release --locked --quiet)
    oct=$root/target/release/oct
fi
mkdir -p "$out"
cd "$out"

# Figure 6: polygons at 1024^3, with the colours of their vertices.
if [[ -z $mesh ]]; then
    mesh=cube.ply
    python3 - "$mesh" <<'PY'
import sys
places = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
with open(sys.argv[1], "w") as f:
    f.write("ply\nformat ascii 1.0\nelement vertex 8\n")
    f.writelines(f"property float {axis}\n" for axis in "xyz")
    f.writelines(f"property uchar {part}\n" for part in ("red", "green", "blue"))
    f.write("element face 6\nproperty list uchar int vertex_indices\nend_header\n")
    f.writelines(f"{100 * x} {100 * y} {100 * z} {255 * x} {255 * y} {255 * z}\n" for x, y, z in places)
    f.writelines("4 {} {} {} {}\n".format(*side) for side in sides)
PY
fi
"$oct" build "$mesh" -o polygons.oct --grid 1024 --memory 16MiB --quiet
"$oct" render polygons.oct -o figure-06-polygons.png --view iso --size "${side}x$side" >/dev/null

# Figure 7: operations on solids at 256^3.
cat >solids.csg <<'CSG'
difference() {
    intersection() {
        cube(size = [40, 40, 40], center = true);
        sphere(r = 26);
    }
    cylinder(h = 60, r = 10, center = true);
    multmatrix([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]) { cylinder(h = 60, r = 10, center = true); }
    multmatrix([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]) { cylinder(h = 60, r = 10, center = true); }
}
CSG
"$oct" build solids.csg -o solids.oct --grid 256 --memory 8MiB --quiet
"$oct" render solids.oct -o figure-07-solids.png --view iso --size "${side}x$side" >/dev/null

# Figures 8 to 10: a scanned head, its skin and its skull, and both with a piece cut away.
"$oct" build synthetic:head@256 -o skin.oct --iso=-400 --quiet
"$oct" build synthetic:head@256 -o skull.oct --iso 400 --quiet
"$oct" render skin.oct -o figure-08-skin.png --view iso --size "${side}x$side" >/dev/null
"$oct" render skull.oct -o figure-09-skull.png --view iso --size "${side}x$side" --shading ao >/dev/null
cat >cut.toml <<TOML
size = [$side, $side]
samples = 2
[camera]
view = "iso"
[[light]]
kind = "directional"
from = [1, -2, 2]
[[model]]
file = "skin.oct"
material = "skin"
clip = { planes = [[1, 0, 0, 0]] }
[[model]]
file = "skull.oct"
material = "bone"
TOML
"$oct" render cut.toml -o figure-10-cut.png >/dev/null

# Figure 11: three bodies in one scene, with mirrors and shadows.
cat >ring.csg <<'CSG'
torus(30, 9);
CSG
cat >ball.csg <<'CSG'
difference() {
    sphere(r = 24);
    multmatrix([[1, 0, 0, 14], [0, 1, 0, -18], [0, 0, 1, 14], [0, 0, 0, 1]]) { sphere(r = 16); }
}
CSG
cat >floor.csg <<'CSG'
cube(size = [200, 160, 6], center = true);
CSG
for body in ring ball floor; do
    "$oct" build "$body.csg" -o "$body.oct" --grid 256 --memory 8MiB --quiet
done
cat >scene.toml <<TOML
size = [$side, $side]
background = "#8aa4b8"
samples = 2
[camera]
projection = "perspective"
eye = [30, -260, 120]
look_at = [0, 0, 14]
[[light]]
kind = "point"
at = [-160, -200, 260]
[[model]]
file = "ring.oct"
material = "metal"
move = [-44, 4, 12]
[[model]]
file = "ball.oct"
material = "red"
move = [34, 0, 27]
[[model]]
file = "floor.oct"
material = "floor"
[material.red]
color = "#c04030"
mirror = 0.15
[material.floor]
color = "#b0b8b0"
mirror = 0.4
TOML
"$oct" render scene.toml -o figure-11-scene.png >/dev/null
ls -- *.png
