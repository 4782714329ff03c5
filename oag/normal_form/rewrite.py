"""What a rule of the canonical form says: which subtasks of a plan become which.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from oag.normal_form.survey import Place
from oag.task.task import SimpleTask


@dataclass(frozen=True, slots=True)
class Rewrite:
    """One change: `count` subtasks from `index` on become `result`.

    Attributes:
        rule: Name of the rule, as docs/canonical.md has it.
        index: Index of the first subtask that it replaces.
        count: How many it replaces.
        result: What stands there afterwards.
    """

    rule: str
    index: int
    count: int
    result: tuple[SimpleTask, ...]


Rule = Callable[[Sequence[Place], int], Rewrite | None]
