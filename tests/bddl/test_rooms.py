"""The folders of the package stand in a line: each imports only from itself and from those before it."""

from __future__ import annotations

from tests.source_tree import first_party_imports, modules

LINE = (
    # Leaves that every package uses.
    "bddl.visible",
    "bddl.files",
    "bddl.syntax",
    "bddl.reading",
    "bddl.printer",
    "bddl.semantics",
    "bddl.solver",
    "bddl.goals",
    "bddl.lint",
    "bddl.repair",
    "bddl.parser",
    "bddl",
)


def room(target: str) -> str:
    """Returns the folder that a module, or a name in it, belongs to."""
    while target not in LINE:
        target = target.rpartition(".")[0]
    return target


def test_no_folder_imports_from_one_above_it() -> None:
    upward = [
        f"{found.module}:{found.line} imports {found.target}"
        for name, path in modules("bddl").items()
        for found in first_party_imports(name, path)
        if LINE.index(room(found.target)) > LINE.index(room(name if path.name == "__init__.py" else found.module))
    ]
    assert not upward, upward
