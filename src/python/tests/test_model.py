"""Open models: pictures, rays, voxels, triangles; and files that change under them."""

import html.parser
import os
import pickle
import subprocess
import sys
import threading

import numpy as np
import pytest

import infobyte
from conftest import ball_of


def test_what_a_model_says(model):
    assert model.shape == (48, 48, 48) and len(model) == model.info["skin_voxels"] > 5000
    assert model.report["skin_voxels"] == len(model) and infobyte.open(model.path).report is None
    assert "cells of 48 x 48 x 48" in repr(model)
    measured = model.measure()
    # A ball of 10 mm.
    assert measured["surface_area_mm2"] == pytest.approx(400 * np.pi, rel=0.01)
    assert model.verify()["ok"]
    again = pickle.loads(pickle.dumps(model))
    assert again.info == model.info


def test_pictures(model):
    picture = model.render(96, view="iso")
    assert picture.shape == (96, 96, 4) and picture.dtype == np.uint8
    assert picture[48, 48, 3] == 255 and picture[0, 0, 3] == 0
    # Most of a framed ball's box is shown.
    assert 0.6 < (picture[..., 3] > 0).mean() < 0.8
    assert model.render((64, 32)).shape == (32, 64, 4)
    black = model.render(96, view="iso", background=(0, 0, 0))
    assert (black[..., 3] == 255).all() and (black[0, 0, :3] == 0).all()
    assert (black[48, 48, :3] == picture[48, 48, :3]).all()
    assert np.array_equal(model.render(96, view="iso", threads=1), picture)
    for options in (dict(shading="ao"), dict(annotate=True), dict(projection="perspective")):
        assert not np.array_equal(model.render(96, view="iso", **options), picture), options
    assert not np.array_equal(model.render(4, lod=True), model.render(4))
    ahead = dict(eye=(11.75, -50, 11.75), look_at=(11.75, 0, 11.75))
    assert model.render(32, **ahead)[16, 16, 3] == 255


def test_pngs(model):
    png = model._repr_png_()
    assert png.startswith(b"\x89PNG") and model.png(16).startswith(b"\x89PNG")
    image = pytest.importorskip("PIL.Image")
    import io

    whole = np.asarray(image.open(io.BytesIO(model.png(64, view="iso"))))
    assert np.array_equal(whole, model.render(64, view="iso"))


def test_layers_are_those_of_the_rays(model):
    layers = model.render((50, 40), view="front", layers=["depth", "position", "normals", "ids"])
    hit = np.isfinite(layers["depth"])
    alpha = layers["color"][..., 3]
    assert layers["color"].shape == (40, 50, 4) and np.all(hit[alpha == 255]) and np.all(alpha[hit] > 0)
    # By one ray a pixel, colours are of the same rays.
    assert np.array_equal(hit, model.render((50, 40), view="front", samples=1)[..., 3] > 0)
    assert np.array_equal(layers["ids"] >= 0, hit) and np.isnan(layers["normals"][~hit]).all()
    # A ball of 10 mm around its middle: each normal leads away from it.
    away = (layers["position"][hit] - 11.75) / 10
    assert np.abs(np.linalg.norm(away, axis=1) - 1).max() < 0.01
    assert (away * layers["normals"][hit]).sum(axis=1).min() > 0.99
    # The front view looks along +y, and depth is measured along it.
    assert np.ptp(layers["position"][hit][:, 1] - layers["depth"][hit]) < 1e-9
    assert set(model.render(8, layers=["ids"])) == {"color", "ids"}


@pytest.mark.parametrize(
    "options",
    [dict(view="under"), dict(eye=(0, 0, 0)), dict(up=(0, 0, 1)), dict(shading="glossy"), dict(projection="x"), dict(fov=40),
     dict(fov=200, projection="perspective"), dict(ao_rays=3, shading="plain"),
     dict(size=0), dict(layers=["shadow"]), dict(background=5), dict(eye=(0, 0, float("nan")), look_at=(0, 0, 0))],
)  # fmt: skip
def test_cameras_that_make_no_sense(model, options):
    with pytest.raises(infobyte.UsageError):
        model.render(**{"size": 16, **options})
    with pytest.raises(TypeError):
        model.png(16, colour="red")
    with pytest.raises(infobyte.UsageError, match="width is 0; it must be 1 to 32768"):
        model.render((0, 8))


def test_colours_and_magnification(model):
    plain, blue = (model.render(60, samples=1, **options) for options in (dict(), dict(color=(20, 40, 240))))
    seen = plain[..., 3] > 0
    assert np.array_equal(seen, blue[..., 3] > 0) and (blue[seen][:, 2] > blue[seen][:, 0]).all()
    near = model.render(60, samples=1, zoom=2, layers=["ids"])["ids"]
    assert np.array_equal(near, model.render(120, samples=1, layers=["ids"])["ids"][30:90, 30:90])
    for wrong in (dict(zoom=0), dict(color=(1, 2)), dict(color=(300, 0, 0))):
        with pytest.raises(infobyte.UsageError):
            model.render(16, **wrong)


def pixels(path):
    image = pytest.importorskip("PIL.Image")
    with image.open(path) as png:
        return np.asarray(png.convert("RGBA"))


def test_titles_legends_and_sections_are_those_of_the_command(tmp_path, oct):
    z, y, x = np.mgrid[:40, :44, :48]
    organs = np.where((x - 24) ** 2 + (y - 22) ** 2 + (z - 20) ** 2 < 300, np.where(x < 22, 7, 9), 0).astype(np.uint8)
    model = infobyte.build(organs, "organs.oct", labels="all", names={7: "liver", 9: "spleen"}, progress=False)
    size, flags = (200, 160), ["--size", "200x160"]
    for options, more in (
        (dict(title=True), ["--title"]),
        (dict(title="Two organs", background=(10, 20, 30)), ["--title=Two organs", "--background", "#0a141e"]),
        (dict(legend=True, annotate=True, view="left"), ["--legend", "--annotate", "--view", "left"]),
        (dict(section=("z", 18.5)), ["--section", "z=18.5"]),
        (dict(section=("x", 20), title=True, legend=True, annotate=True, zoom=1.5, background=(255, 255, 255)),
         ["--section", "x=20", "--title", "--legend", "--annotate", "--zoom", "1.5", "--background", "#ffffff"]),
    ):  # fmt: skip
        oct("render", "organs.oct", "-o", "want.png", *flags, *more)
        assert np.array_equal(model.render(size, **options), pixels("want.png")), options
    # What is read once does not need its file any more.
    kept = infobyte.open("organs.oct", mmap=False)
    wanted = model.render(96, section=("y", 22))
    (tmp_path / "organs.oct").write_bytes(b"")
    assert np.array_equal(kept.render(96, section=("y", 22)), wanted)


@pytest.mark.parametrize(
    "options",
    [dict(section=("z", 1e3)), dict(section=("w", 3)), dict(section="z=3"), dict(section=("z", float("nan"))),
     dict(section=("z", 12), view="left"), dict(section=("z", 12), lod=True), dict(section=("z", 12), layers=["ids"]),
     dict(title=True, layers=["ids"]), dict(legend=True), dict(section=("z", 12), legend=True), dict(title=5)],
)  # fmt: skip
def test_titles_legends_and_sections_that_make_no_sense(model, options):
    with pytest.raises(infobyte.UsageError):
        model.render(64, **options)


def test_turntables(model):
    frames = list(model.turntable(3, 32, view="left"))
    assert len(frames) == 3 and all(frame.shape == (32, 32, 4) for frame in frames)
    image = pytest.importorskip("PIL.Image")
    for name in ("a.gif", "a.png"):
        model.turntable(3, 32, output=name)
        assert image.open(name).n_frames in (1, 3)
    for wrong, said in (
        (dict(frames=0), "choose 1 or more"), (dict(fps=0), "fps=0 is not a rate"), (dict(view="tall"), "view='tall' is not 'front', "),
        (dict(output="a.mp4"), "a.mp4: is not named .gif or .png"), (dict(size=0), "size is 0|width is 0"),
    ):  # fmt: skip
        with pytest.raises(infobyte.UsageError, match=said):
            model.turntable(**wrong)


def test_rays_meet_the_ball_where_it_is(model):
    random = np.random.default_rng(7)
    out = random.normal(size=(1000, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    hits = model.first_hits(11.75 + 30 * out, -2 * out)
    assert hits.is_hit.all() and hits.t.shape == (1000,) and hits.position.shape == (1000, 3)
    assert np.abs(hits.t - 10).max() < 0.05
    assert (hits.normal * out).sum(axis=1).min() > 0.99
    assert (np.linalg.norm(model.centers()[hits.voxel] - hits.position, axis=1) < 0.5).all()
    away = model.first_hits(11.75 + 30 * out, out)
    assert np.isinf(away.t).all() and np.isnan(away.position).all() and np.isnan(away.normal).all()
    assert (away.voxel == -1).all() and not away.is_hit.any()


def test_rays_that_end_in_larger_leaves_are_hits(ball, tmp_path):
    model = infobyte.build(ball, tmp_path / "leaves.oct", iso=0, spacing=0.5, error=0.2)
    assert model.info["larger_leaves"]
    origins = np.stack(np.meshgrid(*[np.arange(9.0, 15.0, 0.5)] * 2, [-9.0]), -1).reshape(-1, 3)
    hits = model.first_hits(origins, [0, 0, 1])
    assert hits.is_hit.all() and (hits.voxel == -1).any()
    assert hits.is_hit.tolist() == model.any_hit(origins, [0, 0, 1]).tolist()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda model: model.render("512"), "size='512' is not a whole number"),
        (lambda model: model.render((64, 4.5)), r"size=\(64, 4.5\) is not a whole number or a pair of whole numbers"),
        (lambda model: model.render((-4, 8)), r"size=\(-4, 8\) is not a non-negative whole number"),
        (lambda model: model.render(opacity=0.3), "opacity=0.3 is not a dict of numbers; give for example"),
        (lambda model: model.render(clip={"z": 5}), "clip={'z': 5} is not a dict of pairs of numbers by 'x', 'y' or 'z'"),
        (lambda model: model.render(color=(1.0, 0.5, 0.2)), r"color=\(1.0, 0.5, 0.2\) is not three whole numbers; give .*255"),
        (lambda model: model.png(eye=5), "eye=5 is not three numbers"),
        (lambda model: model.view("tall"), "height='tall' is not a whole number"),
        (lambda model: model.export("a.stl", smooth="x"), "smooth='x' is not a number"),
        (lambda model: model.nearest("here"), "points='here' is not an array of numbers"),
        (lambda model: infobyte.compare(np.zeros((4, 4, 4)), model), r"actual is an array of shape \(4, 4, 4\), not a Model or a path"),
        (lambda model: infobyte.pack(model, 5), "output=5 is not a path"),
        (lambda model: infobyte.open(5), "path=5 is not a path"),
        (lambda model: infobyte.render_scene("a.toml", "a.png", size=5), "size=5 is not a pair of whole numbers"),
        (lambda model: model.to_mesh(triangles="2000"), "triangles='2000' is not a whole number"),
        (lambda model: model.first_hits([0, 0, 0], [0, 0, 1], threads=2.5), "threads=2.5 is not a whole number"),
        (lambda model: infobyte.pores(model, least=1.5), "least=1.5 is not a whole number"),
        (lambda model: infobyte.compare(model, model, tolerance="0.1"), "tolerance='0.1' is not a number or a pair of numbers"),
    ],
)
def test_numbers_of_the_wrong_type_are_named(model, call, said):
    with pytest.raises(TypeError, match=said):
        call(model)


def test_rays_are_broadcast(model):
    origins, directions = np.zeros((5, 1, 3)) + [11.75, 11.75, -9], np.array([[0, 0, 1], [0, 0, -1], [0, 0, 4]])
    hits = model.first_hits(origins, directions)
    assert hits.t.shape == hits.voxel.shape == (5, 3) and hits.normal.shape == (5, 3, 3)
    assert hits.is_hit.tolist() == [[True, False, True]] * 5
    assert hits.t[0, 0] == 4 * hits.t[0, 2]
    one = model.first_hits([11.75, 11.75, -9], [0, 0, 1])
    assert one.t.shape == () and one.t == hits.t[0, 0] and one.position.shape == (3,)
    assert model.first_hits(np.zeros((0, 3)), [0, 0, 1]).t.shape == (0,)
    assert model.any_hit(origins, directions).tolist() == hits.is_hit.tolist()
    assert not model.any_hit([11.75, 11.75, -9], [0, 0, 1], t_max=5)
    assert model.any_hit([11.75, 11.75, -9], [0, 0, 1], t_max=20)


def test_rays_that_make_no_sense(model):
    for origins, directions, sentence in [
        ([0, 0], [0, 0, 1], "three coordinates"),
        (np.zeros((2, 3)), np.ones((3, 3)), "broadcast"),
        ([0, 0, float("nan")], [0, 0, 1], "ray 0"),
        ([0, 0, 0], [0, 0, 0], "ray 0"),
    ]:
        with pytest.raises(infobyte.UsageError, match=sentence):
            model.first_hits(origins, directions)
    many = np.ones((50_000, 3))
    many[40_001] = many[49_000] = 0
    for threads in (1, 4):
        with pytest.raises(infobyte.UsageError, match="40001"):
            model.first_hits(np.zeros(3), many, threads=threads)


def test_threads_do_not_change_hits(model):
    random = np.random.default_rng(3)
    rays = random.normal(size=(2, 100_000, 3)) * 20
    wanted = model.first_hits(*rays, threads=1)
    found = [None] * 4

    def cast(i):
        found[i] = model.first_hits(*rays, threads=i + 1)

    threads = [threading.Thread(target=cast, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for hits in found:
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(hits, wanted))
    assert np.array_equal(model.any_hit(*rays), wanted.is_hit)


def test_no_ray_to_an_inside_voxel_misses(ball):
    model = infobyte.build(ball, "skin.oct", iso=0, progress=False)
    random = np.random.default_rng(5)
    inside = np.argwhere(ball >= 0)
    ends = inside[random.integers(len(inside), size=200_000)][:, ::-1].astype(float)
    starts = random.integers(-64, 112, size=ends.shape).astype(float)
    starts[:, 2] = -60
    assert model.any_hit(starts, ends - starts).all()


def test_voxels_are_those_of_the_array(ball):
    model = infobyte.build(ball, "skin.oct", iso=0, surface="skin", progress=False)
    # Inside, with a neighbour outside along an axis; the border of the array is outside.
    outside = np.pad(ball < 0, 1, constant_values=True)
    middle = slice(1, -1)
    beside = [slice(0, -2), slice(2, None)]
    near = np.zeros_like(ball, bool)
    for part in beside:
        near |= outside[part, middle, middle] | outside[middle, part, middle] | outside[middle, middle, part]
    wanted = np.argwhere(near & (ball >= 0))
    found = model.voxels()
    assert found.dtype == np.uint32 and np.array_equal(found[np.lexsort(found.T[::-1])], wanted)


def closed(faces):
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("surface", ["skin", "cells"])
def test_triangles_are_closed(ball, surface):
    model = infobyte.build(ball, "a.oct", iso=0, surface=surface, progress=False)
    mesh = model.to_mesh()
    assert mesh.vertices.dtype == mesh.vertex_normals.dtype == np.float32 and mesh.vertex_colors is None
    assert closed(mesh.faces) and mesh.faces.max() + 1 == len(mesh.vertices)
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) - 23.5 for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(4 / 3 * np.pi * 20**3, rel=0.01)
    # In memory two threads make them, in a file one.
    model.export("a.ply")
    head, body = open("a.ply", "rb").read().split(b"end_header\n")
    vertices = np.frombuffer(body, "<f4", 6 * len(mesh.vertices)).reshape(-1, 6)
    assert np.array_equal(vertices, np.hstack([mesh.vertices, mesh.vertex_normals]))
    faces = np.frombuffer(body, [("corners", "u1"), ("faces", "<u4", 3)], offset=vertices.nbytes)
    assert np.array_equal(faces["faces"], mesh.faces)
    within = model.export("b.ply", error="0.3mm")
    assert within["triangles"] < within["fine_triangles"] / 2 and within["fine_triangles"] == len(mesh.faces)
    fewer = model.to_mesh(triangles=1000)
    assert len(fewer.faces) == model.export("b.ply", triangles=1000)["triangles"] == 1000 and closed(fewer.faces)
    assert fewer.faces.max() + 1 == len(fewer.vertices) == len(fewer.vertex_normals)
    assert mesh.distance is None and 0 < fewer.distance < 1 and len(mesh) == 4
    for wrong, said in (
        (dict(output="b.ply", error="-1"), "bound"), (dict(output="b.stl", form="ply"), "b.stl: .* name it .ply"),
        (dict(output="b.html", triangles=9), "triangles is for"), (dict(output="b.nrrd", error=0.1), "error is for"),
        (dict(output="b.stl", form="step"), "form='step' is not 'stl', "),
    ):  # fmt: skip
        with pytest.raises(infobyte.UsageError, match=said):
            model.export(**wrong)
    with pytest.raises(infobyte.UsageError, match="give 1 or more"):
        model.to_mesh(triangles=0)
    with pytest.raises(ZeroDivisionError):
        infobyte.build(ball_of(256), "b.oct", iso=0, progress=False).to_mesh(progress=lambda *_: 1 / 0)


def test_a_notebook_has_the_page_in_a_frame(ball):
    model = infobyte.build(ball, 'a "quoted" & <b>.oct', iso=0, spacing=0.5, progress=False)
    model.export("page.html")
    frames = []

    class Frames(html.parser.HTMLParser):
        def handle_starttag(self, tag, attributes):
            frames.append((tag, dict(attributes)))

    view = model.view(300)
    assert view._repr_html_().isascii() and not view.html.isascii()
    Frames().feed(view._repr_html_())
    [(tag, frame)] = frames
    assert tag == "iframe" and frame["title"] == 'a "quoted" & <b>' and "height:300px" in frame["style"]
    # Neither the notebook's page nor its cookies, and no other page in its place.
    assert frame["sandbox"] == "allow-scripts allow-downloads"
    assert frame["srcdoc"] == view.html
    with open("page.html", encoding="utf-8") as file:
        written = file.read()
    assert view.html.replace('a &quot;quoted&quot; &amp; &lt;b&gt;', "page") == written
    assert "default-src 'none'" in view.html
    for height in (0, 20_000):
        with pytest.raises(infobyte.UsageError, match="height"):
            model.view(height)


def test_a_notebook_has_no_page_of_more_labels_than_it_holds():
    labels = np.arange(8 * 8 * 8, dtype="u2").reshape(8, 8, 8)
    model = infobyte.build(labels, "labels.oct", labels="all", progress=False)
    with pytest.raises(infobyte.UsageError, match="oct view"):
        model.view()


def test_packing(model):
    report = infobyte.pack(model, "p.oct")
    assert report["bytes"] < report["bytes_in"]
    packed = infobyte.open("p.oct")
    assert np.array_equal(packed.render(32), model.render(32))
    infobyte.unpack("p.oct", "u.oct")
    with open("u.oct", "rb") as ours, open(model.path, "rb") as theirs:
        assert ours.read() == theirs.read()


def test_damage_is_found(model):
    with open(model.path, "rb") as file:
        whole = bytearray(file.read())
    whole[len(whole) // 2] ^= 1
    with open("damaged.oct", "wb") as file:
        file.write(whole)
    with pytest.raises(infobyte.InputError):
        infobyte.verify("damaged.oct")


def test_scenes(model):
    with open("a.toml", "w") as file:
        file.write(f'[[model]]\nfile = "{model.path}"\n')
    report = infobyte.render_scene("a.toml", "a.png", size=(40, 30))
    assert (report["width"], report["height"]) == (40, 30) and os.path.getsize("a.png") > 100
    with open("a.toml", "w") as file:
        file.write("[[model]]\nfyle = 5\n")
    with pytest.raises(infobyte.InfobyteError, match="a.toml"):
        infobyte.render_scene("a.toml", "a.png")


#: Opens a model, changes its file, and uses it; prints what came of it.
CHANGED = """
import os, sys, infobyte
model = infobyte.open(sys.argv[1], mmap=sys.argv[2] == "True")
before = model.render(48).tobytes()
if sys.argv[3] == "cut":
    os.truncate(sys.argv[1], 5000)
else:
    with open(sys.argv[1], "r+b") as file:
        file.seek(9000)
        file.write(bytes(2000))
calls = [lambda: model.render(48), lambda: model.first_hits([11.75, 11.75, -9], [0, 0, 1]), lambda: model.any_hit([11.75, 11.75, -9], [0, 0, 1]),
         model.to_mesh, model.voxels, model.centers, model.measure, model._repr_png_, lambda: model.render(8, layers=["ids"])]
told = []
for call in calls:
    try:
        call()
        told.append("done")
    except infobyte.InputError as error:
        told.append("changed" if "was changed while it was in use" in str(error) else str(error))
if told[0] == "done":
    assert model.render(48).tobytes() == before
print(*sorted(set(told)))
"""


@pytest.mark.parametrize("how", ["cut", "overwritten"])
@pytest.mark.parametrize("mmap", [True, False])
def test_a_model_that_changes_while_it_is_open(model, mmap, how):
    done = subprocess.run([sys.executable, "-c", CHANGED, model.path, str(mmap), how], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, "changed" if mmap else "done"), done.stderr


#: Cuts a model short while calls read it; prints how many of them ended in an exception.
CUT = """
import os, shutil, sys, threading, infobyte
whole, path, changed = sys.argv[1], sys.argv[1] + ".cut", 0
for round in range(8):
    shutil.copy(whole, path)
    model = infobyte.open(path)
    os.posix_fadvise(os.open(path, os.O_RDONLY), 0, 0, os.POSIX_FADV_DONTNEED)
    timer = threading.Timer(0.002 * round, os.truncate, (path, 4096))
    timer.start()
    calls = [model.measure, model.voxels, model.to_mesh, lambda: model.render(512)]
    for call in calls * 40:
        try:
            call()
        except infobyte.InputError as error:
            assert "was changed while it was in use" in str(error), error
            changed += 1
            break
    timer.join()
print(changed)
"""


def test_a_model_that_is_cut_short_while_a_call_reads_it(tmp_path):
    z, y, x = np.mgrid[:200, :200, :200] - 99.5
    path = str(tmp_path / "large.oct")
    infobyte.build((90 - np.sqrt(x * x + y * y + z * z)).astype(np.float32), path, iso=0, progress=False)
    done = subprocess.run([sys.executable, "-c", CUT, path], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, "8"), done.stderr


def test_a_model_whose_name_is_replaced_stays_what_it_was(model, ball):
    before = model.render(48)
    infobyte.build(ball[:30], model.path, iso=0, progress=False)
    assert np.array_equal(model.render(48), before)
