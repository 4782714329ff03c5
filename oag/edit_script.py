"""The fewest changes that make one decomposition of another: subtasks inserted, left out and changed.

Source: Wagner and Fischer, The String-to-String Correction Problem (1974), with whole subtasks as letters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bddl
from bddl.terminal import pluralize
from oag.model.codec import brief
from oag.normal_form import content
from oag.task_definition import SimpleTask, Task
from oag.verify.edits import ChangeSubtask, DeleteSubtask, Edit, InsertSubtask, SetFlow, SetScale, SetTaskGoal

_FIELDS = ("target", "support_init", "support_goal", "init", "goal")
_KEEP, _CHANGE, _DELETE, _INSERT = range(4)
# Subtasks changed; of equally many, fields changed.
_Cost = tuple[int, int]


@dataclass(frozen=True, slots=True)
class EditScript:
    """The changes from one task to another, in the order in which they are applied.

    Attributes:
        edits: The changes.
        words: Each change in words.
        subtasks: How many subtasks are inserted, left out or changed; no script has fewer.
    """

    edits: tuple[Edit, ...]
    words: tuple[str, ...]
    subtasks: int

    def __repr__(self) -> str:
        return brief(f"<EditScript of {pluralize(len(self.edits), 'edit')}: {'; '.join(self.words)}>")

    def __str__(self) -> str:
        """Return the changes, a line each."""
        return "\n".join(self.words)

    def apply(self, task: Task) -> Task:
        """Return the task with all changes made; raises FixError for a task of another form."""
        for edit in self.edits:
            task = edit.apply(task)
        return task


def edit_script(first: Task, second: Task, *, flows: bool = False) -> EditScript:
    """Return the fewest changes that give the first task the subtasks, goal and scales of the second.

    Names and descriptions do not count; flows count where they are asked for. Forms to be compared are canonical ones.
    """
    edits: list[Edit] = []
    words: list[str] = []
    # Places of the edited plan, and numbers of the first one.
    place = changed = read = 0
    for what, one, other in _aligned(first.subtasks, second.subtasks, flows):
        number = f"T{read + 1}"
        if what == _INSERT and other is not None:
            edits.append(InsertSubtask(place, other))
            words.append(f'insert "{_title(other)}" as T{place + 1}')
        elif what == _DELETE and one is not None:
            edits.append(DeleteSubtask(place))
            words.append(f'leave out {number} "{_title(one)}"')
        elif what == _CHANGE and one is not None and other is not None:
            found, texts = _changes(place, one, other, flows)
            edits += found
            words.append(f'{number} "{_title(one)}": {", ".join(texts)}')
        changed += what != _KEEP
        place += what != _DELETE
        read += what != _INSERT
    if first.goal != second.goal:
        edits.append(SetTaskGoal(second.goal))
        words.append(f"task goal {bddl.format(first.goal)} to {bddl.format(second.goal)}")
    for name in sorted({*first.scales, *second.scales}):
        one_by, other_by = first.scales.get(name), second.scales.get(name)
        if one_by != other_by:
            edits.append(SetScale(name, other_by))
            words.append(f"scale of {name} {one_by or 1:g} to {other_by or 1:g}")
    return EditScript(tuple(edits), tuple(words), changed)


def _title(subtask: SimpleTask) -> str:
    return subtask.name.replace("_", " ")


def _aligned(
    first: Sequence[SimpleTask], second: Sequence[SimpleTask], flows: bool
) -> list[tuple[int, SimpleTask | None, SimpleTask | None]]:
    """Return the cheapest alignment of two sequences of subtasks, from the front."""
    rows, columns = len(first), len(second)
    # Costs of making `second[j:]` of `first[i:]`, and what is done first.
    best: dict[tuple[int, int], tuple[_Cost, int]] = {(rows, columns): ((0, 0), _KEEP)}
    for i in range(rows, -1, -1):
        for j in range(columns, -1, -1):
            moves: list[tuple[_Cost, int]] = []
            if i < rows and j < columns:
                fields = _difference(first[i], second[j], flows)
                moves.append((_plus(best[i + 1, j + 1][0], int(fields > 0), fields), _CHANGE if fields else _KEEP))
            if i < rows:
                moves.append((_plus(best[i + 1, j][0], 1, len(_FIELDS)), _DELETE))
            if j < columns:
                moves.append((_plus(best[i, j + 1][0], 1, len(_FIELDS)), _INSERT))
            if moves:
                best[i, j] = min(moves)
    found: list[tuple[int, SimpleTask | None, SimpleTask | None]] = []
    i = j = 0
    while (i, j) != (rows, columns):
        what = best[i, j][1]
        found.append((what, None if what == _INSERT else first[i], None if what == _DELETE else second[j]))
        i, j = i + (what != _INSERT), j + (what != _DELETE)
    return found


def _plus(cost: _Cost, subtasks: int, fields: int) -> _Cost:
    return cost[0] + subtasks, cost[1] + fields


def _difference(one: SimpleTask, other: SimpleTask, flows: bool) -> int:
    """Return how many fields of two subtasks differ; another target counts as two whole subtasks."""
    mine, theirs = content(one), content(other)
    keys = (*_FIELDS, "flow") if flows else _FIELDS
    changed = sum(mine.get(key) != theirs.get(key) for key in keys)
    return changed + 2 * len(_FIELDS) * (one.target != other.target)


def _changes(place: int, one: SimpleTask, other: SimpleTask, flows: bool) -> tuple[list[Edit], list[str]]:
    changed = [name for name in _FIELDS if getattr(one, name) != getattr(other, name)]
    # Of roles, "" stands for no support.
    values: dict[str, Any] = {name: "" if (v := getattr(other, name)) is None else v for name in changed}
    edits: list[Edit] = [ChangeSubtask(place, **values)] if changed else []
    texts = [f"{name} {_text(getattr(one, name))} to {_text(getattr(other, name))}" for name in changed]
    if flows and one.flow != other.flow:
        if other.flow is None:
            return [DeleteSubtask(place), InsertSubtask(place, other)], [*texts, "flow left open"]
        edits.append(SetFlow(place, other.flow))
        texts.append(f"flow {_flow(one)} to {_flow(other)}")
    return edits, texts


def _text(value: object) -> str:
    return bddl.format(value) if isinstance(value, bddl.Formula) else str(value or "none")


def _flow(subtask: SimpleTask) -> str:
    return "none" if subtask.flow is None else " ".join(map(str, subtask.flow))
