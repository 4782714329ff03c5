"""What docs/bddl.md shows is what happens."""

from __future__ import annotations

import doctest

from bddl.dialects import FORM_SHAPES, PROFILES
from tests.source_tree import ROOT

PAGE = ROOT / "docs" / "bddl.md"


def test_the_examples_of_the_page_run() -> None:
    result = doctest.testfile(str(PAGE), module_relative=False, encoding="utf-8")
    assert result.attempted > 15 and result.failed == 0


def test_every_profile_and_every_form_is_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8")
    missing = [name for name in PROFILES if f"| `{name}`" not in text]
    missing += [form for form in FORM_SHAPES if f"| `({form} " not in text]
    assert not missing
