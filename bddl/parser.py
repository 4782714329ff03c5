"""The doors of the package: text to formula, text to problem, and mistakes as data."""

from __future__ import annotations

from collections.abc import Mapping

from bddl.diagnostics import BDDLError, Diagnostic, Reporter
from bddl.envelope import Wanted, is_problem, open_text
from bddl.forms import FormulaReader
from bddl.printer import format
from bddl.problem import Problem
from bddl.profiles import find_profile
from bddl.sections import ProblemReader
from bddl.syntax import Formula


def parse(text: str, profile: str = "scene", objects: Mapping[str, str] | None = None) -> Problem:
    """Returns the problem that a text defines.

    Args:
        text: A form `(define (problem NAME) (:domain NAME) (:objects ...) (:init ...) (:goal ...))`.
        profile: Name of the dialect.
        objects: Category of each object of the scene. When given, the problem may use them without declaring them,
            and may declare no others.

    Returns:
        The problem, with the place of every node in the text.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.
        UnknownProfile: There is no such profile.
    """
    found = _read(text, "problem", profile, objects)
    if not isinstance(found, Problem):
        raise TypeError("The reader returned a formula where a problem was asked for.")
    return found


def parse_formula(text: str, profile: str = "scene", objects: Mapping[str, str] | None = None) -> Formula:
    """Returns the formula that a text says.

    Args:
        text: One formula, such as `(not (open refrigerator_0))`.
        profile: Name of the dialect.
        objects: Category of each object of the scene; when given, a name that is none of them is a mistake. Without
            it any name may be an object.

    Returns:
        The formula, with the place of every node in the text.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.
        UnknownProfile: There is no such profile.

    Example:
        >>> import bddl
        >>> bddl.parse_formula("(and (open refrigerator_0) (inside glass_0 gripper))").parts[1]
        <Atom (inside glass_0 gripper)>
    """
    found = _read(text, "formula", profile, objects)
    if isinstance(found, Problem):
        raise TypeError("The reader returned a problem where a formula was asked for.")
    return found


def check(
    subject: str | Formula | Problem, profile: str = "scene", objects: Mapping[str, str] | None = None
) -> tuple[Diagnostic, ...]:
    """Returns the mistakes in a formula or a problem as data, none when it is legal.

    Args:
        subject: A text, or a tree. The places in the diagnostics of a tree refer to what `format` prints for it.
        profile: Name of the dialect.
        objects: Category of each object of the scene; when given, unknown objects and categories are mistakes too.

    Returns:
        The diagnostics, in the order of their places.

    Raises:
        UnknownProfile: There is no such profile.

    Example:
        >>> import bddl
        >>> print(bddl.check("(not (open refrigerator_0)")[0])
        line 1, column 27: A closing parenthesis is missing: the one opened at line 1, column 1 is never closed. \
[missing-parenthesis]
        1 | (not (open refrigerator_0)
          | -                         ^
        hint: write (not (open refrigerator_0))
        >>> [found.hint for found in bddl.check("(on cup_0 table_0)", objects={"glass_0": "glass", "table_0": "table"})]
        ['write (ontop cup_0 table_0)', 'did you mean glass_0?']
    """
    text = subject if isinstance(subject, str) else format(subject)
    try:
        _read(text, "any", profile, objects)
    except BDDLError as error:
        return error.diagnostics
    return ()


def _read(text: str, wanted: Wanted, profile: str, objects: Mapping[str, str] | None) -> Formula | Problem:
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    dialect = find_profile(profile)
    reporter = Reporter(text)
    results: list[Formula | Problem | None] = []
    for group in open_text(text, wanted, dialect, reporter):
        if is_problem(group):
            results.append(ProblemReader(dialect, objects, reporter).read(group))
        else:
            results.append(FormulaReader(dialect, objects, reporter).read(group))
    found = results[0] if len(results) == 1 else None
    if reporter or found is None:
        raise BDDLError(reporter.diagnostics)
    return found
