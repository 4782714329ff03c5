"""The picture: its pixels, and what its file says of the camera that took it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError

from bddl.files import read_bounded
from executor.photo.refusal import PhotoRefused

MOST_SIDE_PX = 4096
"""Larger pictures show nothing more of furniture, and each array of them takes hundreds of megabytes."""

LEAST_SIDE_PX = 64
MOST_BYTES = 64_000_000

_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "JPEG2000")
"""Of the library's many, those that cameras write; there is one for which it would start a program."""

_SCALE_IT = "scale it and its depth down, 640 to 1600 pixels are plenty, or cut out what matters"


@dataclass(frozen=True)
class Exif:
    """What a picture's file says of its camera.

    Attributes:
        focal_35mm: Focal length in mm as on film of 36 x 24 mm, or None.
        size_px: Width and height that the camera wrote, or None; another shape than the picture's means that it was
            cut out of a larger one.
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
        rgb: (H, W, 3) uint8, turned upright as its file says.
        exif: What the file says of the camera.
    """

    source: Path
    rgb: NDArray[np.uint8]
    exif: Exif

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.rgb.shape[1], self.rgb.shape[0]


def read_picture(path: Path, content: bytes | None = None) -> Photograph:
    """Returns a picture of any usual format.

    Args:
        path: Its file.
        content: What is in it, where that was read already, as out of an archive.

    Raises:
        PhotoRefused: It is no picture, ends in the middle, or is too large or too small.
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
        # Its own words have an address in memory.
        raise _unreadable(path, kind, "no known format", expected) from error
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        problem = f"the {kind} has over 80 megapixels; at most {MOST_SIDE_PX} pixels on a side are used"
        raise PhotoRefused(kind, path, problem, _SCALE_IT) from error
    except Exception as error:
        # Of what can be wrong with a picture, the library raises some ten kinds.
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
    # Zero says that it is not known.
    return Exif(float(focal) if focal else None, size, camera)
