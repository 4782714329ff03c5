"""HTML building blocks: outside text is escaped here, and pages need no network."""

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

from executor.records import number_text
from executor.sim.render.frames import Picture

_DATA = resources.files(__package__) / "data"


def text(value: object) -> str:
    """Return a value as escaped HTML text."""
    return html.escape(str(value), quote=True)


def style(*names: str) -> str:
    """Return style sheets of this package, one after the other: "page", "graph", "bench"."""
    return "\n".join((_DATA / f"{name}.css").read_text(encoding="utf-8") for name in names)


def in_light_colours(rules: str) -> str:
    """Return style rules with the palette's names replaced by colours, for a file without a page's style."""
    light = re.findall(r"--([\w-]+):([^;}]+)", style("page").partition("@media")[0])
    for name, colour in light:
        rules = rules.replace(f"var(--{name})", colour)
    return rules


def document(title: str, body: Iterable[str], sheet: str, script: str = "") -> str:
    """Return a whole page.

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
    """Return a framed block of HTML."""
    return f"<div class='{f'card {kind}'.strip()}'>{''.join(parts)}</div>"


def fold(head: str, *parts: str, kind: str = "", unfolded: bool = False) -> str:
    """Return a collapsible block of HTML under a line of HTML."""
    style_class = f' class="{kind}"' if kind else ""
    is_open = " open" if unfolded else ""
    return f"<details{style_class}{is_open}><summary>{head}</summary>{''.join(parts)}</details>"


def soft(words: str) -> str:
    """Return a paragraph of HTML in the muted style."""
    return f"<p class='soft'>{words}</p>"


def badge(words: str, tone: str) -> str:
    """Return a small label; the tone is "good", "bad", "warn" or "quiet"."""
    return f'<span class="badge {tone}">{text(words)}</span>'


def bullets(items: Iterable[object], *, tag: str = "ul") -> str:
    """Return a list of plain texts."""
    return f"<{tag}>{''.join(f'<li>{text(item)}</li>' for item in items)}</{tag}>"


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """Return a list of names and values; the values are HTML already."""
    return "<dl>" + "".join(f"<div><dt>{text(name)}</dt><dd>{value}</dd></div>" for name, value in rows) + "</dl>"


def table(rows: Iterable[Iterable[str]], head: Iterable[str] = ()) -> str:
    """Return a table; the cells are HTML already."""
    names = "".join(f"<th>{name}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table>{f'<thead><tr>{names}</tr></thead>' if names else ''}<tbody>{body}</tbody></table>"


def measurements(values: Mapping[str, object]) -> str:
    """Return measured values with their names made readable; units stay in the names."""
    return facts((name.replace("_", " "), text(value_text(value))) for name, value in values.items()) if values else ""


def value_text(value: object) -> str:
    """Return a measured value for people: numbers with four digits, lists in brackets, "none" where none is finite."""
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
    """Return a file's content as a data URI; the kind is its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def jpeg(picture: Picture) -> bytes:
    """Return a picture (H, W, 3) as a JPEG file."""
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="JPEG", quality=80, optimize=True)
    return buffer.getvalue()


def strip(view: str, pictures: Iterable[tuple[bytes, str]]) -> str:
    """Return a row of pictures of one view, each with its size reserved before it is loaded.

    Args:
        view: Label of the row.
        pictures: JPEG files, each with its alternative text.
    """
    shown = []
    for data, alt in pictures:
        width, height = Image.open(BytesIO(data)).size
        source = data_uri(data, "image/jpeg")
        shown.append(f'<img loading="lazy" width="{width}" height="{height}" alt="{text(alt)}" src="{source}">')
    return f'<div class="strip"><span>{text(view)}</span>{"".join(shown)}</div>'


def video(path: Path) -> str:
    """Return an MP4 file as an element that plays it."""
    source = data_uri(path.read_bytes(), "video/mp4")
    return f"<video controls muted playsinline preload='metadata' src='{source}'></video>"
