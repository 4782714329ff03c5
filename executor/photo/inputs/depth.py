"""The depth of every pixel, in metres along the camera's axis, from the files that cameras and networks write."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np

from executor.geometry import Array
from executor.machine.extras import require
from executor.photo.inputs.picture import MOST_SIDE_PX, Photograph, opened_picture, read_file
from executor.photo.refusal import PhotoRefused

NEAREST_M, FARTHEST_M = 0.1, 25.0
"""What lies outside is taken for not measured."""

_LIKELY_M = (0.3, 15.0)
"""Where the middle of a room's depths is; another one means another unit."""

_LEAST_MEASURED = 0.05  # Of the pixels.
BEND_SHARE = 0.02
"""How far depths that a network guesses slowly go off, where nothing tells how far these do."""

_DEPTH_CHANNELS = ("Z", "depth.Z", "R", "Y")  # As Blender and Record3D call them.
MOST_DECODED_BYTES = 300_000_000
"""Of a file of depths when it is unpacked: 4096 x 4096 pixels of four channels."""

_SAME_SHAPE = 0.02
_MOST_NAMES_BYTES = 64_000  # Of the directory of an .npz, which holds one array or a few.
_FORMS = "a 16-bit PNG, .npz, .npy or .exr"
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
    values = _values(path, size_px)
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
    _require_size(path, values.shape[::-1], size_px)
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

    Its header is read first: what would be more than 300 MB when it is unpacked, or deeper than a picture, never is.

    Raises:
        PhotoRefused: It cannot be read, is too large, or has no such channel.
        MissingExtra: The library that reads EXR is not installed.
        OSError: The file cannot be read.
    """
    openexr = require("OpenEXR", "captures")
    content = read_file(path, "depth")
    try:
        with openexr.File(BytesIO(content), separate_channels=True, header_only=True) as file:
            size_px, names = _announced(path, [dict(part.header) for part in file.parts])
        name = next((one for one in _DEPTH_CHANNELS if one in names), None)
        if name is None:
            raise PhotoRefused("depth", path, f"has the channels {', '.join(sorted(names))}", "expected Z, or R")
        # When the file is closed, its channels are gone.
        with openexr.File(BytesIO(content), separate_channels=True) as file:
            values = np.array(file.channels()[name].pixels)
    except PhotoRefused:
        raise
    except Exception as error:
        # Of what can be wrong with a file, the library raises some ten kinds.
        raise PhotoRefused("depth", path, f"cannot be read as EXR ({error})") from error
    if values.shape != size_px[::-1]:
        raise PhotoRefused(
            "depth", path, f"its channel {name} is not of the {size_px[0]} x {size_px[1]} pixels of its header"
        )
    return values.astype(np.float32)


def _announced(path: Path, headers: Sequence[Mapping[str, Any]]) -> tuple[tuple[int, int], set[str]]:
    """Returns width and height of an EXR file's first part, and its channels, by the headers of all its parts.

    Raises:
        PhotoRefused: It would be too large, or is none of pixels with one depth each.
    """
    sizes, total = [], 0
    for header in headers:
        low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
        width, height = (int(side) for side in high - low + 1)
        if not (0 < width <= MOST_SIDE_PX and 0 < height <= MOST_SIDE_PX):
            problem = f"has {width} x {height} pixels by its header"
            raise PhotoRefused("depth", path, problem, f"expected 1 to {MOST_SIDE_PX} on a side")
        sizes.append((width, height))
        total += 4 * width * height * len(header["channels"])
    if total > MOST_DECODED_BYTES:
        raise _too_much(path, total)
    return sizes[0], {channel.name for channel in headers[0]["channels"]}


def _too_much(path: Path, size: int) -> PhotoRefused:
    problem = f"would take {size / 1e6:.0f} MB when it is unpacked"
    return PhotoRefused(
        "depth", path, problem, f"at most {MOST_DECODED_BYTES / 1e6:g} MB are, of one channel of depths"
    )


def _values(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """The numbers of a file, which are unpacked only where its header has as many as the picture."""
    if path.suffix.lower() == ".exr":
        return read_exr(path)
    content = read_file(path, "depth")
    if path.suffix.lower() in (".npy", ".npz"):
        return _array(path, content, size_px)
    with opened_picture(path, content, "depth", _FORMS) as image:
        _require_size(path, image.size, size_px)
        image.load()
        values = np.asarray(image)
    if values.ndim != 2 or values.dtype == np.uint8 or values.dtype == bool:
        problem = f"has {'colours' if values.ndim > 2 else '8 bits a pixel'}, not depths"
        raise PhotoRefused("depth", path, problem, "expected a 16-bit PNG with one channel")
    return values


def _array(path: Path, content: bytes, size_px: tuple[int, int]) -> np.ndarray:
    expected = "expected one array (H, W) of numbers, or one called depth"
    try:
        if path.suffix.lower() == ".npy":
            return _plain_array(path, BytesIO(content), size_px, expected)
        _require_few_names(content)
        with zipfile.ZipFile(BytesIO(content)) as archive:
            members = {one.filename.removesuffix(".npy"): one for one in archive.infolist()}
            name = "depth" if "depth" in members else next(iter(members)) if len(members) == 1 else None
            if name is None:
                raise PhotoRefused("depth", path, f"holds {', '.join(members) or 'nothing'}", expected)
            if members[name].compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError("it is packed as NumPy packs none")
            with archive.open(members[name]) as stream:
                return _plain_array(path, stream, size_px, expected)
    except PhotoRefused:
        raise
    except Exception as error:
        # NumPy, zip and its packers raise some ten kinds.
        why = str(error) or type(error).__name__
        raise PhotoRefused("depth", path, f"cannot be read as an array ({why})", expected) from error


def _plain_array(path: Path, stream: IO[bytes], size_px: tuple[int, int], expected: str) -> np.ndarray:
    """An array in NumPy's form, of which as much is read as its header has, if that is as much as it should."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version[0]}.{version[1]} of its form has no plain numbers")
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, kind = header(stream)
    if kind.hasobject:
        raise ValueError("it holds objects of Python, which could run code")
    if len(shape) != 2 or kind.kind not in "uif":
        raise PhotoRefused("depth", path, f"its array has shape {shape} of {kind}", expected)
    _require_size(path, shape[::-1], size_px)
    size = shape[0] * shape[1] * kind.itemsize
    content = stream.read(size)
    if len(content) < size:
        raise ValueError(f"its header is of {size} bytes of numbers, and it has {len(content)}")
    return np.frombuffer(content, kind).reshape(shape, order="F" if by_columns else "C")


def _require_few_names(content: bytes) -> None:
    """Refuses an archive with a directory that would take long to read."""
    at = content.rfind(b"PK\x05\x06")
    size = int.from_bytes(content[at + 12 : at + 16], "little")
    if at < 0 or size > _MOST_NAMES_BYTES or content[max(0, at - 20) : at].startswith(b"PK\x06\x07"):
        raise ValueError("it is no .npz, or has very many arrays")


def _require_size(path: Path, got: Sequence[int], size_px: tuple[int, int]) -> None:
    """Refuses depths that are not as many as the picture's pixels."""
    if tuple(got) == size_px:
        return
    shown, (width, height) = " x ".join(map(str, got)), size_px
    problem = f"the depth is {shown} pixels, the picture {width} x {height}"
    if tuple(got) == (height, width):
        hint = "it lies on its side: turn it by 90 degrees, as the picture is when its EXIF has turned it upright"
    elif abs(got[0] * height - got[1] * width) > _SAME_SHAPE * abs(got[1]) * width:
        hint = "it is shaped otherwise: give it as the picture's own camera has it (registered), and cut as that is"
    else:
        hint = "scale one to the other, depth by nearest neighbours"
    raise PhotoRefused("depth", path, problem, hint)
