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


def jpeg_uri(picture: Picture) -> str:
    """Returns a picture (H, W, 3) as a data URI."""
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="JPEG", quality=80, optimize=True)
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


_LIGHT = {
    "bg": "#f6f7f9",
    "card": "#fff",
    "ink": "#1c2128",
    "soft": "#5b6472",
    "line": "#dfe3e8",
    "accent": "#1f6feb",
    "good": "#1a7f37",
    "good-bg": "#dafbe1",
    "bad": "#b42318",
    "bad-bg": "#fee4e2",
    "warn": "#8a5a00",
    "warn-bg": "#fff1cc",
    "quiet-bg": "#e9ecf0",
    "code": "#f0f2f5",
}

GRAPH_RULES = """\
.graph text{font-family:system-ui,-apple-system,"Segoe UI",Roboto,sans-serif;fill:var(--ink)}
.graph .small{fill:var(--soft)}
.graph .node{fill:var(--card);stroke:var(--line);stroke-width:1.5}
.graph .done{fill:var(--good-bg);stroke:var(--good)}
.graph .failed{fill:var(--bad-bg);stroke:var(--bad);stroke-width:2.5}
.graph .edge{stroke:var(--soft);stroke-width:1.5;fill:none}
.graph .transfer{stroke:var(--accent);stroke-dasharray:5 4}
.graph .broken{stroke:var(--bad);stroke-width:2.5}
.graph .head{fill:var(--soft)}
"""

EVOLUTION_RULES = """\
.attempts{display:grid;grid-template-columns:repeat(auto-fit,minmax(280px,1fr));gap:12px;margin-top:12px}
.attempt{border:1px solid var(--line);border-radius:10px;padding:12px 14px;min-width:0}
.attempt.won{border-color:var(--good)}.attempt.lost{border-color:var(--bad)}
.flow{list-style:none;padding:0;margin:10px 0;font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;
font-size:12.5px}
.flow li{padding:1px 6px;border-radius:5px;overflow-wrap:anywhere}
.flow .new{background:var(--good-bg);color:var(--good)}
.flow .gone{color:var(--soft);text-decoration:line-through}
.flow .at-fault{box-shadow:inset 3px 0 0 var(--bad)}
.attempt .strip img{width:84px}
.therefore{border-top:1px solid var(--line);margin-top:10px;padding-top:8px}
"""

_ROOT = f":root{{color-scheme:light dark;{';'.join(f'--{name}:{colour}' for name, colour in _LIGHT.items())}}}"

_BEFORE = """\
@media (prefers-color-scheme:dark){:root{--bg:#0f1216;--card:#171b21;--ink:#e6e9ee;--soft:#9aa4b2;--line:#2b313a;
--accent:#6cb0ff;--good:#56d364;--good-bg:#12301c;--bad:#ff8f85;--bad-bg:#3c1613;--warn:#f0c24b;--warn-bg:#352a0c;
--quiet-bg:#262c35;--code:#1f252d}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
main{max-width:1080px;margin:0 auto;padding:32px 20px 64px}
h1{font-size:28px;line-height:1.2;margin:0 0 8px;letter-spacing:-.01em}
h2{font-size:19px;margin:40px 0 12px}
h3{font-size:16px;margin:0}
p{margin:6px 0}
.lead{color:var(--soft);font-size:16px;margin:0 0 14px;max-width:75ch}
.soft{color:var(--soft)}
.badge{display:inline-block;border-radius:999px;padding:2px 11px;font-size:13px;font-weight:600;white-space:nowrap;
background:var(--quiet-bg);color:var(--soft)}
.badge.good{background:var(--good-bg);color:var(--good)}
.badge.bad{background:var(--bad-bg);color:var(--bad)}
.badge.warn{background:var(--warn-bg);color:var(--warn)}
.row{display:flex;flex-wrap:wrap;gap:8px;align-items:center}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:16px 18px;margin:12px 0}
.card.bad{border-color:var(--bad)}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(140px,1fr));gap:10px;margin:18px 0 0}
.figures div{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:10px 14px}
.figures b{display:block;font-size:20px;font-variant-numeric:tabular-nums;line-height:1.3}
.figures span{color:var(--soft);font-size:13px}
video{width:100%;border-radius:12px;background:#000;display:block}
code,pre{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;font-size:13px}
code{background:var(--code);border-radius:5px;padding:1px 5px;overflow-wrap:anywhere}
pre{background:var(--code);border-radius:8px;padding:12px;overflow-x:auto;margin:8px 0;white-space:pre-wrap}
dl{margin:8px 0 0;display:flex;flex-wrap:wrap;gap:6px 20px}
dl div{min-width:0}
dt{color:var(--soft);font-size:12px}
dd{margin:0;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
table{border-collapse:collapse;width:100%;font-size:14px}
th,td{text-align:left;vertical-align:top;padding:6px 10px 6px 0;border-bottom:1px solid var(--line)}
th{color:var(--soft);font-weight:600;font-size:12px}
.scroll{overflow-x:auto}
details>summary{cursor:pointer}
details.step{border-top:1px solid var(--line);padding:10px 0}
details.step>summary{display:flex;gap:10px;align-items:baseline;flex-wrap:wrap;list-style:none}
details.step>summary::-webkit-details-marker{display:none}
details.step>summary::before{content:"\\25B8";color:var(--soft)}
details.step[open]>summary::before{content:"\\25BE"}
.name{font-weight:600;font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;font-size:13.5px}
.time{color:var(--soft);font-size:13px;font-variant-numeric:tabular-nums;margin-left:auto}
button.seek{font:inherit;font-size:13px;border:0;background:none;color:var(--accent);cursor:pointer;padding:0}
.strips{display:flex;flex-wrap:wrap;gap:6px 14px;margin-top:8px}
.strip{display:flex;flex-wrap:wrap;gap:4px;align-items:center}
.strip span{font-size:12px;color:var(--soft);width:40px}
.strip img{width:146px;height:auto;border-radius:6px;display:block}
ul.plain{list-style:none;padding:0;margin:6px 0}
ul.plain li{margin:3px 0}
.tick{font-weight:700;color:var(--good)}.cross{font-weight:700;color:var(--bad)}
.graph{overflow-x:auto}
.graph svg{display:block;min-width:680px;width:100%;height:auto}
"""

_AFTER = """\
footer{color:var(--soft);font-size:13px;margin-top:40px}
@media (max-width:640px){.strip img{width:96px}.strip span{width:100%}}
@media print{details{break-inside:avoid}video{display:none}}
"""

STYLE = f"\n{_ROOT}\n{_BEFORE}{GRAPH_RULES}{EVOLUTION_RULES}{_AFTER}"

SCRIPT = """
document.querySelectorAll("button.seek").forEach(function(button){button.addEventListener("click",function(event){
event.preventDefault();var video=document.querySelector("video");if(!video)return;
video.currentTime=parseFloat(button.dataset.at);video.play();video.scrollIntoView({behavior:"smooth",block:"center"})})});
"""


def in_light_colours(rules: str) -> str:
    """Returns style rules with the palette's names replaced by colours, for a file that no page styles."""
    for name, colour in _LIGHT.items():
        rules = rules.replace(f"var(--{name})", colour)
    return rules
