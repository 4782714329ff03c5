"""Model of a plan's world: scenes, symbols, actions, diagnostics, and the files that describe them.

The project's `bddl` package is checked here, once: a foreign package of that name ends in one clear sentence.
"""

from __future__ import annotations

from types import ModuleType

import bddl

# Names that only this project's package has; PyPI's `bddl` (imported by OmniGibson) has none of them.
_MARKERS = ("parse_formula", "Literal", "PREDICATES", "evaluate")


def require_own_language(module: ModuleType) -> None:
    """Raise ImportError unless `module` is the language package that this package was written against."""
    missing = [name for name in _MARKERS if not hasattr(module, name)]
    if missing:
        found = getattr(module, "__file__", None) or "an unknown place"
        raise ImportError(
            f"oag needs Scene2Demo's own `bddl` package, but `import bddl` found another one at {found}; "
            "install scene2demo in an environment of its own, without the `bddl` distribution from PyPI"
        )


require_own_language(bddl)
