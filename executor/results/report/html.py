"""HTML text without mistakes: everything that comes from outside is escaped here, and pages need no network."""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Iterable, Mapping
from importlib import resources
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from executor.pictures.frames import Picture
from executor.records.captions import number_text

_DATA = resources.files(__package__) / "data"


def text(value: object) -> str:
    """Returns a value as HTML text that cannot be markup."""
    return html.escape(str(value), quote=True)


def style(*names: str) -> str:
    """Returns style sheets of this package, one after the other: "page", "graph", "bench"."""
    return "\n".join((_DATA / f"{name}.css").read_text(encoding="utf-8") for name in names)


def in_light_colours(rules: str) -> str:
    """Returns style rules with the palette's names replaced by colours, for a file that no page styles."""
    light = re.findall(r"--([\w-]+):([^;}]+)", style("page").partition("@media")[0])
    for name, colour in light:
        rules = rules.replace(f"var(--{name})", colour)
    return rules


def document(title: str, body: Iterable[str], sheet: str, script: str = "") -> str:
    """Returns a whole page.

    Args:
        title: Plain text.
        body: HTML.
        sheet: Its style rules.
        script: What it does.
    """
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{text(title)}</title><style>{sheet}</style></head>"
        f"<body><main>{''.join(body)}<footer>Written by scene2demo.</footer></main>"
        f"{f'<script>{script}</script>' if script else ''}</body></html>\n"
    )


def card(*parts: str, kind: str = "") -> str:
    """Returns a framed block of HTML."""
    return f"<div class='{f'card {kind}'.strip()}'>{''.join(parts)}</div>"


def fold(head: str, *parts: str, kind: str = "", unfolded: bool = False) -> str:
    """Returns a block of HTML that is folded away behind a line of HTML."""
    style_class = f' class="{kind}"' if kind else ""
    is_open = " open" if unfolded else ""
    return f"<details{style_class}{is_open}><summary>{head}</summary>{''.join(parts)}</details>"


def soft(words: str) -> str:
    """Returns a paragraph of HTML that steps back."""
    return f"<p class='soft'>{words}</p>"


def badge(words: str, tone: str) -> str:
    """Returns a small label; the tone is "good", "bad", "warn" or "quiet"."""
    return f'<span class="badge {tone}">{text(words)}</span>'


def bullets(items: Iterable[object], *, tag: str = "ul") -> str:
    """Returns a list of plain texts."""
    return f"<{tag}>{''.join(f'<li>{text(item)}</li>' for item in items)}</{tag}>"


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """Returns a list of names and values; the values are HTML already."""
    return "<dl>" + "".join(f"<div><dt>{text(name)}</dt><dd>{value}</dd></div>" for name, value in rows) + "</dl>"


def table(rows: Iterable[Iterable[str]], head: Iterable[str] = ()) -> str:
    """Returns a table; the cells are HTML already."""
    names = "".join(f"<th>{name}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table>{f'<thead><tr>{names}</tr></thead>' if names else ''}<tbody>{body}</tbody></table>"


def measurements(values: Mapping[str, object]) -> str:
    """Returns measured values with their names made readable; units stay in the names."""
    return facts((name.replace("_", " "), text(value_text(value))) for name, value in values.items()) if values else ""


def value_text(value: object) -> str:
    """Returns a measured value for people: numbers with four digits, lists in brackets, "none" where none is finite."""
    if isinstance(value, float) and not math.isfinite(value):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {value_text(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(value_text(entry) for entry in value) or "none"
    return "none" if value is None else number_text(value)


def data_uri(data: bytes, kind: str) -> str:
    """Returns a file's content as the address of itself; the kind is its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def jpeg(picture: Picture) -> bytes:
    """Returns a picture (H, W, 3) as a JPEG file."""
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="JPEG", quality=80, optimize=True)
    return buffer.getvalue()


def strip(view: str, pictures: Iterable[tuple[bytes, str]]) -> str:
    """Returns a row of pictures of one view, each with its place on the page before it is loaded.

    Args:
        view: What the row is called.
        pictures: JPEG files, each with what it shows.
    """
    shown = []
    for data, alt in pictures:
        width, height = Image.open(BytesIO(data)).size
        source = data_uri(data, "image/jpeg")
        shown.append(f'<img loading="lazy" width="{width}" height="{height}" alt="{text(alt)}" src="{source}">')
    return f'<div class="strip"><span>{text(view)}</span>{"".join(shown)}</div>'


def video(path: Path) -> str:
    """Returns an MP4 file as an element that plays it."""
    source = data_uri(path.read_bytes(), "video/mp4")
    return f"<video controls muted playsinline preload='metadata' src='{source}'></video>"
