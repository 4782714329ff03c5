"""The registry of codes, the documentation and the code agree."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from oag.model.diagnostics import CODES

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "codes.md"


def _sections() -> dict[str, str]:
    parts = re.split(r"^### `([a-z/-]+)`$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {code: body.split("\n## ")[0] for code, body in zip(parts[1::2], parts[2::2], strict=True)}


def test_every_code_has_a_section_in_order_and_every_section_a_code() -> None:
    assert list(_sections()) == list(CODES)
    told = tomllib.loads((ROOT / "docs" / "codes.toml").read_text(encoding="utf-8"))["oag"]
    assert list(told) == list(CODES)


@pytest.mark.parametrize("code", CODES)
def test_a_section_gives_the_same_meaning_and_label(code: str) -> None:
    section, info = _sections()[code], CODES[code]
    assert section.startswith(f"\n{info.meaning} Severity: ")
    assert (f"EAI label: {info.eai}" in section) is (info.eai is not None)


def test_every_code_is_used() -> None:
    source = "".join(
        path.read_text(encoding="utf-8") for path in sorted((ROOT / "oag").rglob("*.py")) if path.name != "codes.py"
    )
    unused = [code for code in CODES if f'"{code}"' not in source]
    assert not unused


def test_no_other_code_is_used() -> None:
    families = "|".join(sorted({code.split("/")[0] for code in CODES}))
    for path in sorted((ROOT / "oag").rglob("*.py")):
        used = set(re.findall(rf'"((?:{families})/[a-z-]+)"', path.read_text(encoding="utf-8")))
        assert used <= set(CODES), path.name
