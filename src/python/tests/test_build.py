"""Arrays of every kind make the same model, and what goes wrong is raised as what it is."""

import os
import signal
import threading

import numpy as np
import pytest

import infobyte
from conftest import ball_of, bumps_of, content


def built(source, name="a.oct", **options):
    options = {"iso": 500, "progress": False, **options}
    return infobyte.build(source, name, **options)


def layouts(a):
    """The same samples in memory in different ways, by name."""
    wide = np.zeros([2 * side for side in a.shape], a.dtype)
    wide[::2, ::2, ::2] = a
    yield "c", a
    yield "fortran", np.asfortranarray(a)
    yield "y slowest", np.ascontiguousarray(a.transpose(1, 2, 0)).transpose(2, 0, 1)
    yield "backwards", np.ascontiguousarray(a[::-1, ::-1, ::-1])[::-1, ::-1, ::-1]
    yield "x backwards", np.ascontiguousarray(a[..., ::-1])[..., ::-1]
    yield "every other", wide[::2, ::2, ::2]
    yield "read only", np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape)
    yield "unaligned", np.frombuffer(b"!" + a.tobytes(), a.dtype, offset=1).reshape(a.shape)
    yield "big-endian", a.astype(a.dtype.newbyteorder(">"))


def test_strides_do_not_matter(bumps):
    wanted = content(built(bumps).path)
    for name, array in layouts(bumps):
        assert np.array_equal(array, bumps), name
        assert content(built(array, "b.oct").path) == wanted, name


@pytest.mark.parametrize("kind", "u1 i1 u2 i2 u4 i4 f4 f8 i8 u8 f2 >i2 >f4".split())
def test_types(kind, bumps):
    values = (bumps // 10).astype(kind)
    assert content(built(values, iso=50).path) == content(built((bumps // 10).astype("i2"), "b.oct", iso=50).path)


def test_bool():
    inside = ball_of(32) > 0
    model = built(inside, iso=1, surface="skin")
    assert inside[tuple(model.voxels().T)].all()


@pytest.mark.parametrize("kind", ["c8", "U3", "O", "M8[s]"])
def test_types_that_are_no_numbers(kind):
    with pytest.raises(infobyte.UsageError, match="cannot be built"):
        built(np.zeros((4, 4, 4), kind))


def test_the_command_makes_the_same_model(bumps, oct):
    bumps.tofile("bumps.raw")
    oct("build", "bumps.raw", "-o", "c.oct", "--dims", "53x41x30", "--dtype", "i16", "--iso", "500", "--spacing", "3x2x1")
    model = built(bumps, spacing=(1, 2, 3))
    assert content("c.oct") == content(model.path)
    ours, theirs = model.info, infobyte.open("c.oct").info
    different = {key for key in ours if ours[key] != theirs[key]}
    assert different <= {"input", "source", "checksum", "bytes", "bytes_per_skin_voxel", "ratio_to_raw", "ratio_to_paper",
                         "ratio_to_paper_grid"}, different  # fmt: skip


def test_axes_and_spacing(bumps):
    model = built(bumps, spacing=(3, 2, 1), origin=(10, 20, 30))
    assert model.shape == bumps.shape
    assert np.array_equal(model.affine, [[1, 0, 0, 10], [0, 2, 0, 20], [0, 0, 3, 30], [0, 0, 0, 1]])
    # A cell lies between two samples along each axis.
    assert np.array_equal(model.centers(), (model.voxels()[:, ::-1] - 0.5) * [1, 2, 3] + [10, 20, 30])
    skin = built(bumps, "s.oct", surface="skin", spacing=(3, 2, 1), origin=(10, 20, 30))
    assert np.array_equal(skin.centers(), skin.voxels()[:, ::-1] * [1, 2, 3] + [10, 20, 30])
    turned = built(bumps.transpose(2, 1, 0), "b.oct", axes="xyz", spacing=(1, 2, 3), origin=(10, 20, 30))
    assert content(turned.path) == content(model.path)
    by_matrix = built(bumps, "d.oct", affine=model.affine)
    assert content(by_matrix.path) == content(model.path)
    assert built(bumps[12][None], "e.oct").shape == (1, 41, 53)


def test_thresholds(bumps):
    inside = (bumps >= 300) & (bumps <= 600)
    model = built(bumps, iso=None, range=(300, 600), surface="skin")
    assert inside[tuple(model.voxels().T)].all()
    assert len(built(bumps, "b.oct", iso=None, range=(500, float("inf")))) == len(built(bumps, "c.oct"))
    assert built(bumps, "d.oct", iso=None).info["range"]["kind"] == "otsu"
    assert built(bumps, "e.oct", iso=None, preset="bone").info["range"]["lo"] == 226


def test_labels(tmp_path):
    z, y, x = np.mgrid[:20, :24, :28]
    array = np.where((x > 4) & (x < 20) & (y > 3) & (y < 20) & (z > 2) & (z < 15), np.where(x < 12, 7, 9), 0).astype(np.uint8)
    model = built(array, iso=None, labels="all", names={7: "left", 9: "right"})
    assert [(label["number"], label["name"], label["voxels"]) for label in model.info["labels"]] == [
        (7, "left", int((array == 7).sum())), (9, "right", int((array == 9).sum()))]  # fmt: skip
    # Cells lie between eight samples that are not all of one label; samples beyond the volume are outside.
    padded = np.pad(array, 1)
    low, high = padded, padded
    for axis in range(3):
        front, behind = (slice(None),) * axis + (slice(1, None),), (slice(None),) * axis + (slice(-1),)
        low, high = np.minimum(low[front], low[behind]), np.maximum(high[front], high[behind])
    assert len(model) == (low != high).sum()
    assert np.array_equal(model.labels(), high[tuple(model.voxels().T)])
    with pytest.raises(infobyte.UsageError):
        built(array, "d.oct", iso=None, labels="all", surface="skin")
    table = tmp_path / "names.tsv"
    table.write_text("index\tname\n9\tright\n")
    one = built(array.astype(np.int32), "b.oct", iso=None, labels=[9], names=table)
    assert [label["name"] for label in one.info["labels"]] == ["right"] and (one.labels() == 9).all()
    assert (built(array, "c.oct", iso=1).labels() == 0).all()
    for options in (dict(labels="liver"), dict(labels="all", preset="bone"), dict(names={7: "left"}), dict(labels="all", error=0.1),
                    dict(labels="all", names=tmp_path / "none.tsv")):  # fmt: skip
        with pytest.raises((infobyte.UsageError, OSError)):
            built(array, "d.oct", iso=None, **options)
    with pytest.raises(infobyte.InputError, match="whole numbers"):
        built(array + 0.5, "d.oct", iso=None, labels="all")


def test_triangles_of_some_labels():
    z, y, x = np.mgrid[:20, :24, :28]
    array = np.where((x > 4) & (x < 20) & (y > 3) & (y < 20) & (z > 2) & (z < 15), np.where(x < 12, 7, 9), 0).astype(np.uint8)
    model = built(array, iso=None, labels="all", names={7: "left", 9: "right"})

    def volume(mesh):
        a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
        return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6

    left, both = model.to_mesh(only=["left"]), model.to_mesh(only=[7, 9])
    # A corner of an edge moves by at most half a voxel along each axis: half a square voxel along the edges' length.
    right = volume(both) - volume(left)
    assert 0 < (array == 7).sum() - volume(left) < 0.5 * 4 * (7 + 16 + 12)
    assert 0 < (array == 9).sum() - right < 0.5 * 4 * (8 + 16 + 12)
    assert np.array_equal(left.faces, both.faces[: len(left.faces)]) and len(np.unique(left.vertex_colors, axis=0)) == 1
    assert model.export("left.stl", only="left")["triangles"] == len(left.faces)
    assert np.array_equal(model.to_mesh(only="left, right").faces, both.faces)
    alone = built(array, "one.oct", iso=None, labels=["Left"], names={7: "left", 9: "right"})
    assert [label["number"] for label in alone.info["labels"]] == [7]
    with pytest.raises(infobyte.UsageError, match="did you mean 'left'"):
        built(array, "one.oct", iso=None, labels="lefty", names={7: "left", 9: "right"})
    assert "&x=9\"" in model.view(only="left").html and "&x=" not in model.view().html
    few = model.to_mesh(only=["left"], triangles=60)
    assert len(few.faces) == model.export("left.glb", only=["left"], triangles=60)["triangles"] <= 60 < len(left.faces)
    assert 8 <= len(model.to_mesh(only=["7..9"], triangles=60).faces) <= 60
    for wrong in (dict(only=[8]), dict(only=[""])):
        for call in (model.to_mesh, lambda **options: model.export("left.stl", **options)):
            with pytest.raises(infobyte.UsageError):
                call(**wrong)


def test_a_model_of_each_label(tmp_path, oct):
    z, y, x = np.mgrid[:20, :24, :28]
    array = np.where((x > 4) & (x < 20) & (y > 3) & (y < 20) & (z > 2) & (z < 15), np.where(x < 12, 7, 9), 0).astype(np.uint8)
    names = {7: "left", 9: "right"}
    model = built(array, iso=None, labels="all", names=names, each="parts")
    assert sorted(os.listdir("parts")) == ["left.oct", "right.oct"] and len(model.info["labels"]) == 2
    each = model.report["each"]
    assert [(part["number"], part["name"], part["voxels"]) for part in each] == [
        (number, name, int((array == number).sum())) for number, name in names.items()]  # fmt: skip
    # Of a file: those of the command, which replace what is there.
    (tmp_path / "map.raw").write_bytes(array.tobytes())
    options = dict(iso=None, labels="all", dims=(28, 24, 20), dtype="u8", each=tmp_path / "parts")
    built("map.raw", **options)
    oct("build", "map.raw", "--dims", "28x24x20", "--dtype", "u8", "--labels", "all", "--each", "wanted", "--memory", "64MiB")
    for name in os.listdir("wanted"):
        assert content(tmp_path / "wanted" / name) == content(tmp_path / "parts" / name)
    for part in infobyte.build(array, "walls.oct", labels="all", each="cells", smooth=0.25).report["each"]:
        assert infobyte.open(part["output"]).info["gradient"] == "label planes within 0.25 voxel"
    for wrong in (dict(labels=None), dict(smooth=0.6), dict(surface="skin")):
        with pytest.raises(infobyte.UsageError):
            built("map.raw", **{**options, **wrong})


def test_larger_leaves():
    ball = ball_of(64)
    fine, joined = (built(ball, f"{error}.oct", iso=0, surface="cells", error=error) for error in (0, "0.2mm"))
    assert "larger_leaves" not in fine.info
    leaves = joined.info["larger_leaves"]
    assert f"{len(joined)} cells and {leaves['leaves']} larger leaves of 64" in repr(joined)
    assert leaves["bound"] == pytest.approx(0.2) and 0 < leaves["leaves"] + len(joined) < len(fine)
    hits = joined.first_hits([[32, 32, -50]], [[0, 0, 1]])
    assert hits.t[0] == pytest.approx(fine.first_hits([[32, 32, -50]], [[0, 0, 1]]).t[0], abs=0.3)
    with pytest.raises(infobyte.UsageError, match="thick"):
        built(ball, "c.oct", iso=0, surface="cells", error="thick")


def test_cleaning(bumps):
    noisy = bumps.copy()
    noisy[2, 3, 4] = 900
    model = built(noisy, keep_largest=1)
    assert content(model.path) == content(built(bumps, "b.oct").path)
    assert model.report["cleaning"]["voxels_removed"] == 1
    assert content(built(noisy, "c.oct", drop_below="1%").path) == content(model.path)
    part = built(bumps, "d.oct", roi=[(5, 20), (0, 41), (10, 53)])
    assert part.shape == (15, 41, 43)
    alone = built(bumps[5:20, :, 10:53], "e.oct")
    assert np.array_equal(part.voxels(), alone.voxels()) and np.array_equal(part.normals(), alone.normals())
    assert np.array_equal(part.affine[:3, 3], [10, 0, 5])
    assert built(bumps, "f.oct", downsample=2).shape == (15, 21, 27)


def test_channels(bumps):
    model = built(bumps, channels=["normal", "value"])
    assert np.array_equal(model.values(), bumps[tuple(model.voxels().T)])
    bare = built(bumps, "b.oct", channels=[])
    assert np.isnan(bare.normals()).all() and np.isnan(bare.values()).all()


def test_memory_maps_are_read_from_their_file(bumps, tmp_path):
    from infobyte import _sources

    wanted = content(built(bumps).path)
    np.save("bumps.npy", bumps)
    bumps.tofile("bumps.raw")
    loaded = np.load("bumps.npy", mmap_mode="r")
    mapped = np.memmap("bumps.raw", bumps.dtype, "r", shape=bumps.shape)
    for array in (loaded, mapped, np.asarray(mapped), mapped.view(np.ndarray)):
        assert _sources.mapped_file(array)[0] in (str(tmp_path / "bumps.npy"), str(tmp_path / "bumps.raw"))
        assert content(built(array, "b.oct").path) == wanted
    part = mapped[7:20]
    assert _sources.mapped_file(part)[1] == part.ctypes.data - mapped.ctypes.data
    assert content(built(part, "b.oct").path) == content(built(bumps[7:20].copy(), "c.oct").path)
    # Not what the file holds, or not one after the other.
    own = np.memmap("bumps.raw", bumps.dtype, "c", shape=bumps.shape)
    own[15, 20, 20:25] = 0
    assert _sources.mapped_file(own) is None and _sources.mapped_file(mapped[:, ::2]) is None
    assert content(built(own, "b.oct").path) == content(built(np.array(own), "c.oct").path) != wanted
    assert content(built(mapped[:, ::2], "b.oct").path) == content(built(bumps[:, ::2], "c.oct").path)
    # Another file under its name.
    os.rename("bumps.raw", "old.raw")
    np.zeros_like(bumps).tofile("bumps.raw")
    assert content(built(mapped, "b.oct").path) == wanted


class Sliced:
    """What has only a shape, a type and slices."""

    def __init__(self, array, chunks=None):
        self.array, self.shape, self.dtype, self.chunks, self.most = array, array.shape, array.dtype, chunks, 0

    def __getitem__(self, key):
        part = self.array[key]
        self.most = max(self.most, part.nbytes)
        return part


def test_slices(bumps):
    wanted = content(built(bumps).path)
    for source in (iter(bumps), [*bumps], (bumps[i : i + 7] for i in range(0, 30, 7)), Sliced(bumps)):
        assert content(built(source, "b.oct").path) == wanted, source
    turned = Sliced(bumps.transpose(2, 1, 0), (53, 41, 8))
    assert content(built(turned, "b.oct", axes="xyz").path) == wanted
    tall = Sliced(np.repeat(np.repeat(bumps, 8, axis=1), 8, axis=2), (30, 328, 424))
    spooled = content(built(tall, "b.oct", memory="4MiB").path)
    assert spooled == content(built(tall.array, "b.oct").path)
    assert 1 << 20 < tall.most <= 2 << 20
    assert sorted(os.listdir()) == ["a.oct", "b.oct"]


def test_errors(bumps, tmp_path):
    cases = [
        (dict(iso=5000), infobyte.InputError, "no voxel lies in"),
        (dict(iso=float("nan")), infobyte.UsageError, "not a finite number"),
        (dict(iso=None, range=(5, 1)), infobyte.UsageError, "empty"),
        (dict(range=(1, 5)), infobyte.UsageError, "exclude"),
        (dict(iso=None, preset="gold"), infobyte.UsageError, "preset='gold' is not 'bone', "),
        (dict(surface="blob"), infobyte.UsageError, "surface='blob' is not 'cells' or 'skin'"),
        (dict(spacing=(1, 2)), infobyte.UsageError, "spacing"),
        (dict(spacing=0), infobyte.UsageError, "spacing"),
        (dict(axes="yzx"), infobyte.UsageError, "axes"),
        (dict(threads=0), infobyte.UsageError, "threads"),
        (dict(connectivity=8), infobyte.UsageError, "connectivity=8 is not 6 or 26"),
        (dict(surface="cells", connectivity=6), infobyte.UsageError, "connectivity is for skin voxels"),
        (dict(surface="cells", gradient="sobel"), infobyte.UsageError, "gradient is for skin voxels"),
        (dict(channels=["normal", "offset"], gradient="sobel"), infobyte.UsageError, "gradient is for skin voxels"),
        (dict(roi=[(0, 0), (0, 4), (0, 4)]), infobyte.UsageError, "roi"),
        (dict(drop_below="5 %%"), infobyte.UsageError, "drop_below"),
        (dict(memory="much"), infobyte.UsageError, "much"),
        (dict(affine=np.zeros((2, 2))), infobyte.UsageError, "affine"),
    ]
    for options, kind, sentence in cases:
        with pytest.raises(kind, match=sentence) as caught:
            built(bumps, **options)
        assert isinstance(caught.value, infobyte.InfobyteError) and isinstance(caught.value, ValueError)
    for source, sentence in [(np.zeros((2, 2, 2, 2)), "4 dimensions"), (np.zeros((8, 8)), "2 dimensions is not a volume; .* a single slice as array"), (np.zeros((0, 2, 2)), "empty"), (5, "not a source"), ([], "no slices")]:
        with pytest.raises(infobyte.UsageError, match=sentence):
            built(source)
    assert os.listdir() == []


def test_too_little_memory(bumps):
    with pytest.raises(infobyte.BudgetError, match="is too small; memory") as caught:
        built(bumps, memory="10KiB")
    assert isinstance(caught.value, MemoryError) and caught.value.minimum_bytes > 10 << 10
    assert len(built(bumps, memory=caught.value.minimum_bytes)) > 0


def test_what_the_system_refuses(bumps):
    for call in (lambda: built("nothing.nrrd"), lambda: infobyte.open("nothing.oct"), lambda: infobyte.verify("nothing.oct")):
        with pytest.raises(FileNotFoundError, match="nothing") as caught:
            call()
        assert isinstance(caught.value, infobyte.InfobyteError)
        assert caught.value.errno == 2 and caught.value.filename.startswith("nothing")
    with pytest.raises(FileNotFoundError):
        built(bumps, "folder/that/is/not/there/a.oct")
    with pytest.raises(infobyte.InputError):
        infobyte.open(__file__)


@pytest.mark.parametrize("stage", ["scan", "merge"])
def test_an_exception_in_progress_stops_every_stage(stage):
    big, seen = ball_of(200), []
    infobyte.build(big, "a.oct", iso=0, progress=lambda *now: seen.append(now))
    assert all(0 <= done <= total for _, done, total in seen)

    def stop(now, done, total):
        if now == stage:
            raise RuntimeError(now)

    # On a busy machine a short stage may end before `progress` hears of it; one of many runs meets it.
    for _ in range(100):
        try:
            infobyte.build(big, "b.oct", iso=0, progress=stop)
            os.remove("b.oct")
        except RuntimeError:
            break
    else:
        pytest.fail(f"no run was stopped in {stage}")
    if os.path.exists("b.oct"):
        # Too late: it had its name.
        assert infobyte.verify("b.oct")["ok"]
        os.remove("b.oct")
    with pytest.raises(ZeroDivisionError):
        infobyte.build(iter(big), "b.oct", iso=0, progress=lambda *_: 1 / 0)
    assert os.listdir() == ["a.oct"]


def test_ctrl_c_stops_a_build_and_leaves_the_old_model():
    big = ball_of(320)
    before = infobyte.build(big[:40], "a.oct", iso=-100, progress=False).info["checksum"]
    threading.Timer(0.15, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(50):
            infobyte.build(big, "b.oct", iso=0, threads=1, progress=False)
            os.remove("b.oct")
    if os.path.exists("b.oct"):
        # The signal came when the model had its name.
        assert infobyte.verify("b.oct")["ok"]
        os.remove("b.oct")
    assert os.listdir() == ["a.oct"] and infobyte.open("a.oct").info["checksum"] == before


def test_threads_of_python_build_at_a_time(bumps):
    wanted = content(built(bumps).path)
    threads = [threading.Thread(target=built, args=(bumps, f"t{i}.oct")) for i in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(content(f"t{i}.oct") == wanted for i in range(6))


def test_solids_and_meshes(oct):
    with open("part.csg", "w") as file:
        file.write("difference() { cube(10); sphere(6); }")
    part = infobyte.build("part.csg", "part.oct", grid=64, progress=False)
    assert part.shape == (64, 64, 64) and part.report["skin_voxels"] == len(part)
    part.export("part.stl")
    again = infobyte.build(["part.stl"], "again.oct", grid=64, progress=False)
    assert abs(len(again) / len(part) - 1) < 0.2
    assert max(infobyte.build("part.stl", "usual.oct", progress=False).shape) == 512
    with pytest.raises(infobyte.UsageError, match="grid and voxel"):
        infobyte.build("part.stl", "b.oct", grid=64, voxel=1, progress=False)


def test_headerless_files(bumps):
    bumps.tofile("bumps.raw")
    model = infobyte.build("bumps.raw", "a.oct", iso=500, dims=(53, 41, 30), dtype="i16", progress=False)
    assert content(model.path) == content(built(bumps, "b.oct").path)
    with pytest.raises(infobyte.UsageError, match="dims and dtype"):
        infobyte.build("bumps.raw", "a.oct", iso=500, dims=(53, 41, 30), progress=False)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"iso": "300"}, TypeError, "iso='300' is not a number"),
        ({"iso": np.arange(3)}, TypeError, r"iso is an array of shape \(3,\), not a number"),
        ({"range": 5}, TypeError, "range=5 is not a pair of numbers; give for example"),
        ({"spacing": "1"}, TypeError, "spacing='1' is not a number or a list of numbers"),
        ({"labels": True}, TypeError, "labels=True is not text, a whole number or a list of whole numbers"),
        ({"labels": "all", "names": {1: ("ball", "#f00")}}, TypeError, r"names=\{1: \('ball', '#f00'\)\} is not a path or a dict of texts"),
        ({"labels": "all", "names": ["a", "b"]}, TypeError, r"names=\['a', 'b'\] is not a path or a dict of texts"),
        ({"channels": "normal"}, TypeError, "channels='normal' is not a list of 'normal', 'value', "),
        ({"keep_largest": -1}, TypeError, "keep_largest=-1 is not a non-negative whole number"),
        ({"keep_largest": 0}, infobyte.UsageError, "keep_largest=0 is not a number of components; choose 1 to 4000"),
        ({"roi": [(0, 2), (0, 5), (0, 2)]}, infobyte.UsageError, "roi ends at 5 along y, where the array has 4 samples"),
        ({"roi": [(0, 2), (0, 2)]}, infobyte.UsageError, "three axes"),
        ({"origin": (1, 2)}, TypeError, r"origin=\(1, 2\) is not three numbers"),
        ({"visible_from": "outside"}, TypeError, r"visible_from='outside' is not a list .* \['outside'\]"),
        ({"lod": "no"}, TypeError, "lod='no' is not True or False"),
        ({"grid": 64}, infobyte.UsageError, "grid is for files and meshes"),
        ({"unit": "cm"}, infobyte.UsageError, "unit is for files and meshes"),
        ({"threads": -1}, TypeError, "threads=-1 is not a non-negative whole number"),
        ({"iso": 1.0, "affine": np.zeros((3, 4))}, infobyte.UsageError, "lie in a plane"),
        ({"iso": 1.0, "affine": np.diag([1.0, 0.0, 1.0, 1.0])}, infobyte.UsageError, "lie in a plane"),
    ],
)
def test_options_that_make_no_sense_are_named(tmp_path, options, error, said):
    with pytest.raises(error, match=said):
        infobyte.build(np.ones((4, 4, 4), np.int16), tmp_path / "o.oct", **options)
    with pytest.raises(ValueError, match=said):
        infobyte.build(list(np.ones((4, 4, 4), np.int16)), tmp_path / "o.oct", **options)
    assert not (tmp_path / "o.oct").exists()


@pytest.mark.parametrize("name", ["scan.nii.gz", "samples.NPY", "notes.txt", "picture.png"])
def test_a_file_of_another_kind_is_not_replaced(tmp_path, name):
    (tmp_path / name).write_bytes(b"precious")
    array = np.ones((4, 4, 4), np.int16)
    with pytest.raises(infobyte.UsageError, match=f"{name}: is named as another kind of file.*force=True"):
        infobyte.build(array, tmp_path / name, iso=1)
    assert (tmp_path / name).read_bytes() == b"precious"
    assert infobyte.build(array, tmp_path / name, iso=1, force=True).shape == (4, 4, 4)


def test_masked_samples_are_outside_and_samples_that_are_no_numbers_are_warned_of(tmp_path):
    full = np.full((4, 4, 4), 1000, "i2")
    masked = np.ma.masked_array(full, mask=True)
    masked.mask[1:3, 1:3, 1:3] = False
    for source in (masked, masked.astype("f8"), list(masked), masked.transpose(2, 1, 0)):
        with pytest.warns(UserWarning, match="NaN"):
            model = infobyte.build(source, tmp_path / "m.oct", iso=500, surface="skin", progress=False)
        assert model.report["skin_voxels"] == 8
    bare = infobyte.build(np.ma.masked_array(full), tmp_path / "n.oct", iso=500, progress=False)
    assert bare.shape == (4, 4, 4)
    with pytest.warns(UserWarning, match="infinite"):
        infobyte.build(np.where(masked.mask, 0, np.inf), tmp_path / "i.oct", iso=500, progress=False)
    labels = infobyte.build(masked, tmp_path / "l.oct", labels="all", progress=False).info["labels"]
    assert [label["voxels"] for label in labels] == [8]
    with pytest.raises(infobyte.UsageError, match="masked"):
        infobyte.build([full[0], masked[1]], tmp_path / "x.oct", iso=500, progress=False)
