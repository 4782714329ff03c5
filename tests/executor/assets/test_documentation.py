"""The documentation's table is the library's."""

from __future__ import annotations

from executor.assets.library import LIBRARY, kind
from executor.assets.parameters import Entry
from tests.source_tree import ROOT


def row(entry: Entry) -> str:
    """Returns a model's line of the table in docs/assets.md."""
    size = f"{entry.length}, {entry.width}, {entry.height}"
    parameters = ", ".join(
        f"`{parameter}`" for parameter in entry.parameters if not str(parameter).startswith("handle_")
    )
    what = {"articulated fixture": "A, articulated", "support": "A, support", "item": "B"}[kind(entry).value]
    return f"| `{entry.model}` | `{entry.category}` | {entry.synset} | {what} | {size} | {parameters} |"


def test_the_table_of_the_page_is_up_to_date() -> None:
    page = (ROOT / "docs" / "assets.md").read_text(encoding="utf-8")
    missing = [row(entry) for entry in LIBRARY.values() if row(entry) not in page]
    assert not missing, "docs/assets.md lacks:\n" + "\n".join(missing)
