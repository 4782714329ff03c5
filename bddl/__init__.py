"""BDDL: formulas about a scene, from text to tree and back, with three-valued truth and messages that help.

    formula = bddl.parse_formula("(not (open refrigerator_0))")
    bddl.evaluate(formula, {bddl.Atom("open", ("refrigerator_0",)): False})   # True
    bddl.format(formula)                                                      # "(not (open refrigerator_0))"

A text that is wrong raises `BDDLError`, whose `diagnostics` hold every mistake with its place, what was expected and
what to write instead; `check` returns the same as data. Names of objects keep their letter case; the words of the
language and the predicates do not care about it.
"""

from bddl.codes import CODES, MEANINGS, Code
from bddl.diagnostics import BDDLError, Diagnostic
from bddl.errors import IllegalName, ObjectsRequired, UnknownProfile
from bddl.names import near_names
from bddl.parser import check, parse, parse_formula
from bddl.printer import format
from bddl.problem import Problem, TypedObject
from bddl.profiles import PROFILES, Profile
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
from bddl.truth import State, evaluate
from bddl.vocabulary import PREDICATES, PredicateSpec

__all__ = [
    "CODES",
    "MEANINGS",
    "PREDICATES",
    "PROFILES",
    "And",
    "Atom",
    "BDDLError",
    "Binder",
    "Code",
    "Diagnostic",
    "Exists",
    "ForAll",
    "ForN",
    "ForNPairs",
    "ForPairs",
    "Formula",
    "IllegalName",
    "Imply",
    "Literal",
    "Not",
    "ObjectsRequired",
    "Or",
    "PredicateSpec",
    "Problem",
    "Profile",
    "Span",
    "State",
    "TypedObject",
    "UnknownProfile",
    "atoms",
    "check",
    "conjuncts",
    "evaluate",
    "format",
    "literals",
    "near_names",
    "parse",
    "parse_formula",
]
