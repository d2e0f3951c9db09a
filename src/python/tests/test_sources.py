"""Objects of other packages come with their place; each is skipped where its package is not installed."""

import pathlib
import sys

import numpy as np
import pytest

import infobyte
from conftest import bumps_of, content

SPACING, ORIGIN = (0.7, 0.9, 1.4), (-31.0, 12.5, 88.25)


def built(source, name="a.oct", **options):
    return infobyte.build(source, name, **{"iso": 500, "progress": False, **options})


def rotation():
    a, b = np.cos(0.4), np.sin(0.4)
    return np.array([[a, -b, 0], [b, a, 0], [0, 0, 1.0]])


def affine(direction=np.eye(3)):
    """From x, y, z to LPS mm."""
    return np.vstack([np.column_stack([direction * SPACING, ORIGIN]), [0, 0, 0, 1]])


def wanted(array, matrix):
    return content(built(array, "wanted.oct", affine=matrix).path)


def test_simpleitk(bumps):
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(bumps)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetDirection(rotation().ravel().tolist())
    model = built(image)
    assert np.allclose(model.affine, affine(rotation()), atol=1e-12)
    assert content(model.path) == wanted(bumps, affine(rotation()))
    # As the file that it writes.
    sitk.WriteImage(image, "a.nrrd")
    of_file = built("a.nrrd", "file.oct")
    assert np.allclose(of_file.affine, model.affine, atol=1e-6) and np.array_equal(of_file.voxels(), model.voxels())
    # SimpleITK's own places of voxels.
    for z, y, x in model.voxels()[::997].tolist():
        assert np.allclose(image.TransformIndexToPhysicalPoint((x, y, z)), model.affine[:3] @ [x, y, z, 1])
    with pytest.raises(infobyte.UsageError, match="three dimensions"):
        built(sitk.GetImageFromArray(bumps[0]))


def test_nibabel(bumps):
    nibabel = pytest.importorskip("nibabel")
    flip = np.diag([-1.0, -1.0, 1.0, 1.0])
    image = nibabel.Nifti1Image(bumps.transpose(2, 1, 0), flip @ affine(rotation()))
    model = built(image)
    assert content(model.path) == wanted(bumps, affine(rotation()))
    image.header.set_slope_inter(2, -10)
    for name in ("a.nii", "a.nii.gz"):
        nibabel.save(image, name)
        loaded, of_file = built(nibabel.load(name), "b.oct"), built(name, "file.oct")
        assert np.allclose(loaded.affine, of_file.affine, atol=1e-4)
        assert np.array_equal(loaded.voxels(), of_file.voxels()) and loaded.info["range"] == of_file.info["range"]
    big = nibabel.Nifti1Image(bumps.transpose(2, 1, 0).astype(">i2"), flip @ affine())
    assert content(built(big, "b.oct").path) == wanted(bumps, affine())
    with pytest.raises(infobyte.UsageError, match="4 dimensions"):
        built(nibabel.Nifti1Image(np.zeros((4, 4, 4, 2), np.int16), np.eye(4)))


def test_dask(bumps):
    dask = pytest.importorskip("dask.array")
    for chunks in ((7, 41, 53), (30, 20, 20), (1, 1, 53)):
        assert content(built(dask.from_array(bumps, chunks), spacing=SPACING[::-1], origin=ORIGIN).path) == wanted(bumps, affine())
    turned = dask.from_array(bumps.transpose(2, 1, 0), (20, 20, 9))
    assert content(built(turned, axes="xyz", spacing=SPACING, origin=ORIGIN).path) == wanted(bumps, affine())


def test_zarr(bumps):
    zarr = pytest.importorskip("zarr")
    array = zarr.open("a.zarr", mode="w", shape=bumps.shape, chunks=(8, 16, 16), dtype=bumps.dtype)
    array[:] = bumps
    assert content(built(array, spacing=SPACING[::-1], origin=ORIGIN).path) == wanted(bumps, affine())


def test_zarr_by_path(bumps):
    """The reader of the library, which holds no whole chunk, against arrays that zarr wrote."""
    zarr = pytest.importorskip("zarr", minversion="3")
    import numcodecs
    from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ZstdCodec

    two = [None, numcodecs.GZip(), numcodecs.Zlib(), numcodecs.LZ4(), numcodecs.Zstd()]
    two += [numcodecs.Blosc(name, 5, way) for name in ("blosclz", "lz4", "lz4hc", "zlib", "zstd") for way in (0, 1, 2)]
    three = [{"compressors": packed} for packed in (None, GzipCodec(), ZstdCodec(), BloscCodec(), [ZstdCodec(), Crc32cCodec()])]
    three += [{"shards": (16, 32, 32), "compressors": ZstdCodec()}, {"serializer": BytesCodec(endian="big"), "compressors": None}]
    ways = [{"zarr_format": 2, "compressors": packed} for packed in two] + [{"zarr_format": 3, **way} for way in three]
    reference = wanted(bumps, np.eye(4))
    for number, way in enumerate(ways):
        array = zarr.create_array(f"{number}.zarr", shape=bumps.shape, chunks=(8, 16, 16), dtype=bumps.dtype, **way)
        array[:] = bumps
        assert content(built(f"{number}.zarr").path) == reference, way


def test_h5py(bumps):
    h5py = pytest.importorskip("h5py")
    with h5py.File("a.h5", "w") as file:
        data = file.create_dataset("volume", data=bumps, chunks=(8, 16, 16), compression="gzip")
        assert content(built(data, spacing=SPACING[::-1], origin=ORIGIN).path) == wanted(bumps, affine())


def test_xarray(bumps):
    xarray = pytest.importorskip("xarray")
    along = {axis: ORIGIN[i] + SPACING[i] * np.arange(bumps.shape[2 - i]) for i, axis in enumerate("xyz")}
    array = xarray.DataArray(bumps, dims=("z", "y", "x"), coords=along)
    for source in (array, array.transpose("x", "z", "y")):
        model = built(source)
        assert np.allclose(model.affine, affine()) and np.array_equal(model.voxels(), built(bumps, "b.oct").voxels())
    along["y"] = along["y"] ** 2
    with pytest.raises(infobyte.UsageError, match="evenly"):
        built(array.assign_coords(y=along["y"]))


def test_pyvista(bumps):
    pyvista = pytest.importorskip("pyvista")
    grid = pyvista.ImageData(dimensions=bumps.shape[::-1], spacing=SPACING, origin=ORIGIN)
    grid.point_data["values"] = bumps.ravel()
    assert content(built(grid).path) == wanted(bumps, affine())
    cells = pyvista.ImageData(dimensions=[side + 1 for side in bumps.shape[::-1]], spacing=SPACING, origin=np.subtract(ORIGIN, SPACING) + np.array(SPACING) / 2)
    cells.cell_data["values"] = bumps.ravel()
    assert np.allclose(built(cells).affine, affine())
    model = built(bumps, "c.oct", surface="cells")
    mesh = model.to_pyvista()
    assert mesh.n_points == len(model.to_mesh().vertices) and mesh.is_manifold and "Normals" in mesh.point_data
    assert mesh.active_scalars_name is None and mesh.active_normals is not None
    assert model.to_pyvista(triangles=100).n_cells == 100
    again = infobyte.build(mesh, "d.oct", voxel=1, progress=False)
    assert abs(len(again.voxels()) / len(built(bumps, "e.oct")) - 1) < 0.1
    assert mesh.volume == pytest.approx((bumps >= 500).sum(), rel=0.05)


def test_trimesh(model):
    trimesh = pytest.importorskip("trimesh")
    mesh = model.to_trimesh()
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 10**3, rel=0.005)
    assert np.allclose(mesh.vertex_normals, model.to_mesh().vertex_normals)
    few = model.to_trimesh(triangles=100)
    assert few.is_watertight and len(few.faces) == 100
    box = trimesh.creation.box((4, 6, 8))
    solid = infobyte.build(box, "box.oct", voxel=0.5, progress=False)
    assert solid.info["spacing_mm"] == [0.5] * 3
    extent = solid.centers().max(axis=0) - solid.centers().min(axis=0) + 0.5
    assert np.allclose(extent, [4, 6, 8], atol=0.51)


def test_rays_of_trimesh_meet_the_same_surface(model):
    pytest.importorskip("trimesh")
    pytest.importorskip("rtree")
    mesh = model.to_trimesh()
    random = np.random.default_rng(1)
    out = random.normal(size=(20, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    hits = model.first_hits(11.75 + 30 * out, -out)
    places, rays, _ = mesh.ray.intersects_location(11.75 + 30 * out, -out, multiple_hits=False)
    assert np.allclose(places[np.argsort(rays)], hits.position, atol=0.05)


def test_nothing_of_other_packages_is_imported():
    import subprocess

    code = "import sys, numpy; a = set(sys.modules); import infobyte; print(*sorted({m.partition('.')[0] for m in set(sys.modules) - a} - set(sys.stdlib_module_names)))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["infobyte"]


def test_a_mesh_may_have_y_up():
    corners = np.array([[0, 0, 0], [10, 2, 1], [1, 30, 3], [2, 4, 15]], float)
    for name, points in {"lying": corners, "standing": corners[:, [0, 2, 1]] * [1, -1, 1]}.items():
        lines = [f"v {x} {y} {z}\n" for x, y, z in points] + [f"f {f}\n" for f in ("1 3 2", "1 2 4", "1 4 3", "2 3 4")]
        pathlib.Path(f"{name}.obj").write_text("".join(lines))
    set_up = infobyte.build("lying.obj", "a.oct", up="y", grid=60, progress=False)
    assert content(set_up.path) == content(infobyte.build("standing.obj", "b.oct", grid=60, progress=False).path)
    with pytest.raises(infobyte.UsageError, match="up"):
        infobyte.build("lying.obj", "c.oct", up="x", grid=60, progress=False)
