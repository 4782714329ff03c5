"""What stands between a quantifier and its formula: the number, and the variables with their categories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from bddl.reading.terms import TermReader
from bddl.reading.words import Group, Item, Word
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.profiles import FORM_SHAPES, Profile
from bddl.syntax.tree import Binder, Span

# A longer number is a slip or an attack; no scene has as many objects.
_MOST_DIGITS = 9


@dataclass(frozen=True, slots=True)
class Prefix:
    """What a quantifier says before its formula.

    Attributes:
        binders: Its variables.
        spans: Where they stand.
        number: The number N of `forn` and `fornpairs`.
        scope: The names that its formula may use as variables; those that a wrong binder seems to mean, too.
        rest: The items behind it.
        legal: False when something was wrong, which has been reported.
    """

    binders: tuple[Binder, ...]
    spans: tuple[Span, ...]
    number: int | None
    scope: tuple[str, ...]
    rest: Sequence[Item]
    legal: bool


class BinderReader:
    """Reads what stands between the word of one quantifier and its formula."""

    def __init__(self, terms: TermReader, head: Word, reporter: Reporter) -> None:
        self._terms = terms
        self._profile = terms.profile
        self._head = head
        self._shape = FORM_SHAPES[head.key]
        self._reporter = reporter

    def read(self, operands: Sequence[Item]) -> Prefix:
        """Returns what the quantifier says before its formula; whatever is wrong in it is reported."""
        number: int | None = None
        legal = True
        if "(N)" in self._shape:
            number, taken = self._number(operands[0] if operands else None)
            legal = number is not None
            operands = operands[taken:]
        binders: list[Binder] = []
        spans: list[Span] = []
        scope: list[str] = []
        wanted = self._shape.count("CATEGORY")
        for position in range(wanted):
            item = operands[0] if operands else None
            if position and _opens_formula(item, self._profile):
                item = None
            binder = self._binder(item, loose=wanted > 1)
            if binder is not None and isinstance(item, Group):
                binders.append(binder)
                spans.append(item.items[0].span)
                scope.append(binder.variable)
            else:
                legal = False
                if item is None or _opens_formula(item, self._profile):
                    break
                loose = [item]
                if isinstance(item, Word) and item.kind == "VARIABLE":
                    loose = list(takewhile(lambda one: isinstance(one, Word), operands))
                scope += [name for word in loose for name in variables_meant(word, self._profile)]
                operands = operands[len(loose) - 1 :]
            operands = operands[1:]
        return Prefix(tuple(binders), tuple(spans), number, tuple(scope), operands, legal)

    def _number(self, item: Item | None) -> tuple[int | None, int]:
        """Returns the number of a quantifier, None when it is wrong, and how many items it took."""
        words = item.items if isinstance(item, Group) else (item,)
        first = words[0] if words else None
        if not isinstance(first, Word) or not first.text.isdecimal() or len(first.text) > _MOST_DIGITS:
            self._report_number(item, "")
            looks_like_one = isinstance(item, Group) and len(item.items) == 1 and isinstance(first, Word)
            return None, int(isinstance(item, Word) or (looks_like_one and not _opens_formula(item, self._profile)))
        if isinstance(item, Word):
            # The reference takes the first letter of the word for the list's first element.
            return (int(first.text[0]) if self._report_number(item, "loose") else None), 1
        if len(words) > 1:
            return (int(first.text) if self._report_number(item, "surplus") else None), 1
        return int(first.text), 1

    def _report_number(self, item: Item | None, case: str) -> bool:
        return self._reporter.add(
            "bad-count",
            self._head.span if item is None else item.span,
            f"`{self._head.key}` begins with one whole number in parentheses.",
            expected=("(N)",),
            hint=f"write {self._shape.replace('(N)', '(2)')}",
            case=case,
        )

    def _binder(self, item: Item | None, loose: bool) -> Binder | None:
        if isinstance(item, Group) and len(item.items) == 3:
            variable, hyphen, category = item.items
            if isinstance(variable, Word) and isinstance(hyphen, Word) and isinstance(category, Word):
                if hyphen.kind == "HYPHEN" or (loose and self._report(item, "hyphen")):
                    name = self._terms.legal_name(variable, "variable")
                    kind = self._terms.legal_name(category, "category")
                    if kind is not None:
                        self._terms.check_category(category, kind)
                    return None if name is None or kind is None else Binder(name, kind)
                if loose:
                    return None
        self._report(item, "")
        return None

    def _report(self, item: Item | None, case: str) -> bool:
        word, two = f"`{self._head.key}`", self._shape.count("CATEGORY") > 1
        message = f"{word} begins with one variable and its category in parentheses."
        if two:
            message = f"{word} has two variables, each with its category in parentheses of its own."
        elif "(N)" in self._shape:
            message = f"In {word} the number is followed by one variable and its category in parentheses."
        return self._reporter.add(
            "bad-binder",
            self._head.span if item is None else item.span,
            message,
            expected=("(?x - CATEGORY)",),
            hint=f"write {self._shape}" + ("" if two else "; for two variables, nest two quantifiers"),
            case=case,
        )


def _opens_formula(item: Item | None, profile: Profile) -> bool:
    """Decides whether an item looks like a formula rather than like a binder gone wrong."""
    return isinstance(item, Group) and item.head is not None and item.head.key in profile.words


def is_binder(item: Item) -> bool:
    """Decides whether an item has the form `(?x - CATEGORY)`."""
    kinds = [word.kind for word in item.items if isinstance(word, Word)] if isinstance(item, Group) else []
    return kinds == ["VARIABLE", "HYPHEN", "NAME"]


def variables_meant(item: Item, profile: Profile) -> list[str]:
    """Returns the names in a binder gone wrong, so that the formula is not blamed for using them."""
    words = item.items if isinstance(item, Group) else (item,)
    return [profile.name_of(word.text) for word in words if isinstance(word, Word)]
