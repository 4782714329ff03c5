"""Exceptions for misuse and malformed files; a wrong plan is never an exception but a `Diagnostic`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from bddl.syntax.errors import Portable

_NONE: Mapping[int, str] = MappingProxyType({})


class OagError(Portable):
    """Every exception that this package raises on purpose."""


class InputError(OagError):
    """A file or mapping does not have the documented form; raised through its children.

    Attributes:
        source: The file's name, or "(mapping)" for data handed over in memory.
        place: Where in the JSON, such as `objects.glass_0.bbox_extent`; empty for the whole document.
        problem: What was found and what was expected there.
    """

    what = "input"

    def __init__(self, problem: str, *, source: str = "(mapping)", place: str = "", hint: str = "") -> None:
        self.source = source
        self.place = place
        self.problem = problem
        self.hint = hint
        where = f"{source}: {place}" if place else source
        super().__init__(f"{self.what} {where}: {problem}" + (f" ({hint})" if hint else ""))


class SceneError(InputError):
    """A scene is malformed, or an object was asked for that it does not have."""

    what = "scene"


def listed(problems: Collection[str]) -> str:
    """Returns everything that is wrong with a file as one message: a heading, and a line each."""
    count = "1 thing is wrong" if len(problems) == 1 else f"{len(problems)} things are wrong"
    return "".join((f"{count}:", *(f"\n  - {problem}" for problem in problems)))


class TaskError(InputError):
    """A task file is malformed: JSON syntax, a missing field, a wrong type. Wrong plans are not errors."""

    what = "task"


class CertificateError(InputError):
    """A certificate's file is no JSON object, or one that is no certificate."""

    what = "certificate"


class FlowError(OagError):
    """An action flow's JSON cannot be read.

    Attributes:
        code: The diagnostic code that a task file's flow gets for the same mistake.
        index: Index of the item in the flow, from 0; None when the flow as a whole is no list.
        meant: Numbers of the primitives that an unknown one may stand for, the likeliest first.
        near: The same with their names.
    """

    def __init__(self, problem: str, *, code: str, index: int | None = None, meant: Mapping[int, str] = _NONE) -> None:
        self.problem = problem
        self.code = code
        self.index = index
        self.meant = tuple(meant)
        self.near = tuple(f"{number} {name}" for number, name in meant.items())
        at = "" if index is None else f"item {index}: "
        hint = f"; did you mean {' or '.join(self.near)}?" if self.near else ""
        super().__init__(f"action flow: {at}{problem}{hint}")


class MissingScene(OagError):
    """`compose` got a task that carries no scene, and no scene beside it."""

    def __init__(self, task_name: str) -> None:
        super().__init__(
            f"task {task_name!r} carries no scene: pass one, as in compose(task, scene=scene) "
            "or Task.from_json(path, scene=scene)"
        )


class FixError(OagError):
    """A fix was applied to another task than the one whose report offered it."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"the fix does not fit: {problem}; apply it to the task of the report that offers it")


class EvidenceError(OagError, ValueError):
    """Counts from which no probability can be concluded: more successes than trials, or a chain that does not chain."""


class HistoryFull(OagError):
    """One more revision was recorded than an evolution may try."""


class RecordError(InputError):
    """The JSON of an evolution's record is malformed: a missing field, a wrong type."""

    what = "record"


class NoSuchSubtask(OagError, IndexError):
    """A subtask was asked for that a task does not have."""
