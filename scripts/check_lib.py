"""What check_sources.py and check_studies.py share: running `oct`, reading a model, skin by numpy.

Nothing here follows the program's code: models are read by src/format/SPEC.md, skins are counted from
their definition, and geometry is that of the formats' own standards.
Needs numpy (scripts/requirements-check.txt).
"""
import json
import re
import struct
import subprocess

import numpy as np

#: Exit codes with which the program may refuse (usage, input, budget, disk); anything else is a crash.
REFUSALS = (2, 3, 4, 5)

#: RAS to LPS and back.
FLIP_XY = np.diag([-1.0, -1.0, 1.0])


class Run:
    """One run of the program: exit code, JSON object (or None), and the sentence on stderr."""

    def __init__(self, command, timeout):
        try:
            done = subprocess.run([str(c) for c in command], capture_output=True, timeout=timeout)
            self.code, out, err = done.returncode, done.stdout, done.stderr
        except subprocess.TimeoutExpired:
            self.code, out, err = "timeout", b"", f"no answer in {timeout} s".encode()
        self.sentence = " ".join(err.decode("utf-8", "replace").split())
        self.json = None
        if self.code == 0:
            try:
                self.json = json.loads(out)
            except ValueError:
                self.code, self.sentence = "bad json", out[:200].decode("utf-8", "replace")

    @property
    def ok(self):
        return self.code == 0

    @property
    def crashed(self):
        """Neither done nor refused in an orderly way."""
        text = self.sentence.lower()
        return not self.ok and (self.code not in REFUSALS or "panicked" in text or not text)


def build(oct, inputs, model, *options, memory="64MiB", timeout=300):
    """`oct build`; `inputs` is one path or a list."""
    inputs = inputs if isinstance(inputs, (list, tuple)) else [inputs]
    model.unlink(missing_ok=True)
    surface = [] if "--surface" in options else ["--surface", "skin"]
    return Run([oct, "build", *inputs, "-o", model, "--json", "--memory", memory, *surface, *options], timeout)


def info(oct, model):
    """`oct info --json`."""
    return Run([oct, "info", model, "--json"], 60)


class Model:
    """A mapped model, read by SPEC 3 and 4: header, table, sections, and where the skin is."""

    def __init__(self, path):
        data = path.read_bytes()
        assert data[:8] == b"\x89OCT\r\n\x1a\n", "not a model"
        self.depth, count = struct.unpack_from("<xBH", data, 12)
        self.nodes, self.voxels, *self.dims = struct.unpack_from("<QQIII", data, 24)
        self.sections = {}
        for at in range(64, 64 + 48 * count, 48):
            kind, _, _, _, offset, stored = struct.unpack_from("<4sBBHQQ", data, at)
            self.sections[kind.decode()] = data[offset:offset + stored]

    def coordinates(self):
        """Voxel coordinates of the skin as V x 3 (x, y, z), in the file's order."""
        levels = struct.unpack(f"<{self.depth + 1}Q", self.sections["LEVL"])
        masks = np.frombuffer(self.sections["NODE"], np.uint8)
        boxes = np.zeros((1, 3), np.int64)
        for depth in range(self.depth):
            bits = np.unpackbits(masks[levels[depth]:levels[depth + 1], None], axis=1, bitorder="little")
            parent, octant = np.nonzero(bits)
            half = np.stack([octant & 1, octant >> 1 & 1, octant >> 2], 1)
            boxes = boxes[parent] * 2 + half
        assert len(boxes) == self.voxels, "voxels and infobytes disagree"
        return boxes

    def values(self):
        """Physical values of the skin in the file's order; needs the `value` channel."""
        scale, offset = struct.unpack("<2d", self.sections["META"][-16:])
        raw = self.sections["VALU"]
        stored = np.frombuffer(raw, np.uint8 if len(raw) == self.voxels else "<u2")
        return scale * stored + offset, scale


def skin(inside):
    """Inside voxels with a face neighbour that is not inside; beyond the volume is air. [z, y, x]."""
    deep = np.zeros(inside.shape, bool)
    if min(inside.shape) > 2:
        mid = inside[1:-1, 1:-1, 1:-1]
        deep[1:-1, 1:-1, 1:-1] = (mid & inside[:-2, 1:-1, 1:-1] & inside[2:, 1:-1, 1:-1]
                                  & inside[1:-1, :-2, 1:-1] & inside[1:-1, 2:, 1:-1]
                                  & inside[1:-1, 1:-1, :-2] & inside[1:-1, 1:-1, 2:])
    return inside & ~deep


def select(values, lo, hi):
    """Inside: lo <= value <= hi. NaN is outside."""
    with np.errstate(invalid="ignore"):
        inside = values >= lo
        return inside if hi is None else inside & (values <= hi)


def corners(affine, dims):
    """The eight corner voxel centres in mm, by index, x fastest."""
    index = np.array([[x, y, z] for z in (0, dims[2] - 1) for y in (0, dims[1] - 1) for x in (0, dims[0] - 1)])
    affine = np.asarray(affine, float)
    return index @ affine[:, :3].T + affine[:, 3]


def flips(affine, dims):
    """Every way to number the same voxels from another corner: (axes reversed, affine)."""
    affine = np.asarray(affine, float)
    for bits in range(8):
        reverse = [bool(bits >> a & 1) for a in range(3)]
        turned = affine.copy()
        for a in range(3):
            if reverse[a]:
                turned[:, 3] += affine[:, a] * (dims[a] - 1)
                turned[:, a] = -affine[:, a]
        yield reverse, turned


def compare_skin(model, values, lo, hi):
    """Compares skin positions, and values if the model has them, with a numpy computation.

    Returns (own count, voxels that only one side has, worst difference of value or None, step of values).
    """
    want = skin(select(values, lo, hi))
    count = int(want.sum())
    have = np.zeros(values.shape, bool)
    at = model.coordinates()
    inside = (at < np.array(values.shape[::-1])).all(1)
    x, y, z = at[inside].T
    have[z, y, x] = True
    differ = int((want ^ have).sum()) + int((~inside).sum())
    worst = step = None
    if "VALU" in model.sections and inside.all():
        got, step = model.values()
        worst = float(np.abs(got - values[z, y, x].astype(float)).max(initial=0.0))
    return count, differ, worst, step


def judge_values(worst, step, dtype, values):
    """A complaint if the values on the skin are further off than their storage explains."""
    span = float(np.nanmax(np.abs(values)))
    # Types over 16 bits are stored in 16 bits between the ends found on the skin.
    tolerance = 1e-6 * span + (0.51 * abs(step) if dtype in ("u32", "i32", "f32", "f64") else 0.0)
    return [] if worst <= tolerance else [f"skin values differ by up to {worst:g}"]


def probe_range(oct, inputs, scratch, values, options=(), memory="64MiB"):
    """Finds by the program's own segmentation whether its voxels span exactly [min, max] of `values`.

    At `max` and at `min` there must be exactly the skin that numpy finds; just beyond, nothing at all.
    Returns a list of complaints.
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    span = max(abs(low), abs(high), high - low, 1e-30)
    eps = 1e-5 * span
    bad = []

    def count(lo, hi):
        run = build(oct, inputs, scratch, "--range", f"{lo!r}..{hi!r}", "--channels", "none", *options, memory=memory)
        if run.ok:
            return run.json["skin_voxels"]
        if run.crashed or "no voxel" not in run.sentence:
            return f"exit {run.code}: {run.sentence[-160:]}"
        # The refusal states the range as the program sees it.
        stated = re.search(r"run from (\S+) to ([^\s:;,]+)", run.sentence)
        if stated and max(abs(float(stated[1]) - low), abs(float(stated[2]) - high)) > eps:
            bad.append(f"values stated as {stated[1]}..{stated[2]}, numpy {low:g}..{high:g}")
        return 0

    for name, lo, hi, empty in (("max", high - eps, high + eps, False), ("min", low - eps, low + eps, False),
                                ("above max", high + eps, high + 10 * span, True),
                                ("below min", low - 10 * span, low - eps, True)):
        due = 0 if empty else int(skin(select(values, lo, hi)).sum())
        got = count(lo, hi)
        if got != due:
            bad.append(f"at {name} ({(high if 'max' in name else low):g}): {got} skin voxels, numpy {due}")
    return list(dict.fromkeys(bad))
