"""Every module is reached from a command or a public name, and the files that documents name exist."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from functools import cache

import networkx
import pytest

from tests.source_tree import PACKAGES, ROOT, Import, first_party_imports, modules, tree_of

# What other programs import by its name, as docs/environment.md says.
PLUGINS = ("executor.envs.lerobot",)


@cache
def resolved(target: str) -> str | None:
    """Returns the module that an imported name is defined in: itself, or where its package's list of names leads."""
    known = modules()
    if target in known:
        return target
    module, _, name = target.rpartition(".")
    if module not in known:
        return None
    if module in PACKAGES:
        place = getattr(importlib.import_module(module), "_PLACES", {}).get(name)
        if place is not None:
            return place if isinstance(place, str) else str(place[0])
    exported = first_party_imports(module, known[module]) if known[module].name == "__init__.py" else ()
    for found in exported:
        if found.target.rpartition(".")[2] == name and found.target != target:
            return resolved(found.target)
    return module


def used_names(tree: ast.Module) -> Iterator[str]:
    """Yields the names that a module takes from a package that it imports whole, such as `oag.compose`."""
    whole = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name in PACKAGES
    }
    known = modules()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in whole:
            yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in known:
            # A module that is loaded when it is needed is named in a string.
            yield node.value


@cache
def ways() -> networkx.DiGraph:
    """Returns the graph of all modules, with an arrow from each to those that it leads a reader to."""
    graph = networkx.DiGraph()
    graph.add_nodes_from(modules())
    for module, path in modules().items():
        if module in PACKAGES:
            continue
        named = used_names(tree_of(path))
        imported = (found.target for found in first_party_imports(module, path))
        targets = {resolved(target) for target in (*named, *imported)}
        graph.add_edges_from((module, target) for target in targets - {None, module, *PACKAGES})
    return graph


def is_entry(module: str) -> bool:
    """Decides whether a process begins in a module, or a program of somebody else does, by a public name."""
    return (
        module.startswith("executor.cli.")
        or module in PLUGINS
        or module.rpartition(".")[2] == "__main__"
        or '__name__ == "__main__"' in modules()[module].read_text(encoding="utf-8")
        or any(module == resolved(f"{package}.{name}") for package in PACKAGES for name in public(package))
    )


def public(package: str) -> list[str]:
    """Returns a package's public names."""
    return list(importlib.import_module(package).__all__)


def test_every_module_is_reached() -> None:
    entries = [module for module in modules() if is_entry(module)]
    graph = ways().copy()
    graph.add_edges_from(("all entries", entry) for entry in entries)
    reached = networkx.descendants(graph, "all entries")
    alone = {name for name, path in modules().items() if path.name != "__init__.py"} - reached
    assert not alone, "no command and no public name leads to these"


def test_imports_of_a_module_are_seen() -> None:
    """What the other tests rest on: names of a package lead to where they are defined, and strings count."""
    assert resolved("oag.compose") not in ("oag", None)
    assert all(isinstance(found, Import) for found in first_party_imports("oag.report", modules()["oag.report"]))
    assert ways().number_of_edges() > len(modules())


@pytest.mark.parametrize("page", ["architecture", "glossary"])
def test_the_files_that_a_page_names_are_there(page: str) -> None:
    named = re.findall(
        r"`((?:bddl|oag|llm|executor|tests|docs)/[\w/.]+)`", (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    )
    assert len(named) > 20
    assert not [name for name in named if not (ROOT / name).is_file()]
