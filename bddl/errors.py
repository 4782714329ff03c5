"""Exceptions for misuse of this package's functions; mistakes in a text are diagnostics instead."""

from __future__ import annotations

from collections.abc import Iterable


class IllegalName(ValueError):
    """Raised when a formula is built from a name that BDDL text cannot carry.

    Args:
        role: What the name was meant for, such as "predicate".
        name: The name as it was given.
        rule: What a name in this role may look like.
    """

    def __init__(self, role: str, name: object, rule: str) -> None:
        super().__init__(role, name, rule)
        self.role = role
        self.name = name
        self.rule = rule

    def __str__(self) -> str:
        article = "an" if self.role[:1] in "aeiou" else "a"
        return f"{self.name!r} cannot be the name of {article} {self.role}: {self.rule}."


class UnknownProfile(ValueError):
    """Raised when a profile is asked for that does not exist.

    Args:
        name: The profile asked for.
        legal: The names of the profiles there are.
        near: The legal names that resemble it.
    """

    def __init__(self, name: str, legal: Iterable[str], near: Iterable[str] = ()) -> None:
        self.name = name
        self.legal = tuple(legal)
        self.near = tuple(near)
        super().__init__(name, self.legal, self.near)

    def __str__(self) -> str:
        meant = f" Did you mean {' or '.join(repr(option) for option in self.near)}?" if self.near else ""
        return f"There is no BDDL profile {self.name!r}.{meant} The profiles are: {', '.join(self.legal)}."


class ObjectsRequired(ValueError):
    """Raised when a quantifier is evaluated without the objects that it ranges over.

    Args:
        variable: The quantified variable.
        category: The category it ranges over.
    """

    def __init__(self, variable: str, category: str) -> None:
        super().__init__(variable, category)
        self.variable = variable
        self.category = category

    def __str__(self) -> str:
        return (
            f"The quantifier over (?{self.variable} - {self.category}) ranges over the scene's objects, "
            "which were not given: pass objects={id: category, ...}."
        )
