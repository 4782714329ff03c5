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

from bddl.codes import CODES, MEANINGS, Code
from bddl.diagnostics import BDDLError, Diagnostic
from bddl.domain import Domain, DomainAction, DomainPredicate
from bddl.errors import (
    IllegalName,
    ObjectsRequired,
    SearchLimit,
    SolverMissing,
    UnknownPairSemantics,
    UnknownProfile,
    WrongState,
)
from bddl.libero import LiberoProblem, Rectangle, Region, SceneStyle
from bddl.names import near_names
from bddl.parser import check, parse, parse_domain, parse_formula
from bddl.printer import format
from bddl.problem import Objects, Problem, TypedObject
from bddl.profiles import PROFILES, Profile
from bddl.semantics.states import State
from bddl.semantics.truth import evaluate
from bddl.slips.catalogue import SLIPS, Slip
from bddl.structure import Literal, atoms, conjuncts, literals
from bddl.syntax import (
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
    Not,
    Or,
    Span,
)
from bddl.vocabulary import PREDICATES, PredicateSpec

if TYPE_CHECKING:
    from bddl.goals.options import Option, options
    from bddl.goals.progress import GoalProgress, progress
    from bddl.layout import lay_out
    from bddl.lint.analyser import analyse
    from bddl.semantics.compiled import CompiledGoal, compile_goal
    from bddl.semantics.ground import Ground, GroundNode, PairSemantics, ground
    from bddl.semantics.states import TotalState
    from bddl.slips.correction import Correction, correct

__all__ = [
    "CODES",
    "MEANINGS",
    "PREDICATES",
    "PROFILES",
    "SLIPS",
    "And",
    "Atom",
    "BDDLError",
    "Binder",
    "Code",
    "CompiledGoal",
    "Correction",
    "Diagnostic",
    "Domain",
    "DomainAction",
    "DomainPredicate",
    "Exists",
    "ForAll",
    "ForN",
    "ForNPairs",
    "ForPairs",
    "Formula",
    "GoalProgress",
    "Ground",
    "GroundNode",
    "IllegalName",
    "Imply",
    "LiberoProblem",
    "Literal",
    "Not",
    "Objects",
    "ObjectsRequired",
    "Option",
    "Or",
    "PairSemantics",
    "PredicateSpec",
    "Problem",
    "Profile",
    "Rectangle",
    "Region",
    "SceneStyle",
    "SearchLimit",
    "Slip",
    "SolverMissing",
    "Span",
    "State",
    "TotalState",
    "TypedObject",
    "UnknownPairSemantics",
    "UnknownProfile",
    "WrongState",
    "analyse",
    "atoms",
    "check",
    "compile_goal",
    "conjuncts",
    "correct",
    "evaluate",
    "format",
    "ground",
    "lay_out",
    "literals",
    "near_names",
    "options",
    "parse",
    "parse_domain",
    "parse_formula",
    "progress",
]

# What most programs that read BDDL never use is loaded when it is first asked for.
_PLACES = {
    "CompiledGoal": "bddl.semantics.compiled",
    "Correction": "bddl.slips.correction",
    "GoalProgress": "bddl.goals.progress",
    "Ground": "bddl.semantics.ground",
    "GroundNode": "bddl.semantics.ground",
    "Option": "bddl.goals.options",
    "PairSemantics": "bddl.semantics.ground",
    "TotalState": "bddl.semantics.states",
    "analyse": "bddl.lint.analyser",
    "compile_goal": "bddl.semantics.compiled",
    "correct": "bddl.slips.correction",
    "ground": "bddl.semantics.ground",
    "lay_out": "bddl.layout",
    "options": "bddl.goals.options",
    "progress": "bddl.goals.progress",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bddl' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
