"""Pictures that are shown to a model: files as they are, told apart by their first bytes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bddl.files import read_bounded
from executor.cli.options.bad_option import BadOption
from llm import Image

LARGEST_BYTES = 20_000_000
_OPTION = "--image"


def scene_pictures(paths: Sequence[Path], model: str | None) -> tuple[Image, ...]:
    """Returns the pictures of the scene that module 1 is shown.

    Args:
        paths: As they were typed after `--image`.
        model: Who looks at them.

    Raises:
        BadOption: Nobody looks at them, or a file cannot be read, is too large, or is no picture that models take.
    """
    if paths and model is None:
        raise BadOption(_OPTION, paths[0], "--model beside it, since only a model looks at pictures")
    return tuple(map(_picture, paths))


def _picture(path: Path) -> Image:
    """Returns one picture."""
    try:
        data = read_bounded(path, LARGEST_BYTES)
    except OSError as error:
        raise BadOption(_OPTION, path, f"a picture's file ({error.strerror or error})") from None
    kind = _media_type(data)
    if kind is None:
        raise BadOption(_OPTION, path, "a picture in PNG, JPEG, WebP or GIF")
    return Image(data, kind)


def _media_type(data: bytes) -> str | None:
    """Returns what kind of picture the first bytes announce, None for another kind of file."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    if data.startswith((b"GIF87a", b"GIF89a")):
        return "image/gif"
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else None
