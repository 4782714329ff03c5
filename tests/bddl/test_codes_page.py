"""The page about the codes says what the code says; `scripts/build_docs.py` writes it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from build_docs import example_message

import bddl

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "codes-bddl.md"
# Codes of which no short text is an example.
WITHOUT_EXAMPLE = {"unchecked-goal"}


def _sections() -> dict[str, str]:
    parts = re.split(r"^### `([a-z-]+)`$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {code: body.split("\n## ")[0] for code, body in zip(parts[1::2], parts[2::2], strict=True)}


def _entries() -> dict[str, dict[str, Any]]:
    text = (ROOT / "docs" / "codes.toml").read_text(encoding="utf-8")
    entries: dict[str, dict[str, Any]] = tomllib.loads(text)["bddl"]
    return entries


def test_every_code_has_a_section_and_every_section_a_code() -> None:
    sections = list(_sections())
    assert sorted(sections) == sorted(bddl.CODES) and sections == list(_entries())
    assert len(set(sections)) == len(sections)


@pytest.mark.parametrize("code", bddl.CODES)
def test_a_section_gives_the_meaning_and_the_message_of_its_code(code: bddl.Code) -> None:
    section, entry = _sections()[code], _entries()[code]
    assert section.strip().startswith(bddl.MEANINGS[code])
    examples = entry.get("examples", [])
    assert bool(examples) is (code not in WITHOUT_EXAMPLE)
    for example in examples:
        message = example_message(code, **example)
        assert f"\n````text\n{message}\n````" in section
        assert f"[{code}]" in message
    assert len(entry["advice"]) > 20


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
