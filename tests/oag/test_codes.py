"""The registry of codes, the documentation and the code agree."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import oag

ROOT = Path(__file__).parent.parent.parent


PAGES = ROOT / "docs" / "codes"


def test_every_code_has_a_page_and_every_page_a_code() -> None:
    pages = {str(page.relative_to(PAGES).with_suffix("")) for page in PAGES.rglob("*.md")} - {"README"}
    assert pages == set(oag.CODES)


def test_the_list_names_every_page_in_order_with_its_meaning() -> None:
    text = (PAGES / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[`([a-z/-]+)`\]\(([a-z/-]+)\.md\) \| .* \| (.*) \|$", text, flags=re.MULTILINE)
    assert rows == [(code, code, info.meaning) for code, info in oag.CODES.items()]


@pytest.mark.parametrize("code", oag.CODES)
def test_a_page_gives_the_same_meaning_and_label(code: str) -> None:
    page, info = (PAGES / f"{code}.md").read_text(encoding="utf-8"), oag.CODES[code]
    assert page.startswith(f"# `{code}`\n\n{info.meaning}")
    assert (f"EAI label: {info.eai}" in page) is (info.eai is not None)
    assert "Severity: " in page


@pytest.mark.parametrize("page", sorted(PAGES.rglob("*.md")), ids=lambda page: page.stem)
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


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
