"""The page about the codes says what the code says; UPDATE_GOLDEN=1 writes its messages anew, to be read aloud."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

import bddl

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "codes-bddl.md"
OBJECTS = {
    "glass_0": "glass",
    "glass_1": "glass",
    "apple_0": "apple",
    "table_0": "table",
    "refrigerator_0": "refrigerator",
    "cabinet_0": "cabinet",
}
# Codes of which no short text is an example.
WITHOUT_EXAMPLE = {"unchecked-goal"}
_EXAMPLE = re.compile(
    r"(?:Profile `(?P<profile>[a-z-]+)`:\n\n)?````bddl\n(?P<text>.*?)\n````\n\n````text\n(?P<message>.*?)\n````",
    re.DOTALL,
)


def _sections() -> dict[str, str]:
    parts = re.split(r"^### `([a-z-]+)`$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {code: body.split("\n## ")[0] for code, body in zip(parts[1::2], parts[2::2], strict=True)}


def _message(code: str, text: str, profile: str | None) -> str:
    """Return what the analyser says about an example, as far as it concerns one code."""
    found = bddl.analyse(text, profile or "scene", OBJECTS if profile is None else None)
    return "\n".join(f"{item.severity}: {item}" for item in found if item.code == code)


def test_every_code_has_a_section_and_every_section_a_code() -> None:
    sections = list(_sections())
    assert sorted(sections) == sorted(bddl.CODES)
    assert len(set(sections)) == len(sections)


@pytest.mark.parametrize("code", bddl.CODES)
def test_a_section_gives_the_meaning_and_the_message_of_its_code(code: bddl.Code) -> None:
    section = _sections()[code]
    assert section.strip().startswith(bddl.MEANINGS[code])
    examples = list(_EXAMPLE.finditer(section))
    assert bool(examples) is (code not in WITHOUT_EXAMPLE)
    for example in examples:
        message = _message(code, example["text"], example["profile"])
        if os.environ.get("UPDATE_GOLDEN"):
            page = PAGE.read_text(encoding="utf-8")
            PAGE.write_text(page.replace(example["message"], message), encoding="utf-8")
        assert message == example["message"]
        assert f"[{code}]" in message
    advice = _EXAMPLE.sub("", section).split(bddl.MEANINGS[code], 1)[1].strip()
    assert len(advice) > 20


def test_a_diagnostic_names_its_section() -> None:
    (found,) = bddl.check("(ontop glass_0)")
    page, _, anchor = found.page.partition("#")
    assert (ROOT / page).is_file() and anchor == found.code == "wrong-arity"
    assert f"### `{anchor}`" in (ROOT / page).read_text(encoding="utf-8")


def test_every_slip_is_in_the_table() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| (.*) \|$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert dict(rows) == dict(bddl.SLIPS)


def test_every_code_is_used_and_no_other() -> None:
    """A code is used where a finding is made; the two tables that list codes do not count."""
    sources = [path for path in sorted((ROOT / "bddl").rglob("*.py")) if path.name not in ("codes.py", "catalogue.py")]
    source = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert [code for code in bddl.CODES if f'"{code}"' not in source] == []


def test_a_diagnostic_is_plain_data() -> None:
    (found,) = bddl.check("(on glass_0 table_0)")
    data = found.to_json()
    assert set(data) == {
        "code", "severity", "line", "column", "length", "message", "excerpt", "expected", "hint", "slip", "page",
    }  # fmt: skip
    assert (data["slip"], data["page"]) == ("predicate-synonym", "docs/codes-bddl.md#unknown-predicate")
