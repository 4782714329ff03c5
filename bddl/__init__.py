"""BDDL: formulas about a scene, from text to tree and back, with three-valued truth and messages that help.

    formula = bddl.parse_formula("(not (open refrigerator_0))")
    bddl.evaluate(formula, {bddl.Atom("open", ("refrigerator_0",)): False})   # True
    bddl.format(formula)                                                      # "(not (open refrigerator_0))"

A text that is wrong raises `BDDLError`, whose `diagnostics` hold every mistake with its place, what was expected and
what to write instead; `check` returns the same as data. Names of objects keep their letter case; the words of the
language and the predicates do not care about it.
"""

import importlib
from typing import TYPE_CHECKING, Any

from bddl.ast import (
    And,
    Atom,
    Binder,
    Exists,
    ForAll,
    Formula,
    ForN,
    ForNPairs,
    ForPairs,
    Imply,
    Literal,
    Not,
    Or,
    Span,
    atoms,
    conjuncts,
    literals,
)
from bddl.diagnostics import CODES, MEANINGS, SLIPS, BDDLError, Code, Diagnostic, Slip
from bddl.dialects import PREDICATES, PROFILES, PredicateSpec, Profile, near_names
from bddl.errors import (
    CountedWildcard,
    FormulaTooLarge,
    IllegalName,
    ObjectsRequired,
    Scene2DemoError,
    SearchLimit,
    SolverMissing,
    UnknownPairSemantics,
    UnknownProfile,
)
from bddl.evaluation import State, evaluate
from bddl.parser import check, parse, parse_domain, parse_formula
from bddl.printer import format
from bddl.problem import (
    Domain,
    DomainAction,
    DomainPredicate,
    LiberoProblem,
    Objects,
    Problem,
    Rectangle,
    Region,
    SceneStyle,
    TypedObject,
)

if TYPE_CHECKING:
    from bddl.equivalence import Equivalence, equivalent
    from bddl.grounding import Ground, GroundNode, PairSemantics, ground
    from bddl.lint import analyse
    from bddl.printer import lay_out
    from bddl.progress import GoalProgress, Option, options
    from bddl.repair import Correction, correct

__all__ = [
    "CODES", "MEANINGS", "PREDICATES", "PROFILES", "SLIPS", "And", "Atom", "BDDLError", "Binder", "Code",
    "Correction", "CountedWildcard", "Diagnostic", "Domain", "DomainAction", "DomainPredicate", "Equivalence",
    "Exists", "ForAll", "ForN", "ForNPairs", "ForPairs", "Formula", "FormulaTooLarge", "GoalProgress", "Ground",
    "GroundNode", "IllegalName", "Imply", "LiberoProblem", "Literal", "Not", "Objects", "ObjectsRequired",
    "Option", "Or", "PairSemantics", "PredicateSpec", "Problem", "Profile", "Rectangle", "Region",
    "Scene2DemoError", "SceneStyle", "SearchLimit", "Slip", "SolverMissing", "Span", "State", "TypedObject",
    "UnknownPairSemantics", "UnknownProfile", "analyse", "atoms", "check", "conjuncts", "correct", "equivalent",
    "evaluate", "format", "ground", "lay_out", "literals", "near_names", "options", "parse", "parse_domain",
    "parse_formula",
]  # fmt: skip

# What most programs that read BDDL never use is loaded when it is first asked for.
_PLACES = {
    "Correction": "bddl.repair",
    "Equivalence": "bddl.equivalence",
    "GoalProgress": "bddl.progress",
    "Ground": "bddl.grounding",
    "GroundNode": "bddl.grounding",
    "Option": "bddl.progress",
    "PairSemantics": "bddl.grounding",
    "analyse": "bddl.lint",
    "correct": "bddl.repair",
    "equivalent": "bddl.equivalence",
    "ground": "bddl.grounding",
    "lay_out": "bddl.printer",
    "options": "bddl.progress",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bddl' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
