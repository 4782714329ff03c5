"""The depth of every pixel, in metres along the camera's axis, from the files that cameras and networks write."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import numpy as np
from PIL import Image, UnidentifiedImageError

from bddl.files import read_bounded
from executor.geometry import Array
from executor.machine.extras import require
from executor.photo.inputs.packed import BadPacking, archive_of, array_in, opened_in
from executor.photo.inputs.picture import MOST_BYTES, MOST_SIDE_PX, Photograph
from executor.photo.refusal import PhotoRefused

NEAREST_M, FARTHEST_M = 0.1, 25.0
"""What lies outside is taken for not measured."""

_LIKELY_M = (0.3, 15.0)
"""Where the middle of a room's depths is; another one means another unit."""

_LEAST_MEASURED = 0.05  # Of the pixels.
BEND_SHARE = 0.02
"""How far depths that a network guesses slowly go off, where nothing tells how far these do."""

_DEPTH_CHANNELS = ("Z", "depth.Z", "R", "Y")  # As Blender and Record3D call them.
_NAMED = 8  # Arrays that a message names, of an archive with others than it should have.
_UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "TUM (1/5000 m)": 0.0002}


@dataclass(frozen=True)
class Depth:
    """Depths as they were read.

    Attributes:
        z_m: (H, W) along the camera's axis, 0 where nothing was measured.
        source: The file and its unit, for people.
        bend_share: How far off they slowly go over the picture, as a share of themselves, where a network has guessed
            them: what is flat is bent in them. 0 for what was measured.
    """

    z_m: Array
    source: str
    bend_share: float = 0.0


DepthSource: TypeAlias = Callable[[Photograph], Depth]
"""Gives a picture its depth; a file is one as well as a network. Raises PhotoRefused where it cannot."""


def depth_in(path: Path, unit_m: float | None) -> DepthSource:
    """Returns the source whose depths are in a file, see `read_depth`."""
    return lambda picture: read_depth(path, picture.size_px, unit_m)


def read_depth(path: Path, size_px: tuple[int, int], unit_m: float | None = None) -> Depth:
    """Returns the depth that belongs to a picture.

    Args:
        path: A 16-bit PNG (millimetres, unless a unit says otherwise), a NumPy array (`.npy`, or `.npz` with one
            array or one called `depth`; whole numbers are millimetres, others metres), or an EXR in metres.
        size_px: Width and height of the picture.
        unit_m: What one step of the numbers is in metres, such as 0.0002 for the TUM sets.

    Raises:
        PhotoRefused: It cannot be read, is of another size, measures almost nothing, or is in another unit.
        OSError: The file cannot be read.
    """
    values = _values(path)
    whole = values.dtype.kind in "ui"
    factor = unit_m if unit_m is not None else (0.001 if whole else 1.0)
    return checked_depth(path, values, size_px, factor, f"{path.name}, one step is {factor:g} m")


def checked_depth(path: Path, values: np.ndarray, size_px: tuple[int, int], unit_m: float, source: str) -> Depth:
    """Returns an array of depths as those of a picture.

    Args:
        path: Where they are from, for messages.
        values: (H, W); not finite or 0 where nothing was measured.
        size_px: Width and height of the picture.
        unit_m: What one step of the numbers is in metres.
        source: The file and its unit, for people.

    Raises:
        PhotoRefused: They are of another size, measure almost nothing, or are in another unit.
    """
    width, height = size_px
    if values.shape != (height, width):
        got = " x ".join(map(str, values.shape[::-1]))
        hint = "scale one to the other, depth by nearest neighbours"
        raise PhotoRefused("depth", path, f"the depth is {got} pixels, the picture {width} x {height}", hint)
    numbers = np.where(np.isfinite(values), values, 0).astype(float)
    measured = numbers > 0.0
    if measured.mean() < _LEAST_MEASURED:
        raise PhotoRefused("depth", path, f"only {100 * measured.mean():.1f} % of its pixels measure something")
    middle = float(np.median(numbers[measured]))
    if not _LIKELY_M[0] <= middle * unit_m <= _LIKELY_M[1]:
        likely = [name for name, unit in _UNITS.items() if _LIKELY_M[0] <= middle * unit <= _LIKELY_M[1]]
        hint = f"in {' or '.join(likely)} it would be one: say so by --depth-unit-m" if likely else ""
        problem = f"half of its depths are beyond {middle * unit_m:.4g} m, which is no room"
        raise PhotoRefused("depth", path, problem, hint)
    z_m = numbers * unit_m
    z_m[(z_m < NEAREST_M) | (z_m > FARTHEST_M)] = 0.0
    return Depth(z_m, source)


def read_exr(path: Path) -> np.ndarray:
    """Returns the (H, W) depths of an EXR file: its channel Z, or R where a camera wrote it there.

    Raises:
        PhotoRefused: It cannot be read, or has no such channel.
        MissingExtra: The library that reads EXR is not installed.
        OSError: The file cannot be read.
    """
    openexr = require("OpenEXR", "captures")
    if path.stat().st_size > MOST_BYTES:
        raise PhotoRefused("depth", path, f"is larger than {MOST_BYTES / 1e6:g} MB")
    try:
        # When the file is closed, its channels are gone.
        with openexr.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise PhotoRefused("depth", path, f"cannot be read as EXR ({error})") from error
    name = next((one for one in _DEPTH_CHANNELS if one in channels), None)
    if name is None:
        raise PhotoRefused("depth", path, f"has the channels {', '.join(sorted(channels))}", "expected Z, or R")
    return channels[name].astype(np.float32)


def _values(path: Path) -> np.ndarray:
    content = read_bounded(path, MOST_BYTES)
    if path.suffix.lower() in (".npy", ".npz"):
        return _array(path, content)
    if path.suffix.lower() == ".exr":
        return read_exr(path)
    try:
        with Image.open(BytesIO(content)) as image:
            image.load()
            values = np.asarray(image)
    except UnidentifiedImageError as error:
        hint = "expected a 16-bit PNG, .npz, .npy or .exr"
        raise PhotoRefused("depth", path, "cannot be read as depth (no known format)", hint) from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        hint = "expected a 16-bit PNG, .npz, .npy or .exr"
        raise PhotoRefused("depth", path, f"cannot be read as depth ({error})", hint) from error
    if values.ndim != 2 or values.dtype == np.uint8 or values.dtype == bool:
        problem = f"has {'colours' if values.ndim > 2 else '8 bits a pixel'}, not depths"
        raise PhotoRefused("depth", path, problem, "expected a 16-bit PNG with one channel")
    return values


def _array(path: Path, content: bytes) -> np.ndarray:
    expected = "expected one array (H, W) of numbers, or one called depth"
    try:
        if not content.startswith(b"PK"):
            return array_in(BytesIO(content), MOST_SIDE_PX)
        with archive_of(BytesIO(content)) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
            name = "depth" if "depth" in names else names[0] if len(names) == 1 else None
            if name is None:
                known = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
                raise PhotoRefused("depth", path, f"holds {known or 'nothing'}", expected)
            with opened_in(archive, archive.namelist()[names.index(name)]) as stream:
                return array_in(stream, MOST_SIDE_PX)
    except (BadPacking, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise PhotoRefused("depth", path, f"cannot be read as an array ({error})", expected) from error
