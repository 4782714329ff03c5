"""Corrected texts of conditions that cannot be read: what the parser would write, or a parenthesis more or less."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import bddl
from oag.model.diagnostic import Diagnostic
from oag.task.task import Task

# So many parentheses may be missing or left over at the end of a text.
_MOST_PARENTHESES = 3
# A longer text, or one with more mistakes, was not mistyped; every attempt reads all of it again.
_LONGEST_TEXT, _MOST_MISTAKES = 2_000, 20


class Correction(NamedTuple):
    """A formula that a text may have meant: the field it belongs to, and how sure that is (0 is best)."""

    field: str
    formula: bddl.Formula
    rank: int


def corrected_texts(task: Task, finding: Diagnostic) -> Iterator[Correction]:
    """Yields what the text that a finding speaks of may have meant; nothing when the text is not at hand."""
    field = finding.field or "goal"
    text = _text(task, finding, field)
    if text is None:
        return
    seen: set[bddl.Formula] = set()
    for rank, attempt in enumerate(_attempts(text, _names(task, finding))):
        try:
            formula = bddl.parse_formula(attempt)
        except bddl.BDDLError:
            continue
        if formula not in seen:
            seen.add(formula)
            yield Correction(field, formula, rank)


def _text(task: Task, finding: Diagnostic, field: str) -> str | None:
    """Returns the text of a condition as the task's file has it."""
    found = as_written(task, finding.subtask).get(field)
    return found if isinstance(found, str) else None


def as_written(task: Task, subtask: int | None) -> Mapping[str, object]:
    """Returns a subtask as the task's file has it, or the task itself for None; nothing when that is not at hand."""
    source: object = task.source
    if subtask is not None and isinstance(source, Mapping):
        listed = source.get("sub_tasks")
        if isinstance(listed, list | tuple) and subtask < len(listed):
            source = listed[subtask]
        else:
            source = source.get(f"sub_task_{subtask + 1}")
    return source if isinstance(source, Mapping) else {}


def _attempts(text: str, names: tuple[str, ...]) -> Iterator[str]:
    """Yields texts that may be what was meant, the likeliest first; `names` may be missing ones."""
    mistakes = bddl.check(text) if len(text) <= _LONGEST_TEXT else ()
    if not 0 < len(mistakes) <= _MOST_MISTAKES:
        return
    for mistake in mistakes:
        if mistake.replacement is not None:
            yield mistake.replacement.applied(text)
            yield mistake.replacement.text
    for mistake in mistakes:
        if mistake.code == "wrong-arity":
            yield from _other_arities(text, _offset(text, mistake), names)
    for count in range(1, _MOST_PARENTHESES + 1):
        yield text + ")" * count
        if text.rstrip().endswith(")" * count):
            yield text.rstrip()[:-count]


def _names(task: Task, finding: Diagnostic) -> tuple[str, ...]:
    """Returns the names that the subtask of a finding has to do with, its supports first."""
    roles = [(s.support_init, s.support_goal, s.target) for s in task.subtasks]
    own = roles[finding.subtask] if finding.subtask is not None else ()
    return tuple(dict.fromkeys(name for part in (own, *roles) for name in part if name))


def _other_arities(text: str, offset: int, names: tuple[str, ...]) -> Iterator[str]:
    """Yields texts in which the literal at an offset has a name more, or one of its names less."""
    start = text.rfind("(", 0, offset + 1)
    end = _closing(text, start)
    if start < 0 or end is None or "(" in text[start + 1 : end]:
        return
    words = text[start + 1 : end - 1].split()
    for name in names:
        yield f"{text[:start]}({' '.join((*words, name))}){text[end:]}"
    for position in range(len(words) - 1, 0, -1):
        yield f"{text[:start]}({' '.join((*words[:position], *words[position + 1 :]))}){text[end:]}"


def _offset(text: str, mistake: bddl.Diagnostic) -> int:
    """Returns where a mistake begins in a text, from 0."""
    return sum(len(line) + 1 for line in text.split("\n")[: mistake.line - 1]) + mistake.column - 1


def _closing(text: str, start: int) -> int | None:
    """Returns where the form that is opened at a place ends, or None when it does not."""
    depth = 0
    for position in range(max(start, 0), len(text)):
        depth += {"(": 1, ")": -1}.get(text[position], 0)
        if depth == 0:
            return position + 1
    return None
