"""Open models: pictures, rays, voxels, triangles."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Unpack, overload

import numpy as np

from . import _infobyte
from ._check import checked, dumps
from ._errors import UsageError
from ._progress import bar

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._types import (
        Axis, Colors, Form, Label, Layer, Opacity, Path, Picture, Progress, Projection, Samples, Shading, View as NamedView
    )  # fmt: skip


class Hits(NamedTuple):
    """First hits of rays: arrays whose shape is that of the rays, `S`, with three numbers more where these are a place.

    >>> hits = model.first_hits([11.75, 11.75, -50], [0, 0, 1])
    >>> hits.is_hit.item(), round(hits.t.item(), 1)
    (True, 51.8)
    """

    t: NDArray[np.float64]
    """`S`: the place of the hit as a multiple of the direction; infinity where nothing is met."""
    position: NDArray[np.float64]
    """`S` x 3: x, y, z in LPS mm; NaN where nothing is met."""
    normal: NDArray[np.float64]
    """`S` x 3: unit vector out of the surface, in LPS; NaN where nothing is met, or the model has no normals."""
    voxel: NDArray[np.int64]
    """`S`: the number of the voxel or cell, its row in `Model.voxels()`; -1 in a larger leaf, and where nothing is met."""

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """`S`: does the ray meet the model?"""
        return np.isfinite(self.t)


class Nearest(NamedTuple):
    """Nearest points of a surface: arrays whose shape is that of the points, `S`, with three numbers more for places.

    >>> found = model.nearest([11.75, 11.75, -10])
    >>> round(found.distance.item(), 1), found.side.item()
    (11.8, 1)
    """

    distance: NDArray[np.float64]
    """`S`: distance in mm, positive outside, negative inside."""
    position: NDArray[np.float64]
    """`S` x 3: the nearest point, x, y, z in LPS mm."""
    normal: NDArray[np.float64]
    """`S` x 3: unit vector out of the surface there, in LPS."""
    side: NDArray[np.int8]
    """`S`: 1 outside, -1 inside, 0 on the surface."""
    cell: NDArray[np.int64]
    """`S`: the number of the cell, its row in `Model.voxels()`; -1 in a larger leaf."""


class _Triangles(NamedTuple):
    vertices: NDArray[np.float32]
    """N x 3: corners, x, y, z in mm."""
    faces: NDArray[np.uint32]
    """M x 3: rows of `vertices`, anticlockwise as seen from outside."""
    vertex_normals: NDArray[np.float32] | None
    """N x 3: unit vectors out of the surface; `None` for a model without normals."""
    vertex_colors: NDArray[np.uint8] | None
    """N x 3: sRGB; `None` for a model without colours."""


class Mesh(_Triangles):
    """A closed surface as triangles, in LPS mm; a tuple of four, for `vertices, faces, normals, colors = mesh`.

    >>> mesh = model.to_mesh()
    >>> mesh.vertices.dtype, mesh.faces.dtype, mesh.vertex_normals is not None
    (dtype('float32'), dtype('uint32'), True)
    """

    distance: float | None = None
    """Greatest distance in mm between these triangles and all of them, as measured; `None` where all are here."""

    def to_trimesh(self) -> Any:
        """A `trimesh.Trimesh` of the same corners and faces. Needs trimesh."""
        import trimesh

        return trimesh.Trimesh(
            self.vertices, self.faces, vertex_normals=self.vertex_normals, vertex_colors=self.vertex_colors, process=False
        )

    def to_pyvista(self) -> Any:
        """A `pyvista.PolyData`, with the arrays `Normals` and `Colors` where the model has them. Needs pyvista."""
        import pyvista

        faces = np.empty((len(self.faces), 4), np.int64)
        faces[:, 0], faces[:, 1:] = 3, self.faces
        mesh = pyvista.PolyData(self.vertices, faces.ravel())
        if self.vertex_normals is not None:
            mesh.point_data["Normals"] = self.vertex_normals
            mesh.point_data.active_normals_name = "Normals"
        if self.vertex_colors is not None:
            mesh.point_data["Colors"] = self.vertex_colors
        # Otherwise a plot is coloured by the last array.
        mesh.set_active_scalars(None)
        return mesh


class View:
    """A page in a frame, which a cell of a notebook shows; `html` is the page."""

    __slots__ = ("html", "_title", "_height")

    def __init__(self, html: str, title: str, height: int) -> None:
        self.html, self._title, self._height = html, title, height

    def __repr__(self) -> str:
        return f"<infobyte.Model.view of {self._title}: {len(self.html)} bytes>"

    def _repr_html_(self) -> str:
        def attribute(text: str) -> str:
            return text.replace("&", "&amp;").replace('"', "&quot;")

        # Scripts of the page, but neither the notebook's page nor a network.
        return (
            f'<iframe title="{attribute(self._title)}" sandbox="allow-scripts allow-downloads" '
            f'style="width:100%;height:{self._height}px;border:0" srcdoc="{attribute(self.html)}"></iframe>'
        ).encode("ascii", "xmlcharrefreplace").decode()  # in a page of any encoding


class Model:
    """An open model. Every method may be called from several threads at a time.

    A mapped file (the default of `open`) that was changed after it was opened gives an `InputError`, not a wrong picture;
    changed or cut short *while* a call reads it, it gives one at the end of the call. Open with `mmap=False` what should
    stay usable whatever becomes of its file; `view`, `export`, `pores`, `thickness` and `compare` read the file itself.
    """

    __slots__ = ("_handle", "_report", "_args")

    @checked
    def __init__(self, path: Path, *, mmap: bool = True) -> None:
        self._args = (os.fspath(path), bool(mmap))
        self._handle = _infobyte.Handle(*self._args)
        self._report: dict[str, Any] | None = None

    @classmethod
    def _built(cls, path: str, report: str) -> Model:
        model = cls(path)
        model._report = loads(report)
        return model

    def __reduce__(self) -> Any:
        return (_opened, self._args)

    def __repr__(self) -> str:
        kind = "cells" if self._handle.is_cells else "skin voxels"
        z, y, x = self.shape
        larger = self.info.get("larger_leaves", {}).get("leaves", 0)
        kind += f" and {larger} larger leaves" if larger else ""
        return f"<infobyte.Model {os.path.basename(self._args[0])}: {len(self)} {kind} of {z} x {y} x {x}>"

    def __len__(self) -> int:
        """Voxels, or cells, of the surface."""
        return len(self._handle)

    def __bool__(self) -> bool:
        return True

    @property
    def path(self) -> str:
        """The file that the model was opened from."""
        return self._args[0]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Sides of the volume in voxels, in the order of an array's axes: z, y, x."""
        x, y, z = self._handle.dims
        return z, y, x

    @property
    def affine(self) -> NDArray[np.float64]:
        """4 x 4: from the index (x, y, z) of a sample to x, y, z in LPS mm."""
        return np.array([*self._handle.affine, [0.0, 0.0, 0.0, 1.0]])

    @property
    def info(self) -> dict[str, Any]:
        """What the file says of itself: the keys of `oct info`. Costs one small read."""
        return loads(self._handle.info(False))

    def measure(self) -> dict[str, Any]:
        """`info` with area in mm2, volume in mm3 and extents of the surface. Costs one pass over the model."""
        return loads(self._handle.info(True))

    @property
    def report(self) -> dict[str, Any] | None:
        """Figures of the build (the keys of `oct build`), if this model comes from `build`; otherwise `None`."""
        return self._report

    @overload
    def render(
        self, size: int | tuple[int, int] = 512, *, progress: Progress = False, **options: Unpack[Picture]
    ) -> NDArray[np.uint8]: ...
    @overload
    def render(
        self,
        size: int | tuple[int, int] = 512,
        *,
        layers: Sequence[Layer],
        progress: Progress = False,
        **options: Unpack[Picture],
    ) -> dict[str, NDArray[Any]]: ...
    @checked
    def render(
        self,
        size: int | tuple[int, int] = 512,
        *,
        view: NamedView | None = None,
        eye: Sequence[float] | None = None,
        look_at: Sequence[float] | None = None,
        up: Sequence[float] | None = None,
        turned: float | None = None,
        projection: Projection = "parallel",
        fov: float | None = None,
        zoom: float = 1.0,
        color: Sequence[int] | None = None,
        shading: Shading | None = None,
        colors: Colors | None = None,
        range: tuple[float, float] | None = None,
        blended: bool = False,
        samples: Samples = "auto",
        ao_rays: int | None = None,
        lod: bool = False,
        smooth_edges: bool = False,
        annotate: bool = False,
        title: str | bool = False,
        legend: bool = False,
        clip: Mapping[Axis, tuple[float | None, float | None]] | None = None,
        only: Label | Sequence[Label] | None = None,
        hide: Label | Sequence[Label] = (),
        opacity: Opacity | None = None,
        section: tuple[Axis, float] | None = None,
        background: Sequence[int] | None = None,
        layers: Sequence[Layer] = (),
        threads: int | None = None,
        progress: Progress = False,
    ) -> NDArray[np.uint8] | dict[str, NDArray[Any]]:
        """A picture as an array of H x W x 4: sRGB and alpha, rows from the top.

        `size`: side in pixels, or (width, height). `view`: `front` (the default), `back`, `left`, `right`, `top`, `bottom`
        or `iso`, of a patient in LPS; or `eye`, `look_at` and `up`, in LPS mm. `turned`: degrees about the z axis from
        `view`. `projection`: `parallel` or `perspective`, of `fov` degrees (35) from bottom to top. `zoom`:
        magnification about the middle. `color`: sRGB as whole numbers from 0 to 255, of a model without colours. `shading`: `soft` (the default), a key lamp, a lamp at the eye and the sky; `flat`, colours as they are (the default for measured values); `plain`, a lamp at the eye; `ao`, that one and ambient occlusion;
        `stored` or `blended`, plain light by the normals as they are stored or blended between voxels. `blended`: the same
        in any light. `ao_rays`: rays a pixel that look around, 1 for `soft` and 4 for `ao` by default. `samples`: `auto`,
        eight rays where neighbours differ in depth or normal, or 1, 4, 16, 64. `smooth_edges` makes 1 `auto`. `lod`: boxes
        about as small as a pixel, faster. `background`: sRGB from 0 to 255; otherwise it is transparent.

        `colors`: the map of measured values, `auto`, `diverging` or `sequential`, from the lowest to the highest value of
        `range`; by default those of the quantity.

        `annotate`: a scale bar, and a cube with the patient's sides or the axes, below. `title`: a text above, or `True` for the file's
        name and the size of what is visible, before cuts. `legend`: on the right, colours and names of the labels that are seen, or
        the colours of measured values.

        `clip`: bounds along axes in LPS mm, such as `{'z': (None, 40)}`; the outside is cut away, and cut faces of closed
        models are red. `only` and `hide`: the labels that are shown and not shown, by number, range or name, such as
        `[5, '7..20', 'liver']`. `opacity`: the fraction of light that labels block, such as `{'all': 0.3}`; the last one
        that matches a label counts.

        `section`: a slice instead of a view, filled and in true scale: an axis and a place along it in LPS mm, such as
        `('z', 40)`. It goes with `size`, `zoom`, `color`, `annotate`, `title`, `legend`, `clip`, `only`, `hide`, `opacity`,
        `background` and `threads`.

        `layers`: any of `depth`, `position`, `normals`, `ids`. The result is a dict then, with the picture as `color`, and
        `depth`: H x W float64, mm along the line of sight, infinity where nothing is hit; `position`, `normals`: H x W x 3
        float64, LPS mm and unit vectors, NaN where nothing is hit; `ids`: H x W int64, rows of `voxels()`, -1 in larger leaves and where nothing is hit. They are of
        exact voxels of the whole model through the middle of each pixel, whatever `lod`, `clip` and the labels say.

        `progress` as in `build`. Ctrl-C stops a picture, as it stops rays, builds, exports and measurements.

        Raises `UsageError` for a camera that makes no sense, a plane that misses the model, a legend of a model without
        labels, or layers with a title, a legend or a section; `InputError` if the file was changed.

        >>> model.render(64, view='iso').shape
        (64, 64, 4)
        >>> layers = model.render((60, 40), layers=['depth', 'ids'])
        >>> layers['depth'].shape, bool((layers['ids'] >= 0).any())
        ((40, 60), True)
        >>> model.render((90, 60), section=('z', 12), title=True).shape
        (60, 90, 4)
        """
        names = ("depth", "position", "normal", "voxel")
        wanted = {"depth": "depth", "position": "position", "normals": "normal", "ids": "voxel"}
        asked, (width, height) = _asked(
            size, view=view, eye=eye, look_at=look_at, up=up, turned=turned, projection=projection, fov=fov,
            zoom=zoom, color=color, shading=shading, colors=colors, range=range, blended=blended, samples=samples, ao_rays=ao_rays, lod=lod, smooth_edges=smooth_edges,
            annotate=annotate, title=title, legend=legend, clip=clip, only=only, hide=hide, opacity=opacity, section=section, background=background,
            threads=threads,
        )
        if layers and (title or legend or section is not None):
            raise UsageError("layers are of a picture without title, legend and section; make two pictures")
        with bar(progress) as told:
            color = self._handle.render(asked, told).reshape(height, width, 4)
        if not layers:
            return color
        found = dict(zip(names, self._handle.cast(asked)))
        made: dict[str, NDArray[Any]] = {"color": color}
        for layer in layers:
            array = found[wanted[layer]]
            made[layer] = array.reshape(height, width, *((3,) if array.size == 3 * height * width else ()))
        return made

    @checked
    def png(self, size: int | tuple[int, int] = 512, **options: Unpack[Picture]) -> bytes:
        """The picture of `render` as the bytes of a PNG; options as there, without `layers`."""
        return self._handle.png(_asked(size, **options)[0])

    def _repr_png_(self) -> bytes:
        """The model in a cell of a notebook."""
        return self.png(384, view="iso")

    @checked
    def view(self, height: int = 480, *, only: Label | Sequence[Label] | None = None) -> View:
        """The model in a cell of a notebook, to be turned, cut, picked and measured there.

        It is the page of `export('model.html')` in a frame `height` pixels high, which needs no server and no network; the
        notebook keeps it, at about the size of the model's file. `only`: the labels to show, by number, range or name.
        `display(model.view())` shows it within a cell, and `model.view().html` is the page as text.

        Raises `UsageError` for a model that a page does not hold, of more than 400 MiB or 255 labels; the command `oct view`
        shows those.

        >>> len(model.view(300).html) > 100_000
        True
        """
        if not 50 <= height <= 10_000:
            raise UsageError(f"height={height} makes no sense; choose 50 to 10000 pixels")
        import tempfile

        title = os.path.splitext(os.path.basename(self.path))[0]
        with tempfile.TemporaryDirectory(prefix="infobyte-") as folder:
            # The title is that of the file.
            page = os.path.join(folder, f"{title}.html")
            self.export(page, "html", only=only)
            with open(page, encoding="utf-8") as file:
                return View(file.read(), title, int(height))

    @overload
    def turntable(
        self,
        frames: int = 36,
        size: int | tuple[int, int] = 384,
        *,
        output: None = None,
        fps: float = 18.0,
        **options: Unpack[Picture],
    ) -> Iterator[NDArray[np.uint8]]: ...
    @overload
    def turntable(
        self,
        frames: int = 36,
        size: int | tuple[int, int] = 384,
        *,
        output: Path,
        fps: float = 18.0,
        **options: Unpack[Picture],
    ) -> None: ...
    @checked
    def turntable(
        self,
        frames: int = 36,
        size: int | tuple[int, int] = 384,
        *,
        output: Path | None = None,
        fps: float = 18.0,
        **options: Unpack[Picture],
    ) -> Iterator[NDArray[np.uint8]] | None:
        """Pictures all around the model: an iterator of H x W x 4 arrays, for encoders of MP4 and others.

        With `output`, `.gif` or `.png` (animated; no other file), it writes them at `fps` frames a second instead; needs Pillow. Options
        as those of `render`; GIFs have a white background unless another one is given.

        >>> [frame.shape for frame in model.turntable(2, 16)]
        [(16, 16, 4), (16, 16, 4)]
        """
        if frames < 1:
            raise UsageError(f"frames={frames} is not a number of pictures; choose 1 or more")
        if fps <= 0:
            raise UsageError(f"fps={fps} is not a rate; give a number above 0")
        _asked(size, **options)  # refused before the first picture
        if output is None:
            return self._turn(frames, size, options)
        target = os.fspath(output)
        if not target.lower().endswith((".gif", ".png")):
            raise UsageError(f"{target}: is not named .gif or .png; without output, turntable gives its frames to an encoder of others")
        from PIL import Image

        if target.lower().endswith(".gif"):
            options.setdefault("background", (255, 255, 255))
        pictures = [Image.fromarray(frame) for frame in self._turn(frames, size, options)]
        if target.lower().endswith(".gif"):
            pictures = [picture.convert("RGB") for picture in pictures]
        pictures[0].save(target, save_all=True, append_images=pictures[1:], duration=1000 / fps, loop=0)
        return None

    def _turn(self, frames: int, size: int | tuple[int, int], options: Picture) -> Iterator[NDArray[np.uint8]]:
        for frame in range(frames):
            yield self.render(size, turned=360.0 * frame / frames, **options)

    @checked
    def first_hits(self, origins: ArrayLike, directions: ArrayLike, *, threads: int | None = None) -> Hits:
        """The first hits of rays, exactly: no ray slips between voxels that share a face or an edge.

        A ray that starts inside the solid ends where it enters the first cell of the surface, up to a cell (or larger leaf)
        before the surface; `nearest` and `infobyte.thickness` measure from inside.

        `origins` and `directions`: ... x 3, x, y, z in LPS mm, broadcast against each other; directions of any length.
        `threads`: all cores by default; the hits do not depend on it.

        Raises `UsageError` for a ray that is not finite or has no direction, with its number.

        >>> rays = np.zeros((4, 1, 3)), [[0, 0, 1], [0, 0, -1]]
        >>> model.first_hits(*rays).t.shape
        (4, 2)
        """
        origins, directions, shape = _rays(origins, directions)
        t, position, normal, voxel = self._handle.first_hits(origins, directions, _threads(threads))
        places = (*shape, 3)
        return Hits(t.reshape(shape), position.reshape(places), normal.reshape(places), voxel.reshape(shape))

    @checked
    def any_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        t_max: float = float("inf"),
        threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Do rays meet anything at `t` of at most `t_max`, a multiple of the direction? Otherwise as `first_hits`.

        >>> bool(model.any_hit([11.75, 11.75, -50], [0, 0, 1], t_max=10))
        False
        """
        origins, directions, shape = _rays(origins, directions)
        return self._handle.any_hit(origins, directions, float(t_max), _threads(threads)).reshape(shape)

    @checked
    def nearest(self, points: ArrayLike, *, threads: int | None = None) -> Nearest:
        """The nearest point of the surface to each of some points, with its signed distance.

        `points`: ... x 3, x, y, z in LPS mm. `threads`: all cores by default; the answers do not depend on it. A point near
        the surface costs a microsecond or two, others more in proportion to their distance in cells.

        Raises `UsageError` for a point that is not finite, with its number; `InputError` for a model that is a skin of
        voxels, has labels, or axes that are not at right angles.

        >>> model.nearest(np.zeros((4, 2, 3))).position.shape
        (4, 2, 3)
        """
        array = np.asarray(points, np.float64)
        if array.ndim == 0 or array.shape[-1] != 3:
            raise UsageError("points have three coordinates each: their last axis is x, y, z")
        flat = np.ascontiguousarray(array).reshape(-1)
        distance, position, normal, side, cell = self._handle.nearest(flat, _threads(threads))
        shape, places = array.shape[:-1], array.shape
        return Nearest(
            distance.reshape(shape), position.reshape(places), normal.reshape(places), side.reshape(shape), cell.reshape(shape)
        )

    @checked
    def to_mesh(
        self, *, triangles: int | None = None, only: Label | Sequence[Label] | None = None, progress: Progress = False
    ) -> Mesh:
        """The surface as triangles: closed, no edge of more than two.

        Of cells it is true below the voxel; of skin voxels it runs half-way between samples. `triangles`: at most so many,
        as `oct export --triangles`, but no fewer than 4 for a closed body or label; `Mesh.distance` says how far these are
        from all of them. `only`: numbers, ranges or names of labels;
        instead of the outside of all labels, the closed surface of each of these in its colour, one after the other, with
        walls between neighbours. `progress` as in `build`.

        Raises `UsageError` for a model that keeps only what can be seen.
        """
        _refuse_no_triangles(triangles)
        with bar(progress) as told:
            arrays = self._handle.triangles(triangles, _labels(only), told)
        distance = next(iter(arrays.pop("distance").tolist()), None)
        three = {name: array.reshape(-1, 3) for name, array in arrays.items()}
        optional = [three[name] if len(three[name]) else None for name in ("normals", "colors")]
        mesh = Mesh(three["vertices"], three["faces"], *optional)
        mesh.distance = distance
        return mesh

    def to_trimesh(
        self, *, triangles: int | None = None, only: Label | Sequence[Label] | None = None, progress: Progress = False
    ) -> Any:
        """`to_mesh` as a `trimesh.Trimesh`, in LPS mm."""
        return self.to_mesh(triangles=triangles, only=only, progress=progress).to_trimesh()

    def to_pyvista(
        self, *, triangles: int | None = None, only: Label | Sequence[Label] | None = None, progress: Progress = False
    ) -> Any:
        """`to_mesh` as a `pyvista.PolyData`, in LPS mm."""
        return self.to_mesh(triangles=triangles, only=only, progress=progress).to_pyvista()

    def voxels(self) -> NDArray[np.uint32]:
        """N x 3: indices (z, y, x) of the voxels or cells of the surface; `array[tuple(model.voxels().T)]` are the samples
        of skin voxels.

        Row i is voxel i of `Hits.voxel`. Of cells: cell i lies between samples i - 1 and i.

        >>> skin = infobyte.build(ball, 'skin.oct', iso=0, surface='skin')
        >>> bool((ball[tuple(skin.voxels().T)] >= 0).all())
        True
        """
        return self._handle.stored("index").reshape(-1, 3)[:, ::-1]

    def centers(self) -> NDArray[np.float64]:
        """N x 3: middles of the voxels or cells, x, y, z in LPS mm; rows as those of `voxels`."""
        return self._handle.stored("center").reshape(-1, 3)

    def normals(self) -> NDArray[np.float64]:
        """N x 3: unit vectors out of the surface, in LPS; NaN without normals; rows as those of `voxels`."""
        return self._handle.stored("normal").reshape(-1, 3)

    def values(self) -> NDArray[np.float64]:
        """N: physical values of the voxels, of models with the channel `value`, otherwise NaN; rows as those of `voxels`."""
        return self._handle.stored("value")

    def colors(self) -> NDArray[np.uint8]:
        """N x 3: sRGB of the voxels, of models with the channel `color`, otherwise 0; rows as those of `voxels`."""
        return self._handle.stored("color").reshape(-1, 3)

    def labels(self) -> NDArray[np.uint16]:
        """N: number of the greatest label of each cell, of models built with `labels`, otherwise 0; rows as those of `voxels`.

        `info['labels']` has their names, colours and voxels.
        """
        return self._handle.stored("label")

    @checked
    def export(
        self,
        output: Path,
        form: Form | None = None,
        *,
        error: float | str | None = None,
        triangles: int | None = None,
        only: Label | Sequence[Label] | None = None,
        smooth: float | None = None,
        progress: Progress = False,
    ) -> dict[str, Any]:
        """Writes triangles, points, a mask or a page to a file, as `oct export`: `form` by the name of the file, or as given.

        `error`: leaves out corners of triangles while the surface stays so close to the full one, in voxels (`0.1`) or as
        `'0.05mm'`; `triangles`: makes at most so many, with `error` whichever comes first. Of a model of labels
        triangles have a part for each label, or for those in `only`, by number, range or name; `smooth` as `oct export
        --smooth`. `progress` as in `build`.
        """
        _refuse_no_triangles(triangles)
        within = None if error is None else str(error)
        with bar(progress) as told:
            files, labels = (self.path, os.fspath(output)), (_labels(only), smooth)
            return loads(_infobyte.export(files, form, (within, triangles), labels, told))

    def verify(self) -> dict[str, Any]:
        """Checks every byte of the file; the keys of `oct verify`. Raises `InputError` with the first rule broken."""
        return loads(_infobyte.verify(self.path))


def _refuse_no_triangles(count: int | None) -> None:
    if count is not None and count < 1:
        raise UsageError(f"triangles is {count}; give 1 or more")


def _labels(labels: Label | Sequence[Label] | None) -> list[str] | None:
    if isinstance(labels, str):
        return [label.strip() for label in labels.split(",")]
    return None if labels is None else [str(label) for label in ([labels] if isinstance(labels, int) else labels)]


def bytes_of(memory: int | str) -> int:
    """Bytes of a size, as a number or such as `8MiB`."""
    return _infobyte.size(memory if isinstance(memory, str) else str(int(memory)))


def loads(text: str) -> dict[str, Any]:
    """The keys of a report."""
    import json  # 2 ms, for those who need it

    return json.loads(text)


def _opened(path: str, mmap: bool) -> Model:
    return Model(path, mmap=mmap)


def _threads(threads: int | None) -> int:
    if threads is not None and not 1 <= threads <= 1024:
        raise UsageError(f"threads={threads} makes no sense; choose 1 to 1024")
    return int(threads) if threads else len(os.sched_getaffinity(0))


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Any, Any, tuple[int, ...]]:
    both = [np.asarray(rays, np.float64) for rays in (origins, directions)]
    if any(rays.ndim == 0 or rays.shape[-1] != 3 for rays in both):
        raise UsageError("origins and directions have three coordinates each: their last axis is x, y, z")
    try:
        shape = np.broadcast_shapes(*(rays.shape for rays in both))
    except ValueError:
        shapes = " and ".join(str(rays.shape) for rays in both)
        raise UsageError(f"origins and directions of {shapes} cannot be broadcast against each other") from None
    flat = [np.ascontiguousarray(np.broadcast_to(rays, shape)).reshape(-1) for rays in both]
    return flat[0], flat[1], shape[:-1]


def _asked(size: int | tuple[int, int], **options: Any) -> tuple[str, tuple[int, int]]:
    """The request of a picture, and its sides."""
    width, height = (size, size) if np.ndim(size) == 0 else size
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= 32768:
            raise UsageError(f"{name} is {side}; it must be 1 to 32768")
    usual = Model.render.__wrapped__.__kwdefaults__.copy()  # type: ignore[attr-defined]
    del usual["layers"], usual["progress"]
    _threads(options.get("threads"))
    unknown = options.keys() - usual.keys()
    if unknown:
        raise TypeError(f"unexpected option of a picture: {', '.join(sorted(unknown))}")
    asked = {**usual, **options, "size": [int(width), int(height)]}
    asked["samples"] = str(asked["samples"])
    asked["title"] = {True: "", False: None, None: None}.get(asked["title"], asked["title"])
    for name in ("color", "background"):
        if asked[name] is not None and max(asked[name]) > 255:
            raise UsageError(f"{name}={asked[name]!r} is not three numbers, red, green and blue, from 0 to 255")
    if asked["section"] is not None:
        sliced = ("zoom", "color", "colors", "range", "annotate", "title", "legend", "clip", "only", "hide", "opacity", "section", "background", "threads")
        foreign = [name for name in usual if name not in sliced and options.get(name, usual[name]) != usual[name]]
        if foreign:
            raise UsageError(f"{foreign[0]} is of a view; leave it out for a section")
    for name in ("only", "hide"):
        asked[name] = _labels(asked[name])
    asked["opacity"] = [[str(label), float(part)] for label, part in (asked["opacity"] or {}).items()]
    return dumps(asked), (int(width), int(height))
