"""From text to what it says: a formula, a problem or a domain, with everything that was found on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from bddl.reading.envelope import Wanted, kind_of, open_text
from bddl.reading.formulas.forms import FormulaReader
from bddl.reading.problems.domain_reader import read_domain
from bddl.reading.problems.problem_reader import read_problem
from bddl.reading.words.forest import Forest
from bddl.reading.words.free_text import hide_free_text
from bddl.syntax import Formula
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.places import Source
from bddl.syntax.problem import Domain, Problem
from bddl.syntax.profiles import Profile

Subject: TypeAlias = Formula | Problem | Domain


@dataclass(frozen=True, slots=True)
class Reading:
    """What came of reading a text.

    Attributes:
        found: What the text says, or None when it is wrong.
        profile: The dialect that it was read in, with the predicates of its domain.
        reporter: Has the text and what was found in it.
        forest: The forms and loose words of the text, their parentheses put right where that was needed.
    """

    found: Subject | None
    profile: Profile
    reporter: Reporter
    forest: Forest


def read_text(
    text: str,
    wanted: Wanted,
    profile: Profile,
    objects: Mapping[str, str] | None,
    domain: Domain | None = None,
) -> Reading:
    """Reads a text.

    Args:
        text: The text.
        wanted: What it should be: a formula, a problem, a domain, or any of them.
        profile: The dialect.
        objects: Category of each object of the scene, or None when they are not checked.
        domain: The domain whose predicates may be used; by default those of the profile.

    Raises:
        TypeError: The text is no string.
    """
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    dialect = profile if domain is None else profile.for_domain(domain.specs)
    reporter = Reporter(text, dialect.tolerated)
    if dialect.free_text:
        reporter.source = Source(hide_free_text(text, dialect.free_text))
    results: list[Subject | None] = []
    forest, groups = open_text(wanted, dialect, reporter)
    for group in groups:
        kind = kind_of(group)
        if kind == "problem":
            results.append(read_problem(group, dialect, objects, domain, reporter))
        elif kind == "domain":
            results.append(read_domain(group, reporter))
        else:
            results.append(FormulaReader(dialect, objects, reporter).read(group))
    found = results[0] if len(results) == 1 and not reporter else None
    if reporter.diagnostics and isinstance(found, Problem | Domain):
        found = replace(found, warnings=reporter.diagnostics)
    return Reading(found, dialect, reporter, forest)
