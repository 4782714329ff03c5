"""One moment of a recording: a picture with its depth and camera, out of TUM's RGB-D folders and Record3D's exports.

TUM        rgb.txt and depth.txt name the pictures and depths by their times; one step of a depth is 1/5000 m. Which of
           TUM's three cameras it was, the folder's name says (freiburg1, 2 or 3); else `--camera` has to.
Record3D   an .r3d file (a ZIP with `metadata` and rgbd/N.jpg, N.depth, N.conf, the last two packed by LZFSE), or the
           export of EXR and pictures (metadata.json, rgb/N.jpg, depth/N.exr).
Sources: the page of TUM's RGB-D benchmark; Record3D's two exports as their users read them.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from bddl.files import read_bounded_text
from executor.machine.extras import require
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.depth import MOST_DECODED_BYTES, Depth, checked_depth, read_depth, read_exr
from executor.photo.inputs.picture import MOST_BYTES, Photograph, read_picture
from executor.photo.refusal import PhotoRefused

_TUM_UNIT_M = 0.0002
_TUM_CAMERAS = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""As TUM calibrated them, with the first pixel's centre at zero."""

_TOGETHER_S = 0.02  # Between a picture and its depth, as TUM's own tool has it.
_LARGEST_BYTES = 4_000_000_000  # Of a recording, of which one moment is read.
_LEAST_SURE = 1  # Of Record3D's 0, 1 and 2: depths that its sensor itself takes for guesses are left out.
_EXPECTED = (
    "expected a TUM folder (rgb.txt, depth.txt), or Record3D's .r3d file or EXR export (metadata.json, rgb, depth)"
)


@dataclass(frozen=True)
class Capture:
    """One moment of a recording.

    Attributes:
        picture, depth: As they were recorded, of one size.
        camera: None where the recording does not say.
    """

    picture: Photograph
    depth: Depth
    camera: Intrinsics | None


def is_capture(path: Path) -> bool:
    """Decides whether a path is a recording and no picture."""
    return path.is_dir() or path.suffix.lower() == ".r3d"


def read_capture(path: Path, frame: int | None = None) -> Capture:
    """Returns one moment of a recording.

    Args:
        path: A folder, or an .r3d file.
        frame: Which picture, counted from 0; by default the one in the middle.

    Raises:
        PhotoRefused: It is no recording of a known form, has no such moment, or what it has cannot be used.
        MissingExtra: What reads its depths is not installed.
        OSError: A file cannot be read.
    """
    if path.suffix.lower() == ".r3d":
        return _packed(path, frame)
    if (path / "rgb.txt").is_file() and (path / "depth.txt").is_file():
        return _tum(path, frame)
    for folder in (path, path / "EXR_RGBD"):
        if (folder / "metadata.json").is_file():
            return _exported(folder, frame)
    raise PhotoRefused("picture", path, "is no recording of a known form", _EXPECTED)


def _tum(folder: Path, frame: int | None) -> Capture:
    pictures, depths = _listed(folder / "rgb.txt"), _listed(folder / "depth.txt")
    time_s, name = pictures[_chosen(folder, len(pictures), frame)]
    nearest_s, depth = min(depths, key=lambda one: abs(one[0] - time_s))
    if abs(nearest_s - time_s) > _TOGETHER_S:
        problem = f"no depth was measured within {_TOGETHER_S:g} s of the picture {name}"
        raise PhotoRefused("depth", folder / "depth.txt", problem, "choose another one by --frame")
    picture = read_picture(_beneath(folder, name))
    camera = next((key for key in _TUM_CAMERAS if key in folder.resolve().name), None)
    known = None
    if camera is not None:
        fx, fy, cx, cy = _TUM_CAMERAS[camera]
        known = Intrinsics(fx, fy, cx + 0.5, cy + 0.5, f"TUM's calibration of {camera}")
    return Capture(picture, read_depth(_beneath(folder, depth), picture.size_px, _TUM_UNIT_M), known)


def _listed(path: Path) -> list[tuple[float, str]]:
    """What a list of TUM names: times in seconds, and files."""
    found = []
    for number, line in enumerate(read_bounded_text(path).splitlines(), start=1):
        words = line.split()
        if not words or line.startswith("#"):
            continue
        try:
            found.append((float(words[0]), words[1]))
        except (ValueError, IndexError) as error:
            raise PhotoRefused("picture", path, f"line {number} is no time and file: {line!r}", _EXPECTED) from error
    if not found:
        raise PhotoRefused("picture", path, "names no file", _EXPECTED)
    return found


def _beneath(folder: Path, name: str) -> Path:
    """A file that a list names, which has to be in the list's own folder."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise PhotoRefused("picture", folder, f"names {name!r}, which is outside of it")
    return path


def _exported(folder: Path, frame: int | None) -> Capture:
    try:
        said = _metadata(folder, json.loads(read_bounded_text(folder / "metadata.json")))
    except (ValueError, RecursionError) as error:
        raise PhotoRefused("picture", folder / "metadata.json", f"is no JSON ({error})", _EXPECTED) from error
    numbers = sorted(int(one.stem) for one in (folder / "depth").glob("*.exr") if one.stem.isdecimal())
    number = numbers[_chosen(folder, len(numbers), frame)]
    shown = next((one for one in sorted((folder / "rgb").glob(f"{number}.*"))), None)
    if shown is None:
        raise PhotoRefused("picture", folder, f"has depth/{number}.exr and no picture of that number in rgb")
    path = folder / "depth" / f"{number}.exr"
    return _together(path, read_picture(shown), read_exr(path), said, number)


def _packed(path: Path, frame: int | None) -> Capture:
    if path.stat().st_size > _LARGEST_BYTES:
        raise PhotoRefused("picture", path, f"is larger than {_LARGEST_BYTES / 1e9:g} GB", "export fewer seconds")
    try:
        with zipfile.ZipFile(path) as archive:
            said = _metadata(path, json.loads(_member(path, archive, "metadata")))
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
    return _together(path, picture, values, said, number)


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


def _together(source: Path, picture: Photograph, values: np.ndarray, said: Mapping[str, Any], number: int) -> Capture:
    """A picture with its smaller depth, which is made as large by its nearest values: what lies between is unknown."""
    width, height = picture.size_px
    depth = np.asarray(
        Image.fromarray(np.nan_to_num(values.astype(np.float32))).resize((width, height), Image.Resampling.NEAREST)
    )
    told = f"frame {number} of {source.name}, {values.shape[1]} x {values.shape[0]} depths in metres"
    return Capture(picture, checked_depth(source, depth, picture.size_px, 1.0, told), _camera(said, picture, number))


def _camera(said: Mapping[str, Any], picture: Photograph, number: int) -> Intrinsics | None:
    each = said.get("perFrameIntrinsicCoeffs")
    width, height = picture.size_px
    try:
        if isinstance(each, Sequence) and number < len(each):
            fx, fy, cx, cy = (float(value) for value in each[number])
        else:
            # It is written column by column.
            K = np.asarray(said["K"], dtype=float).reshape(3, 3).T
            fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
        factor = width / float(said.get("w", width))
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
