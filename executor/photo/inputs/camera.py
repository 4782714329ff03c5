"""The camera's intrinsics: as they are given, or as the picture's file says."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executor.geometry import Array
from executor.machine.files import read_json
from executor.photo.inputs.picture import Photograph
from executor.photo.refusal import PhotoRefused

_LIKELY_DEG = (15.0, 130.0)
"""Of the larger opening angle: from a strong telephoto lens to an extreme wide angle."""

_SAME_SHAPE = 0.02
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_ANGLE = re.compile(r"(hfov|vfov)=([0-9.]+)")
_FORMS = "expected hfov=DEGREES, vfov=DEGREES, or a JSON file with fx, fy, cx and cy, or with K"


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera's numbers in pixels; the centre of the first pixel is at (0.5, 0.5).

    Attributes:
        fx, fy: Focal lengths.
        cx, cy: Principal point.
        source: Where they are from, for people.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    source: str

    def rays(self, size_px: tuple[int, int]) -> Array:
        """Returns (H, W, 3) what each pixel looks along, 1 long on the camera's axis; x right, y down, z ahead."""
        width, height = size_px
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy, np.ones_like(u)], axis=-1)

    def to_json(self) -> dict[str, object]:
        """Returns them as plain data."""
        return {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy, "source": self.source}


def read_camera(given: str | None, picture: Photograph) -> Intrinsics:
    """Returns the intrinsics of a picture.

    Args:
        given: `hfov=70`, `vfov=55` (degrees), or a JSON file; without it, the picture's file has to say them.
        picture: The picture.

    Raises:
        PhotoRefused: They are not given, or cannot be.
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


def _from_file(path: Path, picture: Photograph) -> Intrinsics:
    try:
        data = read_json(path)
    except ValueError as error:
        raise PhotoRefused("camera", path, f"is no JSON ({error})", _FORMS) from error
    if not isinstance(data, Mapping):
        raise PhotoRefused("camera", path, "is no object", _FORMS)
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
        told, own = max(exif.size_px) / min(exif.size_px), max(width, height) / min(width, height)
        if abs(told / own - 1.0) > _SAME_SHAPE:
            problem = (
                f"its EXIF is of a picture of {exif.size_px[0]} x {exif.size_px[1]} pixels, and it has {width} x "
                f"{height}: it was cut, and its focal length does not hold any more"
            )
            raise PhotoRefused("camera", picture.source, problem, f"give --camera: {_FORMS}")
    focal = exif.focal_35mm / _FILM_DIAGONAL_MM * math.hypot(width, height)
    source = f"EXIF{f' of {exif.camera}' if exif.camera else ''}, {exif.focal_35mm:g} mm"
    return _likely(Intrinsics(focal, focal, width / 2, height / 2, source), picture, str(picture.source))


def _likely(found: Intrinsics, picture: Photograph, source: str) -> Intrinsics:
    """Returns intrinsics that a camera can have.

    Raises:
        PhotoRefused: They make an absurd opening angle, or a principal point outside the picture.
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
