"""Pages are templates filled with data: outside text is escaped there, and pages need no network."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from bddl.terminal import pluralize
from executor.records import action_text, number_text, readable
from executor.sim.render.frames import Picture
from executor.system.files import plain

if TYPE_CHECKING:
    from jinja2 import Environment

REPORT = "report.html"
"""Name of a page beside the results that it is about."""
_FILES = resources.files(__package__)


def render(template: str, **data: object) -> str:
    """Return a template of this package, such as "run.html", filled with data."""
    return _templates().get_template(template).render(data)


@cache
def _templates() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    folder = _FILES / "templates"
    found = Environment(
        loader=FunctionLoader(lambda name: (folder / name).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    functions = (style, script, policy, data_uri, size_px, pluralize, readable, action_text)
    found.globals |= {function.__name__: function for function in functions}
    return found


def style(*names: str) -> str:
    """Return style sheets of this package, one after the other: "page", "graph", "bench"."""
    return "\n".join((_FILES / "data" / f"{name}.css").read_text(encoding="utf-8") for name in names)


def script(name: str) -> str:
    """Return a script of this package: "episode", "run", "view"."""
    return (_FILES / "data" / f"{name}.js").read_text(encoding="utf-8")


@cache
def policy(*scripts: str) -> str:
    """Return the content-security policy of a page: it asks no other host, and runs only these scripts of this package.

    A name or a sentence of others that got past the escaping could load and send nothing.
    """
    digests = (hashlib.sha256(script(name).encode()).digest() for name in scripts)
    runs = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests) or "'none'"
    own = "'self' data: blob:"
    return (
        f"default-src 'none'; script-src {runs}; style-src 'unsafe-inline'; img-src {own}; media-src {own}; "
        "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'"
    )


def in_light_colours(rules: str) -> str:
    """Return style rules with the palette's names replaced by colours, for a file without a page's style."""
    light = re.findall(r"--([\w-]+):([^;}]+)", style("page").partition("@media")[0])
    for name, colour in light:
        rules = rules.replace(f"var(--{name})", colour)
    return rules


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


def script_json(data: object) -> str:
    """Return data as JSON that cannot end the script element which it stands in."""
    return json.dumps(plain(data), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def data_uri(data: bytes, kind: str) -> str:
    """Return a file's content as a data URI; the kind is its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def jpeg(picture: Picture) -> bytes:
    """Return a picture (H, W, 3) as a JPEG file."""
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="JPEG", quality=80, optimize=True)
    return buffer.getvalue()


def size_px(picture: bytes) -> tuple[int, int]:
    """Return width and height of an encoded picture [px]."""
    return Image.open(BytesIO(picture)).size
