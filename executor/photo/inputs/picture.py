"""The photograph: its pixels, EXIF data and camera intrinsics."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError

from bddl.files import read_bounded
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.system.files import read_json

MOST_SIDE_PX = 4096
"""Larger pictures show nothing more of furniture, and each array of them takes hundreds of megabytes."""

LEAST_SIDE_PX = 64
MOST_BYTES = 64_000_000

_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "JPEG2000")
"""Of the library's many, those that cameras write; there is one for which it would start a program."""

_SCALE_IT = "scale it and its depth down, 640 to 1600 pixels are plenty, or cut out what matters"


@dataclass(frozen=True)
class Exif:
    """Camera data of a picture's file.

    Attributes:
        focal_35mm: Focal length in mm as on film of 36 x 24 mm, or None.
        size_px: Width and height that the camera wrote, or None; another shape than the picture's means that it was
            cropped.
        camera: Maker and model, for people.
    """

    focal_35mm: float | None
    size_px: tuple[int, int] | None
    camera: str


@dataclass(frozen=True)
class Photograph:
    """A picture as it was read.

    Attributes:
        source: Its file, for messages.
        rgb: (H, W, 3) uint8, rotated upright as its file demands.
        exif: Camera data of the file.
    """

    source: Path
    rgb: NDArray[np.uint8]
    exif: Exif

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.rgb.shape[1], self.rgb.shape[0]


def read_picture(path: Path, content: bytes | None = None) -> Photograph:
    """Return a picture of any usual format.

    Args:
        path: Its file.
        content: Its content, if that was read already, as out of an archive.

    Raises:
        PhotoRefused: It is no picture, is truncated, or is too large or too small.
        OSError: The file cannot be read.
    """
    content = read_file(path) if content is None else content
    with opened_picture(path, content) as image:
        width, height = image.size
        if min(width, height) < LEAST_SIDE_PX:
            problem = f"the picture has {width} x {height} pixels; at least {LEAST_SIDE_PX} on a side are needed"
            raise PhotoRefused("picture", path, problem)
        image.load()
        exif = _exif(image)
        rgb = np.asarray(ImageOps.exif_transpose(image).convert("RGB"), dtype=np.uint8)
    return Photograph(path, rgb, exif)


def read_file(path: Path, kind: str = "picture") -> bytes:
    """Return the content of a file.

    Args:
        path: The file.
        kind: What it is, for programs.

    Raises:
        PhotoRefused: It is too large.
        OSError: It cannot be read.
    """
    if path.is_file() and path.stat().st_size > MOST_BYTES:
        problem = f"is larger than {MOST_BYTES / 1e6:g} MB"
        raise PhotoRefused(kind, path, problem, "expected one moment of a room, at most 4096 pixels on a side")
    return read_bounded(path, MOST_BYTES)


@contextmanager
def opened_picture(
    path: Path, content: bytes, kind: str = "picture", expected: str = "a PNG, JPEG or another usual picture, all of it"
) -> Iterator[Image.Image]:
    """Give a picture whose header has been read and is not too large; it is decoded inside the block.

    Args:
        path: Its file, for messages.
        content: What is in it.
        kind: What it is, for programs.
        expected: What it should be.

    Raises:
        PhotoRefused: It is too large, or cannot be read; so is what goes wrong with it inside the block.
    """
    try:
        with warnings.catch_warnings():
            # Of tags that it cannot read, it would warn one by one.
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(BytesIO(content), formats=_FORMATS) as image:
                if max(image.size) > MOST_SIDE_PX:
                    problem = f"has {image.size[0]} x {image.size[1]} pixels; at most {MOST_SIDE_PX} on a side are used"
                    raise PhotoRefused(kind, path, f"the {kind} {problem}", _SCALE_IT)
                yield image
    except PhotoRefused:
        raise
    except UnidentifiedImageError as error:
        # Its own message has an address in memory.
        raise _unreadable(path, kind, "no known format", expected) from error
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        problem = f"the {kind} has over 80 megapixels; at most {MOST_SIDE_PX} pixels on a side are used"
        raise PhotoRefused(kind, path, problem, _SCALE_IT) from error
    except Exception as error:
        # The library raises some ten kinds of errors for faulty pictures.
        raise _unreadable(path, kind, str(error) or type(error).__name__, expected) from error


def _unreadable(path: Path, kind: str, why: str, expected: str) -> PhotoRefused:
    what = "a picture" if kind == "picture" else kind
    return PhotoRefused(kind, path, f"cannot be read as {what} ({why})", f"expected {expected}")


def _exif(image: Image.Image) -> Exif:
    tags = image.getexif()
    details = tags.get_ifd(ExifTags.IFD.Exif)
    focal = details.get(ExifTags.Base.FocalLengthIn35mmFilm)
    width, height = details.get(ExifTags.Base.ExifImageWidth), details.get(ExifTags.Base.ExifImageHeight)
    camera = " ".join(str(tags[tag]).strip("\0 ") for tag in (ExifTags.Base.Make, ExifTags.Base.Model) if tag in tags)
    size = (width, height) if isinstance(width, int) and isinstance(height, int) and min(width, height) > 0 else None
    # Zero means unknown.
    return Exif(float(focal) if focal else None, size, camera)


_LIKELY_DEG = (15.0, 130.0)
"""Of the larger opening angle: from a strong telephoto lens to an extreme wide angle."""

_SAME_SHAPE = 0.02
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_ANGLE = re.compile(r"(hfov|vfov)=([0-9.]+)")
_FORMS = "expected hfov=DEGREES, vfov=DEGREES, or a JSON file with fx, fy, cx and cy, or with K"


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics in pixels; the centre of the first pixel is at (0.5, 0.5).

    Attributes:
        fx, fy: Focal lengths.
        cx, cy: Principal point.
        source: Their origin, for people.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    source: str

    def rays(self, size_px: tuple[int, int]) -> Array:
        """Return (H, W, 3) the ray of each pixel, with depth 1 along the camera's axis; x right, y down, z ahead."""
        width, height = size_px
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy, np.ones_like(u)], axis=-1)

    def to_json(self) -> dict[str, object]:
        """Return them as plain data."""
        return {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy, "source": self.source}


DepthKind: TypeAlias = Literal["measured", "guessed"]
"""A sensor measured a depth, or a network guessed it from the picture."""

HEIGHTS_M = (0.05, 3.0)
"""Of a camera above a floor."""

_TILTS_DEG, _ROLLS_DEG = (-45.0, 90.0), (-180.0, 180.0)
UPRIGHT_DEG = 45.0
"""Largest roll without depth: a thing ends where its box does, down in the picture."""


@dataclass(frozen=True)
class CameraFacts:
    """What people know of a camera and its depth beside the lens.

    Attributes:
        tilt_deg: How far it looks down.
        roll_deg: By how much the vertical leans to the right in the picture; 0 by default.
        height_m: Above the floor.
        depth_kind: Who made the depth; a sensor by default.
    """

    tilt_deg: float | None = None
    roll_deg: float | None = None
    height_m: float | None = None
    depth_kind: DepthKind | None = None

    @property
    def up(self) -> Array | None:
        """(3,) the vertical in the camera's frame; None if the tilt is unknown."""
        return None if self.tilt_deg is None else up_in_camera(self.tilt_deg, self.roll_deg or 0.0)


def read_facts(given: str | None, options: CameraFacts) -> CameraFacts:
    """Return what is known of a camera: by options, else by its JSON file.

    Args:
        given: The value of `--camera`; a JSON file may have `tilt_deg`, `roll_deg`, `height_m` and `depth_kind`.
        options: Facts that were typed.

    Raises:
        PhotoRefused: One is impossible, or a roll has no tilt.
        OSError: The file cannot be read.
    """
    path = Path(given or "")
    data = _object_in(path) if path.suffix.lower() == ".json" else {}
    written = {name: data[name] for name in ("tilt_deg", "roll_deg", "height_m", "depth_kind") if name in data}
    typed = {name: value for name, value in asdict(options).items() if value is not None}
    facts = {**written, **typed}
    for name, option, (low, high), unit in (
        ("tilt_deg", "--tilt", _TILTS_DEG, "degrees"),
        ("roll_deg", "--roll", _ROLLS_DEG, "degrees"),
        ("height_m", "--camera-height-m", HEIGHTS_M, "metres"),
    ):
        if name in facts and not low <= _number(facts[name]) <= high:
            source = option if name in typed else f"{path}: {name}"
            raise PhotoRefused("camera", source, f"is {facts[name]}", f"expected {unit} from {low:g} to {high:g}")
    if facts.get("depth_kind") not in (None, *get_args(DepthKind)):
        problem = f"depth_kind is {facts['depth_kind']!r}"
        raise PhotoRefused("camera", path, problem, f"expected {' or '.join(get_args(DepthKind))}")
    if "roll_deg" in facts and "tilt_deg" not in facts:
        raise PhotoRefused("camera", "--roll", "has no tilt beside it", "give --tilt as well")
    return CameraFacts(**facts)


def up_in_camera(tilt_deg: float, roll_deg: float) -> Array:
    """Return the (3,) vertical in the frame of a camera: x right, y down, z ahead.

    Args:
        tilt_deg: How far the camera looks down.
        roll_deg: By how much the vertical leans to the right in the picture.
    """
    tilt, roll = math.radians(tilt_deg), math.radians(roll_deg)
    return np.array([math.sin(roll) * math.cos(tilt), -math.cos(roll) * math.cos(tilt), -math.sin(tilt)])


def read_camera(given: str | None, picture: Photograph) -> Intrinsics:
    """Return the intrinsics of a picture.

    Args:
        given: `hfov=70`, `vfov=55` (degrees), or a JSON file; by default the picture's EXIF.
        picture: The picture.

    Raises:
        PhotoRefused: They are absent or impossible.
        OSError: The file cannot be read.
    """
    if given is None:
        return _from_exif(picture)
    width, height = picture.size_px
    angle = _ANGLE.fullmatch(given)
    if angle is not None:
        degrees = float(angle[2]) if angle[2].count(".") < 2 else math.nan
        if not 1.0 <= degrees <= 170.0:
            raise PhotoRefused("camera", f"--camera {given}", "no lens opens so far", "expected 1 to 170 degrees")
        side = width if angle[1] == "hfov" else height
        focal = side / 2 / math.tan(math.radians(degrees) / 2)
        return _likely(Intrinsics(focal, focal, width / 2, height / 2, given), picture, f"--camera {given}")
    path = Path(given)
    if path.suffix.lower() != ".json":
        raise PhotoRefused("camera", f"--camera {given}", "is neither an angle nor a JSON file", _FORMS)
    return _likely(_from_file(path, picture), picture, str(path))


def _object_in(path: Path) -> Mapping[str, Any]:
    try:
        data = read_json(path)
    except ValueError as error:
        raise PhotoRefused("camera", path, f"is no JSON ({error})", _FORMS) from error
    if not isinstance(data, Mapping):
        raise PhotoRefused("camera", path, "is no object", _FORMS)
    return data


def _from_file(path: Path, picture: Photograph) -> Intrinsics:
    data = _object_in(path)
    numbers = [data.get(name) for name in ("fx", "fy", "cx", "cy")]
    if "K" in data:
        try:
            K = np.asarray(data["K"], dtype=float).reshape(3, 3)
        except (TypeError, ValueError) as error:
            raise PhotoRefused("camera", path, "its K is no 3 x 3 matrix", _FORMS) from error
        # Some write it column by column.
        K = K.T if K[0, 2] == 0.0 and K[2, 0] != 0.0 else K
        numbers = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
    fx, fy, cx, cy = (_number(value) for value in numbers)
    if not (fx > 0 and fy > 0 and math.isfinite(fx + fy + cx + cy)):
        raise PhotoRefused("camera", path, "fx, fy, cx, cy are not all there, as positive numbers", _FORMS)
    width, height = picture.size_px
    given = _number(data.get("width", width)), _number(data.get("height", height))
    factor = width / given[0] if given[0] > 0 else math.nan
    if not abs(given[1] * factor - height) <= _SAME_SHAPE * height:
        problem = f"is of a picture of {given[0]:g} x {given[1]:g} pixels, and this one has {width} x {height}"
        raise PhotoRefused("camera", path, problem, "give that of this picture")
    return Intrinsics(fx * factor, fy * factor, cx * factor, cy * factor, path.name)


def _from_exif(picture: Photograph) -> Intrinsics:
    exif, (width, height) = picture.exif, picture.size_px
    if exif.focal_35mm is None:
        problem = "its file does not say what camera took it"
        raise PhotoRefused("camera", picture.source, problem, f"give --camera: {_FORMS}")
    if exif.size_px is not None:
        recorded, own = max(exif.size_px) / min(exif.size_px), max(width, height) / min(width, height)
        if abs(recorded / own - 1.0) > _SAME_SHAPE:
            problem = (
                f"its EXIF is of a picture of {exif.size_px[0]} x {exif.size_px[1]} pixels, and it has {width} x "
                f"{height}: it was cut, and its focal length does not hold any more"
            )
            raise PhotoRefused("camera", picture.source, problem, f"give --camera: {_FORMS}")
    focal = exif.focal_35mm / _FILM_DIAGONAL_MM * math.hypot(width, height)
    source = f"EXIF{f' of {exif.camera}' if exif.camera else ''}, {exif.focal_35mm:g} mm"
    return _likely(Intrinsics(focal, focal, width / 2, height / 2, source), picture, str(picture.source))


def _likely(found: Intrinsics, picture: Photograph, source: str) -> Intrinsics:
    """Return intrinsics that a camera can have.

    Raises:
        PhotoRefused: The opening angle is absurd, or the principal point is outside the picture.
    """
    width, height = picture.size_px
    opening = math.degrees(2 * math.atan(max(width / found.fx, height / found.fy) / 2))
    if not _LIKELY_DEG[0] <= opening <= _LIKELY_DEG[1]:
        problem = f"says an opening angle of {opening:.1f} degrees ({found.source})"
        hint = f"expected {_LIKELY_DEG[0]:g} to {_LIKELY_DEG[1]:g}; give --camera: {_FORMS}"
        raise PhotoRefused("camera", source, problem, hint)
    if not (0 < found.cx < width and 0 < found.cy < height):
        problem = f"its principal point ({found.cx:g}, {found.cy:g}) is outside the picture"
        raise PhotoRefused("camera", source, problem)
    return found


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
