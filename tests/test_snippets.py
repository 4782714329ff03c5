"""The Python in the documents: every piece is whole, so that it can be copied and run."""

from __future__ import annotations

import ast
import builtins
import doctest
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def snippets(page: Path) -> list[str]:
    """Return the pieces of Python of a page; of a dialogue with the interpreter, what was typed."""
    found = SNIPPET.findall(page.read_text(encoding="utf-8"))
    typed = doctest.DocTestParser().get_examples
    return ["".join(line.source for line in typed(text)) if ">>> " in text else text for text in found]


def bound(tree: ast.AST) -> set[str]:
    """Return the names that a piece gives a meaning."""
    names: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                names.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.Import(names=imported) | ast.ImportFrom(names=imported):
                names |= {(entry.asname or entry.name).partition(".")[0] for entry in imported}
    return names


def test_there_are_snippets() -> None:
    assert sum(len(snippets(page)) for page in PAGES) >= 10


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_snippet_names_nothing_that_neither_it_nor_one_before_it_has(page: Path) -> None:
    known = set(dir(builtins))
    for text in snippets(page):
        tree = ast.parse(text)
        known |= bound(tree)
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        assert used <= known, f"{page.name}: {sorted(used - known)} in\n{text}"
