"""What the tests about the repository itself look at: its files, packages and imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

ROOT = Path(__file__).resolve().parent.parent
# In import order: each may import those before it.
PACKAGES = ("bddl", "oag", "llm", "executor")
_NOT_OURS = {".git", ".venv", "runs", "build", "dist", "node_modules"}


@dataclass(frozen=True, slots=True)
class Import:
    """One import statement's target, as an absolute dotted name.

    Attributes:
        module: Dotted name of the importing module.
        target: Dotted name of what is imported; for `from a import b` it is `a.b`.
        line: Line in the file.
        at_top: False when it stands inside a function.
    """

    module: str
    target: str
    line: int
    at_top: bool


def files() -> tuple[Path, ...]:
    """Return every file of the checkout that is not built, downloaded or hidden by tools, sorted."""
    return tuple(sorted(_walk(ROOT)))


def _walk(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.is_dir():
            cache = path.name.endswith(("_cache", "__pycache__", ".egg-info")) or path.name == ".hypothesis"
            # Peers live in environments of their own beside ours.
            if path.name not in _NOT_OURS and not cache and not path.name.startswith(".venv-"):
                yield from _walk(path)
        elif path.is_file() and path.name not in _NOT_OURS:  # A second checkout has a file of git's.
            yield path


@cache
def modules(*packages: str) -> Mapping[str, Path]:
    """Return dotted module name -> file for all modules of the packages; a package is named by its folder."""
    found = {}
    for package in packages or PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return MappingProxyType(found)


@cache
def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@cache
def first_party_imports(module: str, path: Path) -> tuple[Import, ...]:
    """Return what a module imports from the project's own packages, `if TYPE_CHECKING` blocks included."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    found = []
    for node, at_top in _statements(tree_of(path)):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = _absolute_base(node, package)
            targets = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        found += [Import(module, target, node.lineno, at_top) for target in targets if target.split(".")[0] in PACKAGES]
    return tuple(found)


def _statements(tree: ast.Module) -> Iterator[tuple[ast.stmt, bool]]:
    """Yield every statement, and whether it stands outside of all functions."""
    waiting: list[tuple[ast.AST, bool]] = [(tree, True)]
    while waiting:
        parent, at_top = waiting.pop()
        at_top = at_top and not isinstance(parent, ast.FunctionDef | ast.AsyncFunctionDef)
        for child in ast.iter_child_nodes(parent):
            # An expression holds no statement.
            if not isinstance(child, ast.expr):
                waiting.append((child, at_top))
            if isinstance(child, ast.stmt):
                yield child, at_top


def _absolute_base(node: ast.ImportFrom, package: str) -> str:
    """Return the absolute dotted name before `import` of a from-import, relative ones resolved."""
    if node.level == 0:
        return node.module or ""
    kept = package.split(".")[: len(package.split(".")) - node.level + 1]
    return ".".join([*kept, *([node.module] if node.module else [])])
