"""A problem while its sections are being read, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from bddl.diagnostics import Reporter
from bddl.domain import Domain
from bddl.problem import TypedObject
from bddl.profiles import Profile
from bddl.reading.forest import Group
from bddl.reading.forms import FormulaReader
from bddl.reading.sections import UNNAMED
from bddl.syntax import Formula


@dataclass(slots=True)
class ProblemDraft:
    """A problem that is being read.

    Attributes:
        profile: The dialect; from the section `:domain` on with the predicates of that domain.
        reporter: Receives the diagnostics.
        scene: Objects that exist besides those declared, or None; when given, declared ones must be among them.
        given: The domain that the caller gave, if any.
        name: Name of the problem.
        domain: Name of its domain.
        objects: Its declared objects.
        terms: Further names that formulas may use as objects, with their categories, such as regions.
        init: The initial literals.
        goal: The goal, once it was read without a mistake.
        fields: What the sections of a dialect of its own hold, by attribute of its class of problems.
    """

    profile: Profile
    reporter: Reporter
    scene: Mapping[str, str] | None
    given: Domain | None
    name: str = UNNAMED
    domain: str = UNNAMED
    objects: tuple[TypedObject, ...] = ()
    terms: dict[str, str] = field(default_factory=dict)
    init: tuple[Formula, ...] = ()
    goal: Formula | None = None
    fields: dict[str, Any] = field(default_factory=dict)

    def formulas(self) -> FormulaReader:
        """Returns a reader that knows every object named so far."""
        known = {**(self.scene or {}), **{item.name: item.category for item in self.objects}, **self.terms}
        return FormulaReader(self.profile, known, self.reporter)


# A section may be there several times where that is tolerated; its reader gets all of them, in the order of the text.
SectionReader: TypeAlias = Callable[[ProblemDraft, Sequence[Group]], None]
