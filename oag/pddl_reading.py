"""PDDL 2.1 in: a lifted domain of STRIPS with types and negative preconditions; all else is refused by name.

The domain becomes an own domain without the 21 primitives, and its problem a scene that is known completely, with its
goal. A goal may be any formula, since `oag.plan` spells quantifiers and alternatives out.

Source: Fox and Long, PDDL2.1 (JAIR 2003), level 1; docs/semantics.md, Own domains.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import bddl
from bddl.ast import Quantified
from oag.model.diagnostics import OagError
from oag.model.domain import ANY_WORD, THING, Domain
from oag.model.scene import NO_BOX, RobotPose, Scene, SceneObject
from oag.model.symbols import GRIPPER

REQUIREMENTS = (":strips", ":typing", ":negative-preconditions")
"""What is written, and read."""
_WORDS = re.compile(r"[()]|[^\s()]+")


class PddlError(OagError):
    """Something cannot be expressed in STRIPS with types and negative preconditions.

    Attributes:
        refused: What it is, a name each.
    """

    def __init__(self, refused: Iterable[str]) -> None:
        self.refused = tuple(dict.fromkeys(refused))
        super().__init__(f"PDDL: not in STRIPS with types and negative preconditions: {'; '.join(self.refused)}")


def read(domain_text: str, problem_text: str) -> tuple[Scene, bddl.Formula]:
    """Return the scene and the goal of a PDDL problem; the scene's domain has the actions as its primitives.

    Letters are read in lower case, as PDDL does; names of actions become capitals. The goal may have quantifiers and
    alternatives.

    Raises:
        PddlError: Something that is not STRIPS with types and negative preconditions, by name. An atom whose types are
            not those of its predicate comes with its place in the problem.
        bddl.BDDLError: A text is no PDDL.

    Example:
        >>> domain = "(define (domain d) (:predicates (on ?x)) (:action go :parameters (?x) :effect (on ?x)))"
        >>> scene, goal = read(domain, "(define (problem p) (:domain d) (:objects a) (:init) (:goal (on a)))")
        >>> scene.domain, scene.facts
        (<Domain 'd': GO>, ())
    """
    refused = [part for part in _SECTIONS if re.search(rf"\(\s*{part}\b", domain_text, re.IGNORECASE)]
    if refused:
        raise PddlError(refused)
    pddl = bddl.parse_domain(domain_text)
    refused = [need for need in pddl.requirements if need not in REQUIREMENTS]
    if refused:
        raise PddlError(refused)
    problem = bddl.parse(problem_text, profile="auto", domain=pddl)
    if not isinstance(problem, bddl.Problem):
        raise PddlError(["a problem of another language"])
    refused = list(_mistyped(problem, pddl))
    if refused:
        raise PddlError(refused)
    rows = [_read_action(each.text.lower()) for each in pddl.actions]
    names = [name for name, _ in rows]
    alike = [f"two actions {name}, whose names differ in signs alone" for name in names if names.count(name) > 1]
    if alike:
        raise PddlError(alike)
    types = _types(pddl)
    categories = dict.fromkeys((THING, *(item.name for item in pddl.types), *problem.categories.values()))
    domain = Domain.from_json(
        {
            "name": pddl.name,
            "inherits": False,
            "predicates": {each.name: [b.variable for b in each.parameters] for each in pddl.predicates},
            "kinds": dict.fromkeys(categories, "support"),
            "types": types,
            "primitives": dict(rows),
        },
        f"(domain {pddl.name})",
    )
    things = {
        key: SceneObject(key, category, category, NO_BOX, (1.0, 0.0, 0.0, 0.0), NO_BOX)
        for key, category in problem.categories.items()
    }
    facts: Any = tuple(each for each in problem.init if isinstance(each, bddl.Atom))
    closed = frozenset(domain.predicates)
    return Scene(problem.name, RobotPose(), things, facts, closed, domain=domain), problem.goal


def _types(pddl: bddl.Domain) -> dict[str, str]:
    return {item.name: item.category for item in pddl.types if item.category != THING}


def _mistyped(problem: bddl.Problem, pddl: bddl.Domain) -> Iterator[str]:
    """Yield the atoms with an argument that is not of the type of its parameter."""
    parameters = {each.name: each.parameters for each in pddl.predicates}
    typed = Domain(pddl.name, types=_types(pddl))
    waiting: list[tuple[bddl.Formula, Mapping[str, str]]] = [
        (each, problem.categories) for each in (problem.goal, *reversed(problem.init))
    ]
    while waiting:
        node, known = waiting.pop()
        if not isinstance(node, bddl.Atom):
            bound = dict(node.binders) if isinstance(node, Quantified) else {}
            waiting += [(part, {**known, **bound} if bound else known) for part in reversed(node.operands)]
            continue
        place = "" if node.span is None else f"line {node.span.line}, column {node.span.column}: "
        for name, (_, wanted) in zip(node.args, parameters[node.predicate], strict=True):
            own = known.get(name, THING)
            if wanted not in (THING, *typed.line(own)):
                fitting = [key for key, category in problem.categories.items() if wanted in typed.line(category)]
                legal = ", ".join(fitting[:3]) or "none in the problem"
                yield f"{place}{bddl.format(node)}: {name} is {own}, and {wanted} is expected ({legal})"


_SECTIONS = (":constants", ":functions", ":derived", ":durative-action", ":axiom")


def _read_action(text: str) -> tuple[str, dict[str, object]]:
    """Return the name and the row of an action."""
    # These variables have a meaning in rows.
    form = _nested(re.sub(rf"\?({ANY_WORD}|{GRIPPER})(?=[\s()])", r"?the-\1", text))
    name, fields = str(form[1]), dict(zip(form[2::2], form[3::2], strict=False))
    refused = [f"{name}: {key}" for key in fields if key not in (":parameters", ":precondition", ":effect")]
    objects = list(_typed(fields.get(":parameters", []), name))
    refused += [] if objects else [f"{name}: an action without parameters"]
    needs = list(_literals(fields.get(":precondition", []), name, refused))
    writes = list(_literals(fields.get(":effect", []), name, refused))
    if refused:
        raise PddlError(refused)
    return name.upper().replace("-", "_"), {"objects": objects, "needs": needs, "writes": writes}


def _nested(text: str) -> Any:
    """Return a text of parentheses as nested lists of words."""
    open_forms: list[list[Any]] = [[]]
    for word in _WORDS.findall(text):
        if word == "(":
            open_forms.append([])
        elif word == ")" and len(open_forms) > 1:
            form = open_forms.pop()
            open_forms[-1].append(form)
        else:
            open_forms[-1].append(word)
    return open_forms[0][0]


def _typed(words: list[Any], name: str) -> Iterator[tuple[str, str]]:
    waiting: list[str] = []
    rest = iter(words)
    for word in rest:
        if word == "-":
            kind = next(rest, THING)
            if not isinstance(kind, str):
                raise PddlError([f"{name}: (either ...)"])
            yield from ((each, kind) for each in waiting)
            waiting = []
        else:
            waiting.append(word)
    yield from ((each, THING) for each in waiting)


def _literals(form: list[Any], name: str, refused: list[str]) -> Iterator[str]:
    """Yield the literals of a conjunction; what is none is added to what is refused."""
    if not form:
        return
    head, *rest = form
    if not isinstance(head, str):
        refused.append(f"{name}: a list where a literal is expected")
    elif head == "and":
        for part in rest:
            yield from _literals(part, name, refused)
    elif head == "not" and len(rest) == 1 and _plain(rest[0]):
        yield f"(not ({' '.join(rest[0])}))"
    elif head in _FORMS or not all(isinstance(word, str) for word in rest):
        refused.append(f"{name}: ({head} ...)")
    else:
        yield f"({' '.join(form)})"


def _plain(form: object) -> bool:
    return isinstance(form, list) and all(isinstance(w, str) for w in form) and bool(form) and form[0] not in _FORMS


_FORMS = frozenset(["and", "or", "not", "imply", "forall", "exists", "when", "=", "increase", "decrease", "assign"])
