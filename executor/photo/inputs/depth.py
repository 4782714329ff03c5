"""Depth files, and single frames of Record3D's recordings.

Depths are in metres along the camera's axis. An .r3d file is a ZIP with `metadata` and rgbd/N.jpg, N.depth, N.conf, the
last two packed by LZFSE.

Source: the recordings as their users read them.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np
from PIL import Image

from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.picture import (
    MOST_BYTES,
    MOST_SIDE_PX,
    Intrinsics,
    Photograph,
    opened_picture,
    read_file,
    read_picture,
)
from executor.system.extras import require

NEAREST_M, FARTHEST_M = 0.1, 25.0
"""Depth outside this range counts as not measured."""

_LIKELY_M = (0.3, 15.0)
"""Range of the median depth of a room; another median means another unit."""

_LEAST_MEASURED = 0.05  # Of the pixels.
DEFAULT_DEPTH_DISTORTION = 0.02
"""Relative distortion of a network's depth if it is unknown."""

_DEPTH_CHANNELS = ("Z", "depth.Z", "R", "Y")  # As Blender and Record3D call them.
MOST_DECODED_BYTES = 300_000_000
"""Of a file of depths when it is unpacked: 4096 x 4096 pixels of four channels."""

_SAME_SHAPE = 0.02
_ONE_SURFACE = 0.015  # Of the depth, between a measurement and halfway to the next one: more is a jump.
_LEAST_DEPTHS = 30  # On a side.
_MOST_NAMES_BYTES = 64_000  # Of the directory of an .npz, which holds one array or a few.
_FORMS = "a 16-bit PNG, .npz, .npy or .exr"
_UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "TUM (1/5000 m)": 0.0002}


@dataclass(frozen=True)
class Depth:
    """Depth as it was read.

    Attributes:
        z_m: (H, W) along the camera's axis, 0 where nothing was measured.
        source: The file and its unit, for people.
        depth_distortion: Relative error that varies slowly over the picture, if a network guessed the depth: flat
            surfaces
            are bent. 0 for measured depth.
        camera: Intrinsics that the depth is for, if a network guessed them from the picture as well.
        of_px: Width and height that it was measured with, if these are not the picture's.
    """

    z_m: Array
    source: str
    depth_distortion: float = 0.0
    camera: Intrinsics | None = None
    of_px: tuple[int, int] | None = None


DepthSource: TypeAlias = Callable[[Photograph, Intrinsics | None], Depth]
"""Gives a picture its depth; a file is one as well as a network. Raises PhotoRefused where it cannot.

Its second argument has the intrinsics, None if they are unknown.
"""


def depth_in(path: Path, unit_m: float | None) -> DepthSource:
    """Return the source that reads depth from a file, see `read_depth`."""

    def depth(picture: Photograph, camera: Intrinsics | None) -> Depth:
        """Read the depth of a picture; a file needs no intrinsics."""
        return read_depth(path, picture.size_px, unit_m)

    return depth


def read_depth(path: Path, size_px: tuple[int, int], unit_m: float | None = None) -> Depth:
    """Return the depth of a picture.

    Args:
        path: A 16-bit PNG (millimetres, unless a unit is given), a NumPy array (`.npy`, or `.npz` with one
            array or one called `depth`; whole numbers are millimetres, others metres), or an EXR in metres.
        size_px: Width and height of the picture; a depth of another size, shaped alike, is scaled to it.
        unit_m: Size of one step [m], such as 0.0002 for the TUM sets.

    Raises:
        PhotoRefused: It cannot be read, is shaped otherwise, measures almost nothing, or is in another unit.
        OSError: The file cannot be read.
    """
    values = _values(path, size_px)
    whole = values.dtype.kind in "ui"
    factor = unit_m if unit_m is not None else (0.001 if whole else 1.0)
    return checked_depth(path, values, size_px, factor, f"{path.name}, one step is {factor:g} m")


def checked_depth(path: Path, values: np.ndarray, size_px: tuple[int, int], unit_m: float, source: str) -> Depth:
    """Check an array of depths and return it as the depth of a picture.

    Args:
        path: Its file, for messages.
        values: (H, W); not finite or 0 where nothing was measured.
        size_px: Width and height of the picture.
        unit_m: Size of one step [m].
        source: The file and its unit, for people.

    Raises:
        PhotoRefused: It is shaped otherwise, measures almost nothing, or is in another unit.
    """
    _require_shape(path, values.shape[::-1], size_px)
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
    if values.shape[::-1] == size_px:
        return Depth(z_m, source)
    height, width = values.shape
    return Depth(_resized(z_m, size_px), f"{source}, {width} x {height} pixels", of_px=(width, height))


def _resized(z_m: Array, size_px: tuple[int, int]) -> Array:
    """Return depths (H, W) in another size: by the nearest neighbour, and linear in between on one surface.

    Inverse depth is linear in the picture on a plane. Across a jump nothing is known but the two sides of it.
    """

    def scaled(values: Array, how: Image.Resampling) -> Array:
        return np.asarray(Image.fromarray(values.astype(np.float32)).resize(size_px, how), dtype=float)

    inverse = np.where(z_m > 0.0, 1.0 / np.maximum(z_m, NEAREST_M), 0.0)
    nearest = scaled(inverse, Image.Resampling.NEAREST)
    between = nearest if z_m.shape[1] > size_px[0] else scaled(inverse, Image.Resampling.BILINEAR)
    is_one = np.abs(between - nearest) < _ONE_SURFACE * nearest
    found = np.where(is_one, between, nearest)
    return np.where(found > 0.0, 1.0 / np.maximum(found, 1.0 / FARTHEST_M), 0.0)


def read_exr(path: Path) -> np.ndarray:
    """Return the (H, W) depth of an EXR file: its channel Z, or R where a camera wrote it there.

    The header is read first: content of more than 300 MB unpacked, or larger than a picture, is never unpacked.

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
        # The library raises some ten kinds of errors for faulty files.
        raise PhotoRefused("depth", path, f"cannot be read as EXR ({error})") from error
    if values.shape != size_px[::-1]:
        raise PhotoRefused(
            "depth", path, f"its channel {name} is not of the {size_px[0]} x {size_px[1]} pixels of its header"
        )
    return values.astype(np.float32)


def _announced(path: Path, headers: Sequence[Mapping[str, Any]]) -> tuple[tuple[int, int], set[str]]:
    """Return width and height of an EXR file's first part, and its channels, from all headers.

    Raises:
        PhotoRefused: It would be too large, or has no pixels with one depth each.
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
    """Return the numbers of a file; they are unpacked only if its header has the picture's shape."""
    if path.suffix.lower() == ".exr":
        return read_exr(path)
    content = read_file(path, "depth")
    if path.suffix.lower() in (".npy", ".npz"):
        return _array(path, content, size_px)
    with opened_picture(path, content, "depth", _FORMS) as image:
        _require_shape(path, image.size, size_px)
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
    """Read a NumPy array of at most the size in its header, if that is shaped as the picture."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version[0]}.{version[1]} of its form has no plain numbers")
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, kind = header(stream)
    if kind.hasobject:
        raise ValueError("it holds objects of Python, which could run code")
    if len(shape) != 2 or kind.kind not in "uif":
        raise PhotoRefused("depth", path, f"its array has shape {shape} of {kind}", expected)
    _require_shape(path, shape[::-1], size_px)
    size = shape[0] * shape[1] * kind.itemsize
    content = stream.read(size)
    if len(content) < size:
        raise ValueError(f"its header is of {size} bytes of numbers, and it has {len(content)}")
    return np.frombuffer(content, kind).reshape(shape, order="F" if by_columns else "C")


def _require_few_names(content: bytes) -> None:
    """Refuse an archive with a directory that would take long to read."""
    at = content.rfind(b"PK\x05\x06")
    size = int.from_bytes(content[at + 12 : at + 16], "little")
    if at < 0 or size > _MOST_NAMES_BYTES or content[max(0, at - 20) : at].startswith(b"PK\x06\x07"):
        raise ValueError("it is no .npz, or has very many arrays")


def _require_shape(path: Path, got: Sequence[int], size_px: tuple[int, int]) -> None:
    """Refuse depth that is shaped otherwise than the picture, or has far fewer or more pixels."""
    shown, (width, height) = " x ".join(map(str, got)), size_px
    problem = f"the depth is {shown} pixels, the picture {width} x {height}"
    if abs(got[0] * height - got[1] * width) > _SAME_SHAPE * abs(got[1]) * width:
        hint = "it is shaped otherwise: give it as the picture's own camera has it (registered), and cut as that is"
        if abs(got[1] * height - got[0] * width) <= _SAME_SHAPE * abs(got[0]) * width:
            hint = "it lies on its side: turn it by 90 degrees, as the picture is when its EXIF has turned it upright"
    elif not (min(got) >= min(_LEAST_DEPTHS, *size_px) and max(got) <= MOST_SIDE_PX):
        hint = f"expected {_LEAST_DEPTHS} to {MOST_SIDE_PX} on a side"
    else:
        return
    raise PhotoRefused("depth", path, problem, hint)


_LARGEST_BYTES = 4_000_000_000  # Of a recording, of which one moment is read.
_LEAST_SURE = 1  # Of Record3D's 0, 1 and 2: depths that its sensor itself takes for guesses are left out.
_EXPECTED = "expected Record3D's .r3d file"


@dataclass(frozen=True)
class Capture:
    """One frame of a recording.

    Attributes:
        picture, depth: As they were recorded, of one size.
        camera: None if the recording has no intrinsics.
    """

    picture: Photograph
    depth: Depth
    camera: Intrinsics | None


def is_capture(path: Path) -> bool:
    """Return whether a path is a recording and no picture."""
    return path.suffix.lower() == ".r3d"


def read_capture(path: Path, frame: int | None = None) -> Capture:
    """Return one frame of a recording.

    Args:
        path: An .r3d file.
        frame: Number of the frame, from 0; by default the middle one.

    Raises:
        PhotoRefused: It is no recording, the frame is absent, or its content is unusable.
        MissingExtra: The library that unpacks its depths is not installed.
        OSError: The file cannot be read.
    """
    if path.stat().st_size > _LARGEST_BYTES:
        raise PhotoRefused("picture", path, f"is larger than {_LARGEST_BYTES / 1e9:g} GB", "export fewer seconds")
    try:
        with zipfile.ZipFile(path) as archive:
            metadata = _metadata(path, json.loads(_member(path, archive, "metadata")))
            found = (re.fullmatch(r"rgbd/(\d+)\.depth", name) for name in archive.namelist())
            numbers = sorted(int(one[1]) for one in found if one is not None)
            number = numbers[_chosen(path, len(numbers), frame)]
            jpeg = _member(path, archive, f"rgbd/{number}.jpg")
            depth = _member(path, archive, f"rgbd/{number}.depth")
            sure = f"rgbd/{number}.conf"
            trust = _member(path, archive, sure) if sure in archive.namelist() else None
    except (zipfile.BadZipFile, ValueError, RecursionError, EOFError) as error:
        raise PhotoRefused("picture", path, f"cannot be read as an .r3d file ({error})", _EXPECTED) from error
    picture = read_picture(path, jpeg)
    values = _unpacked(path, depth, np.float32)
    height = round(math.sqrt(len(values) * picture.size_px[1] / picture.size_px[0]))
    width = len(values) // max(1, height)
    if width * height != len(values):
        shape = f"{len(values)} depths, which make no picture shaped as {picture.size_px[0]} x {picture.size_px[1]}"
        raise PhotoRefused("depth", path, f"frame {number} has {shape}")
    values = values.reshape(height, width)
    if trust is not None and len(levels := _unpacked(path, trust, np.uint8)) == values.size:
        values = np.where(levels.reshape(height, width) >= _LEAST_SURE, values, 0.0)
    return _together(path, picture, values, metadata, number)


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        size = archive.getinfo(name).file_size
    except KeyError:
        raise PhotoRefused("picture", path, f"has no {name}", _EXPECTED) from None
    if size > MOST_BYTES:
        raise PhotoRefused("picture", path, f"its {name} is larger than {MOST_BYTES / 1e6:g} MB")
    return archive.read(name)


def _unpacked(path: Path, content: bytes, kind: type) -> np.ndarray:
    lzfse = require("lzfse", "captures")
    # Each of its blocks begins with how much it unpacks to.
    size = sum(int.from_bytes(one, "little") for one in re.findall(rb"bvx[-12n](.{4})", content, re.DOTALL))
    if size > MOST_DECODED_BYTES:
        raise PhotoRefused("depth", path, f"its depth would take {size / 1e6:.0f} MB when it is unpacked")
    try:
        return np.frombuffer(lzfse.decompress(content), dtype=kind)
    except (lzfse.error, ValueError) as error:
        raise PhotoRefused("depth", path, f"its depth cannot be unpacked ({error})", "is the file complete?") from error


def _together(
    source: Path, picture: Photograph, values: np.ndarray, metadata: Mapping[str, Any], number: int
) -> Capture:
    """Join a picture and its smaller depth."""
    description = f"frame {number} of {source.name}, depths in metres"
    depth = checked_depth(source, values, picture.size_px, 1.0, description)
    return Capture(picture, depth, _camera(metadata, picture, number))


def _camera(metadata: Mapping[str, Any], picture: Photograph, number: int) -> Intrinsics | None:
    each = metadata.get("perFrameIntrinsicCoeffs")
    width, height = picture.size_px
    try:
        if isinstance(each, Sequence) and number < len(each):
            fx, fy, cx, cy = (float(value) for value in each[number])
        else:
            # It is written column by column.
            K = np.asarray(metadata["K"], dtype=float).reshape(3, 3).T
            fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
        factor = width / float(metadata.get("w", width))
    except (KeyError, TypeError, ValueError):
        return None
    likely = fx > 0 and fy > 0 and 0 < cx * factor < width and 0 < cy * factor < height
    source = "the recording's own"
    return Intrinsics(fx * factor, fy * factor, cx * factor, cy * factor, source) if likely else None


def _metadata(path: Path, data: object) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise PhotoRefused("picture", path, "its metadata is no object", _EXPECTED)
    return data


def _chosen(path: Path, count: int, frame: int | None) -> int:
    if count == 0:
        raise PhotoRefused("picture", path, "has no moment with a depth", _EXPECTED)
    if frame is not None and not 0 <= frame < count:
        raise PhotoRefused("picture", path, f"has {count} moments and no number {frame}", f"--frame 0 to {count - 1}")
    return count // 2 if frame is None else frame
