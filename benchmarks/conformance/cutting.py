"""Cuts the text of an activity into words and forms, for those who edit it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field


def listed(words: str) -> tuple[str, ...]:
    """Return the words of a text that single spaces part."""
    return tuple(words.split(" "))


_TOKEN = re.compile(r"[()]|[^\s()]+")
_QUANTIFIERS = frozenset({"forall", "exists", "forn", "forpairs", "fornpairs"})
_CONNECTIVES = _QUANTIFIERS | {"and", "or", "not", "imply"}


@dataclass(slots=True)
class Form:
    """A word, or a form with its items; its text is empty then."""

    text: str
    start: int
    end: int
    items: list[Form] = field(default_factory=list)

    @property
    def head(self) -> str:
        """The first word of a form, "" for anything else."""
        return self.items[0].text if self.items else ""


@dataclass(frozen=True, slots=True)
class ObjectLine:
    """Names with their category, as they stand in `:objects`."""

    names: tuple[Form, ...]
    category: Form


@dataclass(slots=True)
class Definition:
    """An activity with its sections by name."""

    text: str
    tokens: list[Form]
    sections: dict[str, Form]

    @property
    def objects(self) -> list[str]:
        """The names of the declared objects."""
        return [name.text for line in self.object_lines() for name in line.names]

    def object_lines(self) -> list[ObjectLine]:
        """Return the declared names by category, in order."""
        lines: list[ObjectLine] = []
        names: list[Form] = []
        items = iter(self.sections[":objects"].items[1:])
        for item in items:
            if item.text == "-":
                lines.append(ObjectLine(tuple(names), next(items)))
                names = []
            else:
                names.append(item)
        return lines

    def walk(self, section: str) -> Iterator[Form]:
        """Yield the forms inside a section, outer ones first."""
        pending = self.sections[section].items[:0:-1]
        while pending:
            form = pending.pop()
            if form.items:
                yield form
                pending.extend(reversed(form.items))

    def atoms(self, section: str) -> list[Form]:
        """Return the atoms of a section."""
        return [
            form
            for form in self.walk(section)
            if form.head not in _CONNECTIVES and len(form.items) > 1 and form.items[1].text != "-"
        ]

    def binders(self) -> list[Form]:
        """Return the binders of the goal's quantifiers."""
        return [
            item
            for form in self.walk(":goal")
            if form.head in _QUANTIFIERS
            for item in form.items[1:]
            if len(item.items) == 3 and item.items[1].text == "-"
        ]

    def source(self, form: Form) -> str:
        """Return the text of a form."""
        return self.text[form.start : form.end]


def cut(text: str) -> Definition:
    """Return the definition that a well-formed text holds."""
    tokens = [Form(found.group(), found.start(), found.end()) for found in _TOKEN.finditer(text)]
    stack: list[Form] = [Form("", 0, len(text))]
    for token in tokens:
        if token.text == "(":
            stack.append(Form("", token.start, token.end))
        elif token.text == ")":
            done = stack.pop()
            done.end = token.end
            stack[-1].items.append(done)
        else:
            stack[-1].items.append(token)
    (whole,) = stack[0].items
    return Definition(text, tokens, {form.head: form for form in whole.items[1:] if form.items})
