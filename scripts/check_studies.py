#!/usr/bin/env python3
"""Builds every study of make_studies.py with `oct` and compares the models with truth.json.

Compared: dims, affine (three corners of the box in mm), the range of values, the skin voxel by voxel at the
stated threshold, the values on the skin, and, among studies that hold the same object, the structure (LEVL,
NODE, RANK) and the normals (NORM, NLOD) byte for byte. Studies that must be refused have to say why, with exit
code 3 (or 2, 4). Prints a Markdown table.

With --self-test the program is not run: public libraries (pydicom, nibabel, pynrrd, SimpleITK, tifffile, numpy)
read the studies instead, which shows that the files mean what truth.json says.

Exit codes: 0 all as expected; 1 something differs; 2 the script could not run.
Needs Python 3.10 and scripts/requirements-check.txt.

usage: check_studies.py OCT DIR [--only TEXT] [--refused-ok] [--memory 64MiB]
       check_studies.py --self-test DIR
"""
import argparse
import hashlib
import json
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

import check_lib as lib

STRUCTURE, NORMALS = ("LEVL", "NODE", "RANK"), ("NLOD", "NORM")


def digest(model, kinds):
    return hashlib.sha256(b"".join(model.sections.get(k, b"") for k in kinds)).hexdigest()


def matches(truth, facts, model, values, iso, lossy):
    """Complaints about one model as a reading of one volume."""
    bad = []
    if facts["dims"] != truth["dims"]:
        return [f"dims {facts['dims']}, should be {truth['dims']}"]
    if truth["affine"] is not None:
        due, got = np.array(truth["affine"]), np.array(facts["affine"])
        if not truth["origin"]:
            due, got = due[:, :3].copy(), got[:, :3].copy()
            due, got = np.column_stack([due, np.zeros(3)]), np.column_stack([got, np.zeros(3)])
        error = np.abs(lib.corners(due, truth["dims"]) - lib.corners(got, truth["dims"])).max()
        if error > truth["tolerance_mm"]:
            bad.append(f"corners off by {error:.4g} mm")
            for turn, turned in lib.flips(due, truth["dims"]):
                there = lib.corners(turned, truth["dims"]) - lib.corners(got, truth["dims"])
                if np.abs(there).max() <= truth["tolerance_mm"]:
                    bad[-1] += " (" + "".join(a for a, r in zip("xyz", turn) if r) + " reversed)"
        spacing = np.linalg.norm(np.array(facts["affine"])[:, :3], axis=0)
        if not np.allclose(facts["spacing_mm"], spacing, rtol=1e-9):
            bad.append("spacing and affine disagree")
    if values is None:
        return bad
    count, differ, worst, step = lib.compare_skin(model, values, iso, None)
    if lossy:
        share = differ / max(count, 1)
        bad += [f"{100 * share:.1f} % of the skin differs"] if share > lossy else []
        far = worst is not None and worst > 2 * abs(facts["rescale"][0])
        return bad + ([f"values off by {worst:g}"] if far else [])
    assert count == truth["skin"], "truth.json and its values disagree; run make_studies.py again"
    if differ or facts["skin_voxels"] != truth["skin"]:
        bad.append(f"skin {facts['skin_voxels']}, should be {truth['skin']}; {differ} voxels differ")
    elif worst is not None:
        bad += lib.judge_values(worst, step, facts["dtype"], values)
    return bad


class Checker:
    """Runs the studies and remembers the bytes of the first of every group."""

    def __init__(self, oct, root, memory, work):
        self.oct, self.root, self.memory, self.model = oct, root, memory, work / "study.oct"
        self.groups = {}

    def check(self, study):
        """(state, sentence): state is ok, refused or wrong."""
        path = self.root / study["path"]
        run = lib.build(self.oct, path, self.model, "--iso", repr(study["iso"]), "--channels", "normal,value",
                        *study["options"], memory=self.memory)
        if run.crashed:
            return "wrong", f"CRASH, exit {run.code}: {run.sentence[:200]}"
        if not run.ok:
            text = f"exit {run.code}: " + run.sentence.replace(str(self.root), "DIR")[:240].replace("|", "\\|")
            if study["expect"] == "converts":
                return "refused", "REFUSED, should convert; " + text
            if not re.search(study["reason"], run.sentence.replace(str(path), ""), re.I):
                return "refused", f"refused, but not because of `{study['reason']}`; " + text
            return "ok", "ok, refused; " + text
        if study["expect"] == "refused":
            return "wrong", "WRONG: converted, should be refused"
        shown = lib.info(self.oct, self.model)
        if not shown.ok:
            return "wrong", f"WRONG: info fails: {shown.sentence[:200]}"
        if "volumes" not in study:
            return "ok", "converted; unjudged"
        model = lib.Model(self.model)
        verdicts = []
        for truth in study["volumes"]:
            values = np.load(self.root / truth["values"]).astype(float) if truth["values"] else None
            bad = matches(truth, shown.json, model, values, study["iso"], study["lossy"])
            if not bad and values is not None and not study["lossy"]:
                bad = lib.probe_range(self.oct, path, self.model, values, study["options"], self.memory)
            verdicts.append(bad)
        bad = min(verdicts, key=len)
        bad = bad + self.compare_bytes(study, model) if not bad else bad
        warned = run.json.get("warnings") or []
        if study["warn"] and not re.search(study["warn"], " ".join(warned)):
            bad = bad + [f"no warning of `{study['warn']}`"]
        return ("wrong", "WRONG: " + ", ".join(bad)) if bad else (
            "ok", "ok" + (f"; warns: {' / '.join(warned)}"[:200].replace("|", "\\|") if warned else ""))

    def compare_bytes(self, study, model):
        if not study["same"]:
            return []
        name = study["same"].removeprefix("structure:")
        kinds = {"structure": STRUCTURE} if name != study["same"] else {"structure": STRUCTURE, "normals": NORMALS}
        bad = []
        for what, sections in kinds.items():
            first, due = self.groups.setdefault((name, what), (study["name"], digest(model, sections)))
            if digest(model, sections) != due:
                bad.append(f"{what} not the bytes of {first}")
        return bad


def self_test(root, studies):
    """Reads the studies with public libraries and compares with the truth."""
    import nibabel
    import SimpleITK
    import tifffile

    import check_sources as reference

    def simple(path):
        image = SimpleITK.ReadImage(str(path))
        axes = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
        return [(SimpleITK.GetArrayFromImage(image), np.column_stack([axes, image.GetOrigin()]))]

    def read(study):
        path, name = root / study["path"], study["name"]
        if name.startswith("npy/"):
            return [(np.load(path), None)]
        if name.startswith("tiff/"):
            files = sorted(path.iterdir(), key=reference.natural) if path.is_dir() else None
            return [(np.stack([tifffile.imread(f) for f in files]) if files else tifffile.imread(path), None)]
        if name.startswith("nifti/"):
            return [(v.values, v.affine) for v in reference.read_nifti(path)]
        if name.startswith("meta/"):
            return simple(path)
        if name.startswith("nrrd/"):
            try:
                return [(v.values, v.affine) for v in reference.read_nrrd(path)]
            except Exception:  # lists and patterns of files
                return simple(path)
        if name.startswith("dicom/"):
            files = sorted(path.iterdir()) if path.is_dir() else [path]
            return [(v.values, v.affine) for v in reference.read_dicom(files)]
        return None

    tally = {"agree": 0, "differ": 0, "unread": 0}
    for study in studies:
        if "volumes" not in study or study["expect"] == "refused" or "--gaps" in study["options"]:
            continue
        try:
            found = read(study)
        except Exception as error:
            tally["unread"] += 1
            why = f"{type(error).__name__} {str(error)[:100]}"
            print(f"- {study['name']} ({study['expect']}): the reference cannot read it: {why}")
            continue
        if found is None:
            continue

        def fits(values, affine, truth, lossy):
            if truth["values"] is None:
                return True
            due = np.load(root / truth["values"])
            values = values[None] if values.ndim == 2 else values
            slack = 2.0 if lossy else 1e-6
            if values.shape != due.shape or not np.allclose(values, due, rtol=1e-6, atol=slack, equal_nan=True):
                return False
            if affine is None or truth["affine"] is None:
                return True
            columns = slice(0, 4 if truth["origin"] else 3)
            return np.allclose(affine[:, columns], np.array(truth["affine"])[:, columns], atol=1e-3)

        agree = any(fits(np.asarray(v), a, t, study["lossy"]) for v, a in found for t in study["volumes"])
        # What may be refused, too, is what libraries disagree on.
        tally["agree" if agree else "differ" if study["expect"] == "converts" else "unread"] += 1
        if not agree:
            print(f"- {study['name']} ({study['expect']}): the reference reads it otherwise {study['note']}")
    print(", ".join(f"{n} {k}" for k, n in tally.items()))
    return int(tally["differ"] > 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("oct", type=Path, nargs="?")
    parser.add_argument("dir", type=Path)
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--only", default="", help="only studies whose name holds this text")
    parser.add_argument("--refused-ok", action="store_true", help="exit 0 when studies are refused that should convert")
    parser.add_argument("--memory", default="64MiB")
    args = parser.parse_args()
    if not (args.dir / "truth.json").is_file() or not (args.self_test or args.oct and args.oct.is_file()):
        parser.error("OCT must be the program and DIR a folder made by make_studies.py")
    studies = [s for s in json.loads((args.dir / "truth.json").read_text())["studies"] if args.only in s["name"]]
    if args.self_test:
        return self_test(args.dir, studies)
    # Raw files first: they are the plainest reading, and the others are measured by their bytes.
    studies.sort(key=lambda s: not s["name"].startswith("raw/"))
    count = {"ok": 0, "refused": 0, "wrong": 0}
    with tempfile.TemporaryDirectory() as temporary:
        checker = Checker(args.oct, args.dir, args.memory, Path(temporary))
        print("| study | verdict |\n|---|---|")
        for study in studies:
            state, sentence = checker.check(study)
            count[state] += 1
            print(f"| {study['name']}{' (' + study['note'] + ')' if study['note'] else ''} | {sentence} |", flush=True)
    print(f"\n{count['ok']} as expected, {count['refused']} refused that should convert (or for another reason), "
          f"{count['wrong']} wrong.")
    return int(bool(count["wrong"] or (count["refused"] and not args.refused_ok)))


if __name__ == "__main__":
    sys.exit(main())
