"""Write the generated pages of the documentation: the command line and the two pages of diagnostic codes.

`make docs` runs it before mkdocs. Options come from the command line's own help, meanings from the code, messages from
the analyser; `docs/codes.toml` has the examples and the advice.
"""

from __future__ import annotations

import io
import os
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from itertools import groupby
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
# Objects that the examples of formulas name, with their categories.
OBJECTS = {
    "glass_0": "glass",
    "glass_1": "glass",
    "apple_0": "apple",
    "table_0": "table",
    "refrigerator_0": "refrigerator",
    "cabinet_0": "cabinet",
}
_OF_EVERY_COMMAND = {"-h, --help", "--json", "--debug"}
# Wide enough that an option and its help stand in few lines, and too narrow for groups of options side by side.
_WIDTH = "120"


def main() -> None:
    """Write every generated page that differs from what its file holds."""
    for path, text in pages().items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"written: {path.relative_to(ROOT)}")


def pages() -> dict[Path, str]:
    """Return path -> text of each generated page."""
    return {
        DOCS / "cli.md": command_page(),
        DOCS / "codes.md": plan_codes_page(),
        DOCS / "codes-bddl.md": language_codes_page(),
    }


def command_page() -> str:
    """Return the page of the command line: one table of options a command."""
    parts = [
        "# Command line",
        "This page is generated from the option classes in `executor/cli` by `scripts/build_docs.py`.",
        "Every command also takes `--help`, `--json` (print one JSON object) and `--debug` (show the traceback of an "
        "unexpected error).",
        "| exit code | meaning |\n|---|---|\n"
        + "\n".join(f"| {code} | {meaning} |" for code, meaning in _EXIT_CODES.items()),
        "| environment variable | effect |\n|---|---|\n"
        + "\n".join(f"| `{name}` | {effect} |" for name, effect in _ENVIRONMENT.items()),
    ]
    for words in _command_names():
        parts += _command(words, _help(*words))
    return "\n\n".join(parts) + "\n"


_EXIT_CODES = {
    0: "done",
    1: "the work ran and failed: a refuted plan, a failed rollout",
    2: "bad input or misuse, with one message",
    3: "the disk is full",
    130: "ended by Ctrl-C",
    141: "nothing reads the output any more, as after `head`",
}
_ENVIRONMENT = {
    "SCENE2DEMO_CACHE": "Folder for generated meshes; by default `~/.cache/scene2demo`.",
    "SCENE2DEMO_ASSETS": "Folder for imported assets; by default `~/.local/share/scene2demo/assets`.",
    "SCENE2DEMO_PROFILES": "TOML file with profiles of language models.",
    "SCENE2DEMO_TORCH_INDEX": "Package index for PyTorch, read by the set-up.",
}


def _command_names() -> Iterator[tuple[str, ...]]:
    from executor.cli.app import commands, second_words

    for name, options in commands().items():
        if seconds := second_words(options):
            yield from ((name, second) for second in seconds)
        else:
            yield tuple(name.split(" "))


def _help(*words: str) -> str:
    """Return what `--help` of a command prints."""
    from executor.cli.app import run

    os.environ |= {"COLUMNS": _WIDTH, "NO_COLOR": "1", "TERM": "dumb"}
    # The parser draws its boxes only where it can encode them.
    with io.TextIOWrapper(io.BytesIO(), encoding="utf-8") as out:
        with redirect_stdout(out):
            run([*words, "--help"])
        out.seek(0)
        return out.read()


def _command(words: tuple[str, ...], text: str) -> Iterator[str]:
    """Yield the heading, the description and the table of options of a command's help."""
    head, *panels = text.split("╭")
    usage, _, description = head.partition("\n\n")
    operands = re.split(r" (?=\[?--)", re.sub(r" \[[\w -]*OPTIONS\]| \[-h\]", "", " ".join(usage.split())))[0]
    name = f"scene2demo {' '.join(words)}"
    for typed in ("usage: ", name):
        operands = operands.removeprefix(typed)
    yield f"## {name}{operands}\n{' '.join(description.split())}"
    rows = [row for panel in panels for row in _options(panel)]
    if rows:
        yield "| option | meaning |\n|---|---|\n" + "\n".join(
            f"| `{_cell(option)}` | {_cell(meaning)} |" for option, meaning in rows
        )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _options(panel: str) -> Iterator[tuple[str, str]]:
    """Yield each option of a panel with its meaning."""
    lines = [line.strip("│")[1:].rstrip() for line in panel.splitlines()[1:] if line.startswith("│")]
    rule = next((index for index, line in enumerate(lines) if line.startswith("──")), -1)
    found: list[list[str]] = []
    for line in lines[rule + 1 :]:
        if line[:1].strip():
            name, _, meaning = re.sub(r" {2,}", "\t", line, count=1).partition("\t")
            found.append([name, meaning])
        elif found:
            found[-1].append(line.strip())
    for name, *words in found:
        if name not in _OF_EVERY_COMMAND:
            yield name, " ".join(filter(None, words))


def plan_codes_page() -> str:
    """Return the page of the codes of plans."""
    from oag.model.diagnostics import CODES

    told = _data()["oag"]
    parts = [_PLAN_CODES_HEAD]
    for chapter, codes in groupby(CODES, key=lambda code: told[code]["chapter"]):
        parts.append(f"## {chapter}")
        for code in codes:
            info, more = CODES[code], told[code]
            label = more.get("eai", info.eai)
            eai = f" EAI label: {label}." if label else ""
            advice = f" {more['advice']}" if more["advice"] else ""
            parts.append(f"### `{code}`\n{info.meaning} Severity: {more['severity']}.{eai}{advice}")
    return "\n\n".join(parts) + "\n"


def language_codes_page() -> str:
    """Return the page of the language's codes, each example with the message that the analyser gives."""
    import bddl

    parts = [_LANGUAGE_CODES_HEAD]
    entries: Mapping[str, Any] = _data()["bddl"]
    for chapter, codes in groupby(entries, key=lambda code: entries[code]["chapter"]):
        parts.append(f"## {chapter}")
        for code in codes:
            entry = entries[code]
            messages = [example_message(code, **example) for example in entry.get("examples", ())]
            blocks = "".join(f"\n````text\n{message}\n````" for message in messages)
            parts.append(f"### `{code}`\n{bddl.MEANINGS[code]} {entry['advice']}{blocks}")  # type: ignore[index]
    parts.append(_SLIPS_HEAD)
    parts.append(
        "| slip | what goes wrong |\n|---|---|\n" + "\n".join(f"| `{s}` | {t} |" for s, t in bddl.SLIPS.items())
    )
    return "\n\n".join(parts) + "\n"


def example_message(code: str, text: str, profile: str | None = None) -> str:
    """Return what the analyser reports about an example with one code."""
    import bddl

    found = bddl.analyse(text, profile or "scene", OBJECTS if profile is None else None)
    return "\n".join(f"{item.severity}: {item}" for item in found if item.code == code)


def _data() -> dict[str, Any]:
    return tomllib.loads((DOCS / "codes.toml").read_text(encoding="utf-8"))


_PLAN_CODES_HEAD = """\
# Diagnostic codes of plans

`verify` reports findings as diagnostics. A diagnostic has a code, a severity and a place.
Where it applies, it has the literal that was needed, the step that wrote its value, and a start state that fails.
An *error* refutes the plan. A *warning* and a *note* do not.
The EAI label is the name of the same mistake in the taxonomy of the Embodied Agent Interface.
This page is generated from `CODES` of `oag.model.diagnostics` and `docs/codes.toml`.

Failures that only follow from a mistake are counted with it and not reported.
Where one change at one place mends several errors, the report shows the first one and names the others under `also`.
`report.errors` has all of them. [Plans and proofs](semantics.md#fixes) lists the kinds of fixes."""

_LANGUAGE_CODES_HEAD = """\
# Diagnostic codes of the language

`bddl.check`, `bddl.analyse` and `scene2demo bddl check FILE...` report mistakes as diagnostics.
A diagnostic has a code, a place and a hint.
An *error* excludes every reading of the text. A *warning* marks an unlikely reading. A *note* is information.
A profile may tolerate an error, which then becomes a warning.
This page is generated from `bddl.MEANINGS` and `docs/codes.toml`; the analyser writes the messages.

Examples use the profile `scene` and six objects: `glass_0`, `glass_1`, `apple_0`, `table_0`, `refrigerator_0`
and `cabinet_0`. Some examples of whole problems use another profile."""

_SLIPS_HEAD = """\
## Slips of language models

`Diagnostic.slip` has one of these labels where language models often make the mistake.
`bddl.correct` repairs what is certain."""


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
