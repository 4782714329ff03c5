"""A walk through a formula that knows which quantifier binds each name, and where in the text binders stand."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from bddl.syntax import Binder, Formula, Node, Quantified, Span

_TOKEN = re.compile(r";[^\n]*|[()]|[^\s();\ufeff]+")


class Bound(NamedTuple):
    """One variable of one quantifier: the quantifier, and which of its binders."""

    quantifier: Quantified
    position: int

    @property
    def binder(self) -> Binder:
        """The variable and its category."""
        return self.quantifier.binders[self.position]

    @property
    def key(self) -> tuple[int, int]:
        """Tells this variable from one of the same name elsewhere."""
        return (id(self.quantifier), self.position)


@dataclass(slots=True)
class Scope:
    """The variables that are bound at one point of a walk; each name stands for its innermost quantifier."""

    _by_name: dict[str, list[Bound]] = field(default_factory=dict)
    _by_category: dict[str, list[Bound]] = field(default_factory=dict)

    def binding(self, name: str) -> Bound | None:
        """Returns what binds a name, or None for the name of an object."""
        found = self._by_name.get(name)
        return found[-1] if found else None

    def ranging_over(self, category: str) -> Bound | None:
        """Returns the innermost variable over a category."""
        found = self._by_category.get(category)
        return found[-1] if found else None

    def enter(self, quantifier: Quantified) -> None:
        """Begins the scope of a quantifier."""
        for position, (variable, category) in enumerate(quantifier.binders):
            bound = Bound(quantifier, position)
            self._by_name.setdefault(variable, []).append(bound)
            self._by_category.setdefault(category, []).append(bound)

    def leave(self, quantifier: Quantified) -> None:
        """Ends the scope of the quantifier that was entered last."""
        for variable, category in reversed(quantifier.binders):
            self._by_name[variable].pop()
            self._by_category[category].pop()


def walk_scoped(formula: Formula) -> Iterator[tuple[Node, Scope]]:
    """Yields every node of a formula with the scope around it, parents first, left to right.

    The scope is the same object throughout and says what holds at the node just yielded; for a quantifier that is
    what is bound outside it.
    """
    scope = Scope()
    pending: list[tuple[Node, bool]] = [(formula, False)]
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


def variable_span(bound: Bound, text: str) -> Span | None:
    """Returns where a quantifier introduces a variable, or None when the quantifier was not read from this text."""
    span: Span | None = getattr(bound.quantifier, "span", None)
    if span is None:
        return None
    depth = seen = 0
    opened = False
    for token in _TOKEN.finditer(text, span.offset, span.offset + span.length):
        word = token.group()
        if word.startswith(";"):
            continue
        if opened and depth == 2 and word not in "()" and not word.isdecimal():
            if seen == bound.position:
                return _span_at(text, span, token.start(), len(word))
            seen += 1
        depth += (word == "(") - (word == ")")
        opened = word == "("
    return span


def _span_at(text: str, base: Span, offset: int, length: int) -> Span:
    """Returns the span at an offset behind the beginning of another one."""
    breaks = text.count("\n", base.offset, offset)
    column = offset - text.rfind("\n", 0, offset) if breaks else base.column + offset - base.offset
    return Span(base.line + breaks, column, offset, length)
