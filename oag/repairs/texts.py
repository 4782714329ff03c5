"""Corrected texts of conditions that could not be read: with the parser's own hint, or a parenthesis more or less."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import bddl
from oag.model.diagnostic import Diagnostic
from oag.task.task import Task

# So many parentheses may be missing or left over at the end of a text.
_MOST_PARENTHESES = 3


class Correction(NamedTuple):
    """A formula that a text may have meant: the field it belongs to, and how sure that is (0 is best)."""

    field: str
    formula: bddl.Formula
    rank: int


def corrected_texts(task: Task, finding: Diagnostic) -> Iterator[Correction]:
    """Yields what the text that a finding speaks of may have meant; nothing when the text is not at hand."""
    field = "init" if finding.place.endswith("init") else "goal"
    text = _text(task, finding, field)
    if text is None:
        return
    seen: set[bddl.Formula] = set()
    for rank, attempt in enumerate(_attempts(text, finding, _names(task, finding))):
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


def _attempts(text: str, finding: Diagnostic, names: tuple[str, ...]) -> Iterator[str]:
    """Yields texts that may be what was meant, the likeliest first; `names` may be missing ones."""
    hint = finding.hint or ""
    if hint.startswith("write ("):
        meant = hint.removeprefix("write ")
        opened = text.find("(", max(0, _column(finding) - 2))
        before = text.rfind("(", 0, _column(finding))
        for start in (before, opened):
            end = _closing(text, start)
            if start >= 0 and end is not None:
                yield text[:start] + meant + text[end:]
        yield meant
    if finding.code == "bddl/arity":
        yield from _other_arities(text, _column(finding), names)
    for count in range(1, _MOST_PARENTHESES + 1):
        yield text + ")" * count
        if text.rstrip().endswith(")" * count):
            yield text.rstrip()[:-count]


def _names(task: Task, finding: Diagnostic) -> tuple[str, ...]:
    """Returns the names that the subtask of a finding has to do with, its supports first."""
    roles = [(s.support_init, s.support_goal, s.target) for s in task.subtasks]
    own = roles[finding.subtask] if finding.subtask is not None else ()
    return tuple(dict.fromkeys(name for part in (own, *roles) for name in part if name))


def _other_arities(text: str, column: int, names: tuple[str, ...]) -> Iterator[str]:
    """Yields texts in which the literal at a place has a name more, or one of its names less."""
    start = text.rfind("(", 0, max(column, 1))
    end = _closing(text, start)
    if start < 0 or end is None or "(" in text[start + 1 : end]:
        return
    words = text[start + 1 : end - 1].split()
    for name in names:
        yield f"{text[:start]}({' '.join((*words, name))}){text[end:]}"
    for position in range(len(words) - 1, 0, -1):
        yield f"{text[:start]}({' '.join((*words[:position], *words[position + 1 :]))}){text[end:]}"


def _column(finding: Diagnostic) -> int:
    """Returns the column that a finding's message names, or 0."""
    words = finding.message.rpartition("column ")[2]
    digits = words[: len(words) - len(words.lstrip("0123456789"))]
    return int(digits) if digits else 0


def _closing(text: str, start: int) -> int | None:
    """Returns where the form that is opened at a place ends, or None when it does not."""
    depth = 0
    for position in range(max(start, 0), len(text)):
        depth += {"(": 1, ")": -1}.get(text[position], 0)
        if depth == 0:
            return position + 1
    return None
