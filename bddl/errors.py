"""Exceptions for misuse of this package's functions, and the base of all packages' exceptions.

Mistakes in a text are diagnostics instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar


@dataclass(eq=False, repr=False)
class IllegalName(ValueError):
    """Raised when a formula is built from a name that BDDL text cannot carry.

    Attributes:
        role: What the name was meant for, such as "predicate".
        name: The name as it was given.
        rule: What a name in this role may look like.
    """

    role: str
    name: object
    rule: str

    def __str__(self) -> str:
        article = "an" if self.role[:1] in "aeiou" else "a"
        return f"{self.name!r} cannot be the name of {article} {self.role}: {self.rule}."


@dataclass(eq=False, repr=False)
class UnknownProfile(ValueError):
    """Raised when a profile is asked for that does not exist.

    Attributes:
        name: The profile asked for.
        legal: The names of the profiles there are.
        near: The legal names that resemble it.
    """

    name: str
    legal: tuple[str, ...]
    near: tuple[str, ...] = ()

    def __str__(self) -> str:
        meant = f" Did you mean {' or '.join(repr(option) for option in self.near)}?" if self.near else ""
        return f"There is no BDDL profile {self.name!r}.{meant} The profiles are: {', '.join(self.legal)}."


@dataclass(eq=False, repr=False)
class ObjectsRequired(ValueError):
    """Raised when a quantifier, over a variable of a category, is evaluated without the objects that it ranges over."""

    variable: str
    category: str

    def __str__(self) -> str:
        return (
            f"The quantifier over (?{self.variable} - {self.category}) ranges over the scene's objects, "
            "which were not given: pass objects={id: category, ...}."
        )


@dataclass(eq=False, repr=False)
class CountedWildcard(UserWarning):
    """Warned of when a quantifier ranges over a wildcard, which stands for any number of objects.

    Attributes:
        name: The wildcard, such as `sink.n.01_*`.
        category: The category that the quantifier ranges over.
    """

    name: str
    category: str

    def __str__(self) -> str:
        return (
            f"`{self.name}` is counted as one object of `{self.category}`, and stands for all further ones in the "
            "room: the result is about a scene with exactly one."
        )


@dataclass(eq=False, repr=False)
class UnknownPairSemantics(ValueError):
    """Raised when `pairs` names no semantics of `forpairs`."""

    name: str
    legal: tuple[str, ...]

    def __str__(self) -> str:
        return f"`forpairs` cannot be read as {self.name!r}: pairs is {' or '.join(repr(word) for word in self.legal)}."


@dataclass(eq=False, repr=False)
class SolverMissing(RuntimeError):
    """Raised when a question needs z3 and z3 is not installed; `why` is the text of the ImportError."""

    why: str

    def __str__(self) -> str:
        return f"This has to be decided by z3, which cannot be loaded ({self.why}): pip install z3-solver."


@dataclass(eq=False, repr=False)
class SearchLimit(RuntimeError):
    """Raised when a search has used up its steps before it knows whether there is more to find."""

    steps: int

    def __str__(self) -> str:
        return (
            f"The search for ways to make the goal true was stopped after {self.steps} steps; those found so far are "
            "right and the cheapest, but there may be more. Allow it more with steps=..."
        )


class Scene2DemoError(Exception):
    """Base of every exception that says what to do about bad input, or about work that failed.

    A command shows its message and ends with its exit code. Its copies by `pickle` and `copy` are equal to it, whatever
    its constructor takes. Whatever else leaves a command is a mistake of this program.

    Attributes:
        exit_code: Exit code of a command that it ends: 2 for bad input, 1 for work that ran and failed.
    """

    exit_code: ClassVar[int] = 2

    def __reduce__(self) -> tuple[object, ...]:
        """Return the function that makes a copy without the constructor, its arguments, and the attributes."""
        return _restore, (type(self), self.args), *super().__reduce__()[2:]


def _restore(kind: type[Scene2DemoError], args: tuple[object, ...]) -> Scene2DemoError:
    error = kind.__new__(kind, *args)
    BaseException.__init__(error, *args)  # OSError's `__new__` leaves the message to its constructor.
    return error


@dataclass(eq=False, repr=False)
class FormulaTooLarge(ValueError):
    """Raised when formulas have too many parts, once their quantifiers are expanded, for a solver."""

    most: int

    def __str__(self) -> str:
        return (
            f"With every quantifier expanded, the formulas have more than {self.most} parts: give fewer objects, or "
            "fewer nested quantifiers."
        )
