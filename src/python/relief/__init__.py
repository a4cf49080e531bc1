"""CT volume rendering in colour and depth.

    import relief

    volume = relief.open("chest")
    frame = volume.render(preset="bone", azimuth_deg=30, size=(960, 540))
    frame.color       # height x width x 4, uint8
    frame.depth_mm    # height x width, float32; infinity where a ray hit nothing
    open("frame.png", "wb").write(frame.encode("wowvx"))

Arrays of voxels are [k, j, i]. Positions are DICOM patient coordinates (LPS) in mm. Errors are `ReliefError`, a ValueError.
Rendering releases the interpreter's lock.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Optional

import numpy
from numpy.typing import ArrayLike, NDArray

# Vulkan draws in memory here. Where there is no window system, Mesa's layer of this switch would still look for one, and
# libwayland would print an error for each look. The loader reads the switch when a device is opened.
if not any(os.environ.get(name) for name in ("XDG_RUNTIME_DIR", "MESA_VK_DEVICE_SELECT", "DRI_PRIME")):
    os.environ.setdefault("NODEVICE_SELECT", "1")

from . import _native
from ._annotations import Annotation, annotations_table, read_annotations, write_annotations
from ._native import ReliefError

if TYPE_CHECKING:
    import nibabel

    from ._viewer import Viewer

__all__ = [
    "Annotation", "Frame", "ReliefError", "Viewer", "Volume", "annotations_table", "open", "phantom", "read_annotations",
    "write_annotations",
]
__version__ = _native.VERSION

#: Axes of a volume along those of the patient.
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class Frame:
    """A rendered picture with its depth. Jupyter shows it."""

    def __init__(self, native: _native.Frame) -> None:
        self._native = native

    @property
    def color(self) -> NDArray[numpy.uint8]:
        """Red, green, blue and coverage: height x width x 4. The array is the picture: changes go into `encode`."""
        return self._native.color

    @property
    def depth_mm(self) -> NDArray[numpy.float32]:
        """View depth in mm: height x width; infinity where a ray hit nothing. Changes go into `encode`."""
        return self._native.depth_mm

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._native.size_px

    @property
    def render_ms(self) -> float:
        """Time of rendering, ms."""
        return self._native.render_ms

    @property
    def limits_mm(self) -> tuple[float, float]:
        """View depths between which `encode` spreads disparity, mm."""
        return self._native.limits_mm()

    def pick(self, x: int, y: int) -> Optional[tuple[float, float, float]]:
        """The patient position that a pixel shows, LPS mm; None where its ray hit nothing."""
        found = self._native.pick(x, y)
        return None if found is None else (found[0], found[1], found[2])

    def encode(self, layout: Optional[str] = None, format: str = "png") -> bytes:
        """The bytes of a file: `png` in a layout such as wowvx, stereo or color; `jpg`, `exr`, or `raw`."""
        return self._native.encode(layout, format)

    def save(self, path: str | os.PathLike[str], layout: Optional[str] = None) -> None:
        """Writes a file; its ending is the format."""
        ending = os.path.splitext(path)[1].lstrip(".").lower()
        data = self.encode(layout, {"jpeg": "jpg"}.get(ending, ending))
        with _open_file(path, "wb") as file:
            file.write(data)

    def _repr_png_(self) -> bytes:
        return self.encode("color")

    def __repr__(self) -> str:
        return f"<relief.Frame {self.size[0]}x{self.size[1]}>"


class Volume:
    """A CT volume in HU."""

    def __init__(self, native: _native.Volume) -> None:
        self._native = native

    @classmethod
    def from_array(
        cls,
        array: ArrayLike,
        spacing: Sequence[float] = (1.0, 1.0, 1.0),
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        direction: ArrayLike = IDENTITY,
    ) -> Volume:
        """A volume of HU, [k, j, i].

        `spacing` is that of i, j and k in mm, `origin` the patient position of voxel [0, 0, 0]; the columns of `direction`
        (3 x 3 or its nine rows-first numbers) are the directions of i, j and k. HU are rounded, and clipped to 16 bits.
        """
        voxels = numpy.asarray(array)
        if voxels.ndim != 3:
            raise ReliefError(f"the array has {voxels.ndim} axes, expected 3: k, j, i")
        if voxels.dtype != numpy.int16:
            if not (numpy.issubdtype(voxels.dtype, numpy.integer) or numpy.issubdtype(voxels.dtype, numpy.floating)):
                raise ReliefError(f"the array has values of type {voxels.dtype}, expected numbers in HU")
            if not numpy.isfinite(voxels).all():
                raise ReliefError("the array has values that are not finite; replace them, for example by -1000 HU")
            voxels = numpy.clip(numpy.rint(voxels), -32768, 32767).astype(numpy.int16)
        axes = numpy.asarray(direction, dtype=numpy.float64).reshape(-1)
        if len(spacing) != 3 or len(origin) != 3 or axes.size != 9:
            raise ReliefError("spacing and origin have 3 numbers each, direction has 9")
        numbers = [float(value) for value in spacing], [float(value) for value in origin]
        return cls(_native.Volume.from_hu(voxels, *numbers, axes.tolist()))

    @classmethod
    def from_sitk(cls, image: Any) -> Volume:
        """A volume of a SimpleITK image (`SimpleITK.Image`, which has no types) in HU, which is in LPS, too."""
        import SimpleITK

        array = SimpleITK.GetArrayViewFromImage(image)
        return cls.from_array(array, image.GetSpacing(), image.GetOrigin(), image.GetDirection())

    @classmethod
    def from_nibabel(cls, image: nibabel.spatialimages.SpatialImage) -> Volume:
        """A volume of a nibabel image in HU. Its coordinates are RAS: x and y change their signs."""
        affine = numpy.diag([-1.0, -1.0, 1.0, 1.0]) @ numpy.asarray(image.affine, dtype=numpy.float64)
        axes = affine[:3, :3]
        spacing = numpy.linalg.norm(axes, axis=0)
        array = numpy.asarray(image.dataobj).transpose(2, 1, 0)
        return cls.from_array(array, spacing.tolist(), affine[:3, 3].tolist(), axes / spacing)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along k, j and i."""
        return self._native.shape

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distances of voxels along i, j and k, mm."""
        x, y, z = self._native.spacing_mm
        return x, y, z

    @property
    def origin(self) -> tuple[float, float, float]:
        """Patient position of voxel [0, 0, 0], mm."""
        x, y, z = self._native.origin_mm
        return x, y, z

    @property
    def direction(self) -> NDArray[numpy.float64]:
        """3 x 3: its columns are the directions of i, j and k."""
        return numpy.array(self._native.direction).reshape(3, 3)

    @property
    def range_hu(self) -> tuple[int, int]:
        """Smallest and largest HU."""
        return self._native.range_hu

    @property
    def unit(self) -> str:
        """The unit of the values: HU, or another RescaleType of the DICOM files, such as MGML."""
        return self._native.unit

    @property
    def id(self) -> str:
        """The id that a server gives the volume."""
        return self._native.id

    @property
    def warnings(self) -> list[str]:
        """Warnings of reading the files."""
        return self._native.warnings

    def to_array(self) -> NDArray[numpy.int16]:
        """The voxels in HU, [k, j, i], as a new array."""
        return self._native.to_array()

    def hu(self, k: int, j: int, i: int) -> int:
        """HU of a voxel."""
        return self._native.hu(k, j, i)

    def render(
        self,
        scene: Optional[Mapping[str, Any]] = None,
        *,
        preset: Optional[str] = None,
        camera: Optional[Mapping[str, Any]] = None,
        azimuth_deg: float = 0.0,
        elevation_deg: float = 0.0,
        zoom: float = 1.0,
        size: Optional[tuple[int, int]] = None,
        mode: Optional[str] = None,
        layout: Optional[str] = None,
        adapter: str = "best",
    ) -> Frame:
        """Renders a picture.

        `scene` is the JSON of a request as a dictionary (docs/RENDERING.md); the other arguments replace its keys. Without a
        camera the view turns about the volume by azimuth and elevation. `adapter` is best, cpu, software, or a part of a
        graphics adapter's name.
        """
        asked: dict[str, Any] = json.loads(json.dumps(scene or {}))
        if preset is not None:
            asked["transfer"] = preset
        if camera is not None:
            asked["camera"] = dict(camera)
        if size is not None:
            asked["size_px"] = list(size)
        if mode is not None:
            asked["mode"] = mode
        display = asked.setdefault("display", {})
        if layout is not None:
            display["layout"] = layout
        elif "layout" not in display:
            display["layout"] = "rgbd"  # takes any size
        view = (float(azimuth_deg), float(elevation_deg), float(zoom))
        return Frame(self._native.render_scene(json.dumps(asked), view, adapter))

    def slice(
        self,
        plane: str = "axial",
        offset_mm: float = 0.0,
        *,
        slab_mm: float = 0.0,
        window_hu: Optional[tuple[float, float]] = None,
        size: tuple[int, int] = (512, 512),
        adapter: str = "best",
    ) -> Frame:
        """A slice or a slab: axial, coronal or sagittal, `offset_mm` from the middle. `window_hu` is centre and width."""
        asked: dict[str, Any] = {"mode": "slice", "slice": {"plane": plane, "offset_mm": offset_mm}}
        if slab_mm:
            asked["slice"]["slab_mm"] = slab_mm
        if window_hu is not None:
            asked["transfer"] = {"window": {"center_hu": window_hu[0], "width_hu": window_hu[1]}}
        return self.render(asked, size=size, layout="color", adapter=adapter)

    def __repr__(self) -> str:
        return f"<relief.Volume {'x'.join(map(str, self.shape))}, {self.range_hu[0]} to {self.range_hu[1]} {self.unit}>"


_open_file = open


def open(  # noqa: A001
    path: str | os.PathLike[str],
    *,
    series_uid: Optional[str] = None,
    strict: bool = False,
    cache: Optional[str | os.PathLike[str]] = None,
    archive_login_file: Optional[str | os.PathLike[str]] = None,
    archive_token_file: Optional[str | os.PathLike[str]] = None,
    archive_ca: Optional[str | os.PathLike[str]] = None,
    archive_identity: Optional[str | os.PathLike[str]] = None,
) -> Volume:
    """Loads a CT series (folder, file, DICOMDIR or zip) or a volume in HU (.nii, .nii.gz, .nrrd).

    A series may also be in a DICOM archive (`dicomweb+https://HOST/ROOT/studies/UID/series/UID`, or a query that matches one
    series) or in a bucket (`s3://BUCKET/PREFIX`); `cache` keeps copies of these in a folder. The files of archives have the
    meaning of the command line's options; where left out, the variables RELIEF_ARCHIVE_LOGIN_FILE, ..._TOKEN_FILE, ..._CA and
    ..._IDENTITY name them.

    `series_uid` chooses one of several series. `strict` fails on defective files; otherwise they are left out, and
    `Volume.warnings` says so.
    """
    named = {"LOGIN_FILE": archive_login_file, "TOKEN_FILE": archive_token_file, "CA": archive_ca, "IDENTITY": archive_identity}
    files = [given or os.environ.get(f"RELIEF_ARCHIVE_{name}") or None for name, given in named.items()]
    return Volume(_native.open_volume(path, series_uid, strict, [cache, *files]))


def phantom(kind: str = "head", size: int = 128) -> Volume:
    """A procedural volume with known truth: head, sphere, slab, ramp or axes, `size` voxels across."""
    return Volume(_native.phantom(kind, size))


def __getattr__(name: str) -> Any:
    """`Viewer` needs packages that the rest does not need."""
    if name != "Viewer":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ._viewer import Viewer

    return Viewer
