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

from bddl.parser import check, parse, parse_domain, parse_formula
from bddl.printer import format
from bddl.semantics.truth import State, evaluate
from bddl.syntax.codes import CODES, MEANINGS, SLIPS, Code, Slip
from bddl.syntax.diagnostic import BDDLError, Diagnostic
from bddl.syntax.errors import (
    CountedWildcard,
    IllegalName,
    ObjectsRequired,
    SearchLimit,
    SolverMissing,
    UnknownPairSemantics,
    UnknownProfile,
    WrongState,
)
from bddl.syntax.libero import LiberoProblem, Rectangle, Region, SceneStyle
from bddl.syntax.names import near_names
from bddl.syntax.problem import Domain, DomainAction, DomainPredicate, Objects, Problem, TypedObject
from bddl.syntax.profiles import PROFILES, Profile
from bddl.syntax.structure import Literal, atoms, conjuncts, literals
from bddl.syntax.tree import And, Atom, Binder, Exists, ForAll, Formula, ForN, ForNPairs, ForPairs, Imply, Not, Or, Span
from bddl.syntax.vocabulary import PREDICATES, PredicateSpec

if TYPE_CHECKING:
    from bddl.analyser import analyse
    from bddl.goals.ways import GoalProgress, Option, options
    from bddl.printer import lay_out
    from bddl.repair.correction import Correction, correct
    from bddl.semantics.compiled import CompiledGoal, TotalState, compile_goal
    from bddl.semantics.ground import Ground, GroundNode, ground
    from bddl.semantics.members import PairSemantics

__all__ = [
    "CODES", "MEANINGS", "PREDICATES", "PROFILES", "SLIPS", "And", "Atom", "BDDLError", "Binder", "Code",
    "CompiledGoal", "Correction", "CountedWildcard", "Diagnostic", "Domain", "DomainAction", "DomainPredicate",
    "Exists", "ForAll", "ForN", "ForNPairs", "ForPairs", "Formula", "GoalProgress", "Ground", "GroundNode",
    "IllegalName", "Imply", "LiberoProblem", "Literal", "Not", "Objects", "ObjectsRequired", "Option", "Or",
    "PairSemantics", "PredicateSpec", "Problem", "Profile", "Rectangle", "Region", "SceneStyle", "SearchLimit",
    "Slip", "SolverMissing", "Span", "State", "TotalState", "TypedObject", "UnknownPairSemantics", "UnknownProfile",
    "WrongState", "analyse", "atoms", "check", "compile_goal", "conjuncts", "correct", "evaluate", "format",
    "ground", "lay_out", "literals", "near_names", "options", "parse", "parse_domain", "parse_formula",
]  # fmt: skip

# What most programs that read BDDL never use is loaded when it is first asked for.
_PLACES = {
    "CompiledGoal": "bddl.semantics.compiled",
    "Correction": "bddl.repair.correction",
    "GoalProgress": "bddl.goals.ways",
    "Ground": "bddl.semantics.ground",
    "GroundNode": "bddl.semantics.ground",
    "Option": "bddl.goals.ways",
    "PairSemantics": "bddl.semantics.members",
    "TotalState": "bddl.semantics.compiled",
    "analyse": "bddl.analyser",
    "compile_goal": "bddl.semantics.compiled",
    "correct": "bddl.repair.correction",
    "ground": "bddl.semantics.ground",
    "lay_out": "bddl.printer",
    "options": "bddl.goals.ways",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bddl' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
