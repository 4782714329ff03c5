"""HTML text without mistakes: everything that comes from outside is escaped here."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from executor.pictures.frames import Picture
from executor.records.captions import number_text


def text(value: object) -> str:
    """Returns a value as HTML text that cannot be markup."""
    return html.escape(str(value), quote=True)


def badge(words: str, tone: str) -> str:
    """Returns a small label; the tone is "good", "bad", "warn" or "quiet"."""
    return f'<span class="badge {tone}">{text(words)}</span>'


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """Returns a list of names and values; the values are HTML already."""
    return "<dl>" + "".join(f"<div><dt>{text(name)}</dt><dd>{value}</dd></div>" for name, value in rows) + "</dl>"


def measurements(values: Mapping[str, object]) -> str:
    """Returns measured values with their names made readable; units stay in the names."""
    if not values:
        return ""
    return facts((name.replace("_", " "), text(value_text(value))) for name, value in values.items())


def value_text(value: object) -> str:
    """Returns a measured value for people: numbers with four digits, lists in brackets."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {value_text(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(value_text(entry) for entry in value) or "none"
    return "none" if value is None else number_text(value)


def jpeg_uri(picture: Picture, quality: int = 80) -> str:
    """Returns a picture (H, W, 3) as a data URI."""
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="JPEG", quality=quality, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def picture_tag(uri: str, alt: str, size: tuple[int, int]) -> str:
    """Returns a picture as an element that has its place on the page before it is loaded.

    Args:
        uri: Where its data are.
        alt: What it shows.
        size: Width and height in pixels.
    """
    return f'<img loading="lazy" width="{size[0]}" height="{size[1]}" alt="{text(alt)}" src="{uri}">'


def video_uri(path: Path) -> str:
    """Returns an MP4 file as a data URI."""
    return "data:video/mp4;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
