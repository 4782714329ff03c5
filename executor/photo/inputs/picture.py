"""The picture: its pixels, and what its file says of the camera that took it."""

from __future__ import annotations

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
    content = read_bounded(path, MOST_BYTES) if content is None else content
    try:
        with Image.open(BytesIO(content)) as image:
            width, height = image.size
            if max(width, height) > MOST_SIDE_PX:
                raise PhotoRefused(
                    "picture",
                    path,
                    f"the picture has {width} x {height} pixels; at most {MOST_SIDE_PX} on a side are used",
                    "scale it and its depth down, 640 to 1600 pixels are plenty, or cut out what matters",
                )
            if min(width, height) < LEAST_SIDE_PX:
                problem = f"the picture has {width} x {height} pixels; at least {LEAST_SIDE_PX} on a side are needed"
                raise PhotoRefused("picture", path, problem)
            image.load()
            exif = _exif(image)
            rgb = np.asarray(ImageOps.exif_transpose(image).convert("RGB"), dtype=np.uint8)
    except PhotoRefused:
        raise
    except UnidentifiedImageError as error:
        # Its own words have an address in memory.
        problem = "cannot be read as a picture (no known format)"
        raise PhotoRefused("picture", path, problem, "expected a PNG, JPEG or another usual picture") from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        hint = "expected a PNG, JPEG or another usual picture, all of it"
        raise PhotoRefused("picture", path, f"cannot be read as a picture ({error})", hint) from error
    return Photograph(path, rgb, exif)


def _exif(image: Image.Image) -> Exif:
    tags = image.getexif()
    details = tags.get_ifd(ExifTags.IFD.Exif)
    focal = details.get(ExifTags.Base.FocalLengthIn35mmFilm)
    width, height = details.get(ExifTags.Base.ExifImageWidth), details.get(ExifTags.Base.ExifImageHeight)
    camera = " ".join(str(tags[tag]).strip("\0 ") for tag in (ExifTags.Base.Make, ExifTags.Base.Model) if tag in tags)
    size = (width, height) if isinstance(width, int) and isinstance(height, int) and min(width, height) > 0 else None
    # Zero says that it is not known.
    return Exif(float(focal) if focal else None, size, camera)
