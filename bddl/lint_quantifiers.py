"""Lint quantifiers: unused or hidden variables, objects named in place of variables, empty ranges, wildcards.

The checks share a walk that knows which quantifier binds each name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

from bddl.ast import Atom, Binder, Formula, FormulaNode, ForN, ForPairs, Quantified, Span
from bddl.diagnostics import Reporter, Severity
from bddl.grounding import Members
from bddl.problem import ROOT_CATEGORY, WILDCARD

_MOST_NODES = 50


class Bound(NamedTuple):
    """One variable of one quantifier: the quantifier, and which of its binders."""

    quantifier: Quantified
    position: int

    @property
    def binder(self) -> Binder:
        return self.quantifier.binders[self.position]

    @property
    def span(self) -> Span | None:
        """Where the quantifier introduces the variable, or None when it was not parsed."""
        return next(iter(self.quantifier.variable_spans[self.position :]), None)

    @property
    def key(self) -> tuple[int, int]:
        """Identity of this variable, distinct from one of the same name elsewhere."""
        return (id(self.quantifier), self.position)


@dataclass(slots=True)
class Scope:
    """The variables that are bound at one point of a walk; each name stands for its innermost quantifier."""

    _by_name: dict[str, list[Bound]] = field(default_factory=dict)
    _by_category: dict[str, list[Bound]] = field(default_factory=dict)

    def binding(self, name: str) -> Bound | None:
        """Return what binds a name, or None for the name of an object."""
        found = self._by_name.get(name)
        return found[-1] if found else None

    def ranging_over(self, category: str) -> Bound | None:
        """Return the innermost variable over a category."""
        found = self._by_category.get(category)
        return found[-1] if found else None

    def enter(self, quantifier: Quantified) -> None:
        """Begin the scope of a quantifier."""
        for position, (variable, category) in enumerate(quantifier.binders):
            bound = Bound(quantifier, position)
            self._by_name.setdefault(variable, []).append(bound)
            self._by_category.setdefault(category, []).append(bound)

    def leave(self, quantifier: Quantified) -> None:
        """End the scope of the quantifier that was entered last."""
        for variable, category in reversed(quantifier.binders):
            self._by_name[variable].pop()
            self._by_category[category].pop()


def walk_scoped(formula: Formula) -> Iterator[tuple[FormulaNode, Scope]]:
    """Yield every node of a formula with the scope around it, parents first, left to right.

    All nodes share one scope object, which is valid for the node just yielded. For a quantifier it has what is bound
    outside it.
    """
    scope = Scope()
    pending: list[tuple[FormulaNode, bool]] = [(formula, False)]
    while pending:
        node, leaving = pending.pop()
        if leaving and isinstance(node, Quantified):
            scope.leave(node)
            continue
        yield node, scope
        if isinstance(node, Quantified):
            scope.enter(node)
            pending.append((node, True))
        pending.extend((operand, False) for operand in reversed(node.operands))


def find_idle_variables(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report variables that the body never names, and variables that hide another variable or an object.

    A variable that is unused because another hides it is one mistake and reported as hidden.
    """
    bound_here: list[Bound] = []
    used: set[tuple[int, int]] = set()
    for node, scope in walk_scoped(formula):
        if isinstance(node, Atom):
            used.update(found.key for name in node.args if (found := scope.binding(name)) is not None)
        elif isinstance(node, Quantified):
            for position in range(len(node.binders)):
                bound = Bound(node, position)
                bound_here.append(bound)
                hidden = _hidden_by(bound, scope)
                if hidden is not None:
                    used.add(hidden.key)
                    _report_hiding(bound, hidden, reporter)
                elif bound.binder.variable in objects:
                    _report_hiding(bound, None, reporter)
    for bound in bound_here:
        if bound.key not in used:
            _report_unused(bound, objects, reporter)


def find_mixed_instances(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report quantifiers whose body names an object of the very category that the variable ranges over."""
    reported: set[tuple[int, int]] = set()
    for node, scope in walk_scoped(formula):
        if not isinstance(node, Atom) or not node.word_spans:
            continue
        for name, span in zip(node.args, node.word_spans[1:], strict=True):
            category = objects.get(name)
            if category is None or scope.binding(name) is not None:
                continue
            bound = scope.ranging_over(category)
            if bound is not None and bound.key not in reported:
                reported.add(bound.key)
                if not _is_named(bound):
                    # The unused variable is reported already, with the object that the body names instead.
                    continue
                variable = bound.binder.variable
                reporter.add(
                    "mixed-instance",
                    span,
                    f"`{name}` is one of the objects that ?{variable} ranges over.",
                    hint=f"write ?{variable} if each of them is meant; keep `{name}` if this one is",
                    related=bound.span,
                    severity="warning",
                )


def find_reflexive_atoms(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report atoms that relate, or for some choice of the variables would relate, an object to itself."""
    reported: set[tuple[str, int, int]] = set()
    vacuous = _under_empty_ranges(formula, objects)
    for node, scope in walk_scoped(formula):
        if not isinstance(node, Atom) or len(node.args) != 2 or node.span is None or id(node) in vacuous:
            continue
        if not _may_coincide(node, scope, objects):
            continue
        innermost = [bound.key for name in node.args if (bound := scope.binding(name)) is not None]
        key = (node.predicate, *max(innermost, default=(0, node.span.offset)))
        if key in reported:
            continue
        reported.add(key)
        same = node.args[0] == node.args[1]
        marked = [name if scope.binding(name) is None else f"?{name}" for name in node.args]
        reporter.add(
            "reflexive-atom",
            node.span,
            f"This atom relates {marked[0]} to itself."
            if same
            else f"This atom relates an object to itself where {marked[0]} and {marked[1]} are the same.",
            hint="name another object"
            if same
            else "a thing is neither on nor beside itself: leave that case out, or pair two categories with forpairs",
            severity="warning",
        )


def find_empty_ranges(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report quantifiers over nothing: a category without objects, or pairs of a single object."""
    members = Members(objects)
    legal = tuple(sorted({*objects.values(), ROOT_CATEGORY}))
    for node in formula.walk():
        if not isinstance(node, Quantified):
            continue
        lonely, empty = _find_empty_range(node, members)
        if empty is None:
            continue
        bound = Bound(node, empty)
        category = bound.binder.category
        place = bound.span
        if place is not None:
            reporter.add(
                "empty-range",
                place,
                f"The category `{category}` has one object only, which cannot be paired with itself."
                if lonely
                else f"The category `{category}` has no objects here, so the quantifier says nothing about any object.",
                expected=legal,
                hint="declare the objects, or name another category",
                severity="warning",
            )


def ranges_over_wildcard(formula: Formula, objects: Mapping[str, str]) -> bool:
    """Decide whether some quantifier of a formula ranges over a wildcard."""
    members = Members(objects)
    return any(_wildcard_of(bound, members) for bound in _variables(formula))


def find_counted_wildcards(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report quantifiers over wildcards, which are counted as one object, however many the scene has.

    Where `forall` or `exists` range over other objects too, that is a note, and one for each category.
    """
    members = Members(objects)
    noted: set[str] = set()
    for bound in _variables(formula):
        wildcard, category = _wildcard_of(bound, members), bound.binder.category
        if not wildcard or bound.span is None:
            continue
        message = f"`{wildcard}` is counted as one object, and stands for all further ones of its category in the room"
        severity: Severity = "warning"
        if len(members.of(bound.binder)) == 1:
            message += f"; `{category}` has no other, so there may be none at all"
            hint = f"declare one before it: {wildcard.removesuffix(WILDCARD)}_1 {wildcard} - {category}"
        elif isinstance(bound.quantifier, ForN | ForPairs):
            message += f": {_count_effect(bound, members)}"
            hint = f"declare each object of `{category}` that is meant by name"
        elif category in noted:
            continue
        else:
            noted.add(category)
            severity, hint = "note", ""
        reporter.add("counted-wildcard", bound.span, f"{message}.", hint=hint, severity=severity)


def _count_effect(bound: Bound, members: Members) -> str:
    """Return how the unknown number of a category's objects affects a quantifier that counts them."""
    node, counts = bound.quantifier, [len(members.of(binder)) for binder in bound.quantifier.binders]
    own, other = counts[bound.position], counts[bound.position - 1]
    if not isinstance(node, ForPairs):
        return f"{node.number} of {own} are to be so, where the scene may have more"
    if node.number is not None:
        return f"{node.number} pairs of {own} are asked for, where the scene may have more"
    if own < other:
        return f"only {own} pairs are asked for, where a scene with more asks for up to {other}"
    return f"{other} pairs are asked for, as if there were {own} to choose from"


def _variables(formula: Formula) -> Iterator[Bound]:
    for node in formula.walk():
        if isinstance(node, Quantified):
            yield from (Bound(node, position) for position in range(len(node.binders)))


def _wildcard_of(bound: Bound, members: Members) -> str:
    return next((name for name in members.of(bound.binder) if name.endswith(WILDCARD)), "")


def _find_empty_range(quantifier: Quantified, members: Members) -> tuple[bool, int | None]:
    ranges = [members.of(binder) for binder in quantifier.binders]
    lonely = isinstance(quantifier, ForPairs) and len(ranges[0]) == 1 and ranges[0] == ranges[1]
    return lonely, 0 if lonely else next((at for at, names in enumerate(ranges) if not names), None)


def _under_empty_ranges(formula: Formula, objects: Mapping[str, str]) -> set[int]:
    """Return the identities of the nodes inside quantifiers over nothing: they are about no object."""
    members = Members(objects)
    inside: set[int] = set()
    for node in formula.walk():
        if isinstance(node, Quantified) and id(node) not in inside and _find_empty_range(node, members)[1] is not None:
            inside.update(map(id, node.walk()))
    return inside


def _hidden_by(bound: Bound, scope: Scope) -> Bound | None:
    """Return the variable of the same name that a binder hides: one further out, or the other one of its pair."""
    variable = bound.binder.variable
    for position in range(bound.position):
        if bound.quantifier.binders[position].variable == variable:
            return Bound(bound.quantifier, position)
    return scope.binding(variable)


def _may_coincide(atom: Atom, scope: Scope, objects: Mapping[str, str]) -> bool:
    left, right = atom.args
    if left == right:
        return True
    first, second = scope.binding(left), scope.binding(right)
    if first is None or second is None:
        bound, name = (first, right) if second is None else (second, left)
        return bound is not None and bound.binder.category in (objects.get(name), ROOT_CATEGORY) and name in objects
    if first.quantifier is second.quantifier:
        return False  # The two variables of a pair never name the same object.
    categories = {first.binder.category, second.binder.category}
    return len(categories) == 1 or ROOT_CATEGORY in categories


def _report_hiding(bound: Bound, hidden: Bound | None, reporter: Reporter) -> None:
    place = bound.span
    if place is None:
        return
    variable = bound.binder.variable
    reporter.add(
        "shadowed-variable",
        place,
        f"?{variable} hides {'the object' if hidden is None else 'a variable'} of the same name.",
        hint="give it another name"
        if hidden is None
        else "give it another name, or remove one of the two quantifiers if they mean the same",
        related=None if hidden is None else hidden.span,
        severity="warning",
    )


def _report_unused(bound: Bound, objects: Mapping[str, str], reporter: Reporter) -> None:
    place = bound.span
    if place is None:
        return
    variable, category = bound.binder
    meant = _instance_in(bound, objects)
    reporter.add(
        "unused-variable",
        place,
        f"The body never names ?{variable}, so it says the same for every object of `{category}`.",
        hint=f"write ?{variable} where the body says `{meant}`" if meant else f"name ?{variable} in the body",
        severity="warning",
    )


def _is_named(bound: Bound) -> bool:
    """Decide whether the body names the variable; of a long body, only the start is examined."""
    nodes = islice(bound.quantifier.walk(), _MOST_NODES)
    return any(isinstance(node, Atom) and bound.binder.variable in node.args for node in nodes)


def _instance_in(bound: Bound, objects: Mapping[str, str]) -> str:
    """Return the first object in the body that has the variable's category, or ""; in a long body, near its start."""
    nodes = islice(bound.quantifier.walk(), _MOST_NODES)
    names = (name for node in nodes if isinstance(node, Atom) for name in node.args)
    return next((name for name in names if objects.get(name) == bound.binder.category), "")
