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


class UnknownPairSemantics(ValueError):
    """Raised when `forpairs` is to be read in a way that does not exist.

    Args:
        name: The word that was given.
        legal: The words there are.
    """

    def __init__(self, name: str, legal: Iterable[str]) -> None:
        self.name = name
        self.legal = tuple(legal)
        super().__init__(name, self.legal)

    def __str__(self) -> str:
        return f"`forpairs` cannot be read as {self.name!r}: pairs is {' or '.join(repr(word) for word in self.legal)}."


class SolverMissing(RuntimeError):
    """Raised when a question needs z3 and z3 is not installed.

    Args:
        why: What Python said when it was imported.
    """

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why

    def __str__(self) -> str:
        return f"This has to be decided by z3, which cannot be loaded ({self.why}): pip install z3-solver."


class WrongState(ValueError):
    """Raised when a compiled goal is given a state that does not fit it.

    Args:
        atoms: How many atoms the goal depends on.
        got: What was given, in words.
    """

    def __init__(self, atoms: int, got: str) -> None:
        super().__init__(atoms, got)
        self.atoms = atoms
        self.got = got

    def __str__(self) -> str:
        return (
            f"{self.got} is no state of this goal: give a value for each of its {self.atoms} atoms in the order of "
            "`goal.atoms`, a set of the atoms that are true, or a mapping from atoms to values."
        )


class SearchLimit(RuntimeError):
    """Raised when a search stops before it knows whether there is more to find.

    Args:
        steps: How many steps it was allowed.
    """

    def __init__(self, steps: int) -> None:
        super().__init__(steps)
        self.steps = steps

    def __str__(self) -> str:
        return (
            f"The search for ways to make the goal true was stopped after {self.steps} steps; those found so far are "
            "right and the cheapest, but there may be more. Allow it more with steps=..."
        )
