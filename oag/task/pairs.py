"""Subtasks given as BDDL: a problem, or an initial state and a goal, as the paper's module 3 writes them.

Source: the paper's BDDL generation, and its table of initial and goal states.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import bddl
from bddl.boundedfile import read_bounded_text
from oag.model.diagnostic import Diagnostic
from oag.model.errors import TaskError
from oag.task.taskfile import UNREADABLE, syntax_issues

# A problem, its text, the path of its file, or (initial state, goal), each as a formula or as its text.
Pair = bddl.Problem | str | os.PathLike[str] | tuple[str | bddl.Formula, str | bddl.Formula]
_Read = TypeVar("_Read")


@dataclass(frozen=True, slots=True)
class PairFields:
    """What one pair says of a subtask; mistakes in its text are kept as issues."""

    name: str
    init: bddl.Formula
    goal: bddl.Formula
    issues: tuple[Diagnostic, ...]


def read_pair(pair: Pair, index: int, profile: str) -> PairFields:
    """Returns what one pair says.

    Args:
        pair: A problem or a pair; a string that begins with a parenthesis is a text, any other one a path.
        index: Index of the subtask, from 0.
        profile: The dialect of texts.

    Raises:
        TaskError: It is neither, or its file cannot be read.
    """
    name = f"subtask_{index + 1}"
    if isinstance(pair, bddl.Problem):
        return _of_problem(pair)
    if isinstance(pair, str | os.PathLike):
        text = _text(pair)
        problem, issues = _parsed(lambda: bddl.parse(text, profile=profile), "")
        return PairFields(name, UNREADABLE, UNREADABLE, issues) if problem is None else _of_problem(problem)
    parts: object = pair
    if isinstance(parts, tuple | list) and len(parts) == 2:
        init, init_issues = read_condition(pair[0], "init", profile, f"pairs[{index}].")
        goal, goal_issues = read_condition(pair[1], "goal", profile, f"pairs[{index}].")
        return PairFields(name, init, goal, (*init_issues, *goal_issues))
    raise TaskError(
        f"expected a BDDL problem or a pair (initial state, goal), got {type(pair).__name__}", place=f"pairs[{index}]"
    )


def read_condition(
    condition: str | bddl.Formula, place: str, profile: str, within: str = ""
) -> tuple[bddl.Formula, tuple[Diagnostic, ...]]:
    """Returns a formula, or the one that a text says; a text that says none becomes a stand-in with issues.

    Raises:
        TaskError: It is neither a formula nor a text.
    """
    if isinstance(condition, bddl.Formula):
        return condition, ()
    if not isinstance(condition, str):
        raise TaskError(f"expected a formula or its text, got {type(condition).__name__}", place=within + place)
    formula, issues = _parsed(lambda: bddl.parse_formula(condition, profile=profile), place)
    return (UNREADABLE if formula is None else formula), issues


def _parsed(read: Callable[[], _Read], place: str) -> tuple[_Read | None, tuple[Diagnostic, ...]]:
    """Returns what a parser read, or what it found wrong."""
    try:
        return read(), ()
    except bddl.BDDLError as problem:
        return None, syntax_issues(problem, place)


def _of_problem(problem: bddl.Problem) -> PairFields:
    """Returns the fields of a problem."""
    init = problem.init[0] if len(problem.init) == 1 else bddl.And(problem.init)
    return PairFields(problem.name, init, problem.goal, ())


def _text(source: str | os.PathLike[str]) -> str:
    """Returns the text of a problem, from its file unless it is one already."""
    if isinstance(source, str) and source.lstrip().startswith(("(", ";")):
        return source
    try:
        return read_bounded_text(source)
    except OSError as problem:
        raise TaskError(f"cannot be read: {problem.strerror or problem}", source=str(source)) from problem
    except UnicodeDecodeError as problem:
        raise TaskError(f"is not UTF-8 text (byte {problem.start})", source=str(source)) from problem
