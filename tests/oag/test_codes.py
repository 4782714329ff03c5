"""The registry of codes, the documentation and the code agree."""

from __future__ import annotations

import re
from pathlib import Path

import oag

ROOT = Path(__file__).parent.parent.parent


def test_every_code_has_a_section_and_every_section_a_code() -> None:
    text = (ROOT / "docs" / "codes.md").read_text(encoding="utf-8")
    sections = re.findall(r"^### `([a-z/-]+)`$", text, flags=re.MULTILINE)
    assert sections == list(oag.CODES)


def test_the_documentation_gives_the_same_meaning_and_label() -> None:
    text = (ROOT / "docs" / "codes.md").read_text(encoding="utf-8")
    for code, info in oag.CODES.items():
        section = text.split(f"### `{code}`\n", 1)[1].split("\n### ", 1)[0]
        assert info.meaning in section, code
        assert (f"EAI label: {info.eai}" in section) is (info.eai is not None), code


def test_every_code_is_used() -> None:
    source = "".join(
        path.read_text(encoding="utf-8") for path in sorted((ROOT / "oag").rglob("*.py")) if path.name != "codes.py"
    )
    unused = [code for code in oag.CODES if f'"{code}"' not in source]
    assert not unused


def test_no_other_code_is_used() -> None:
    families = "|".join(sorted({code.split("/")[0] for code in oag.CODES}))
    for path in sorted((ROOT / "oag").rglob("*.py")):
        used = set(re.findall(rf'"((?:{families})/[a-z-]+)"', path.read_text(encoding="utf-8")))
        assert used <= set(oag.CODES), path.name
