"""Diagnostics of wrong plans, as data, and exceptions for misuse and malformed files.

A wrong plan is never an exception but a `Diagnostic`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Literal

from oag.model.errors import OagError as OagError

_NONE: Mapping[int, str] = MappingProxyType({})


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
    """Return all problems of a file as one message: a heading, and a line each."""
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
    """`compose` got a task that carries no scene, and no scene as an argument."""

    def __init__(self, task_name: str) -> None:
        super().__init__(
            f"task {task_name!r} carries no scene: pass one, as in compose(task, scene=scene) "
            "or Task.from_json(path, scene=scene)"
        )


class FixError(OagError):
    """A fix was applied to a task other than the one whose report offered it."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"the fix does not fit: {problem}; apply it to the task of the report that offers it")


class EvidenceError(OagError, ValueError):
    """Counts do not allow a probability, such as more successes than trials."""


class HistoryFull(OagError):
    """One more revision was recorded than an evolution may try."""


class RecordError(InputError):
    """The JSON of an evolution's record is malformed: a missing field, a wrong type."""

    what = "record"


class NoSuchSubtask(OagError, IndexError):
    """A subtask was asked for that a task does not have."""


Severity = Literal["error", "warning", "note"]


# Places of a task outside its subtasks.
TASK_GOAL, SCALES = "task goal", "scales"


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding of `verify`, with everything that a person or a revising model needs to act.

    Attributes:
        code: Stable code; `docs/codes.md` explains each.
        severity: "error" refutes the plan, "warning" does not, "note" is information.
        message: The finding in words, without the place.
        place: Where, in words: `T3 put_glass_into_refrigerator, step 4 UNGRASP`.
        subtask: Index of the subtask, from 0; None for the task as a whole.
        step: Index of the step in the subtask's flow, from 0; None for the subtask as a whole.
        literal: The literal that was needed, in words: `open(refrigerator_0)`.
        since: The write that set the literal's value: `the start`, `T2 step 4 GRASP`.
        start: Literals of one concrete start state in which the failure happens.
        stops_at: Where the plan stops from that state, such as `T3.4`.
        hint: What to change, or near names.
        excerpt: Lines of source text with a caret, for syntax.
        eai_label: The label of the same mistake in the Embodied Agent Interface's taxonomy, by default the code's.
        dependent: How many later failures follow from this one and are not reported.
        also: Other errors that the fixes of this one remove too, each with its place; only in `report.findings`.
        fixes: Verified repairs, in words; only in `report.findings`, not in `report.diagnostics`.
        field: What it is in: "init", "goal" or the scene's "facts"; else None. This and the next fields serve repairs
            and are not in the JSON.
        about: What distinguishes it from others of its code, such as the unknown name.
        meant: Numbers of the primitives that an unknown one may stand for, the likeliest first.
    """

    code: str
    severity: Severity
    message: str
    place: str = ""
    subtask: int | None = None
    step: int | None = None
    literal: str | None = None
    since: str | None = None
    start: tuple[str, ...] = ()
    stops_at: str | None = None
    hint: str | None = None
    excerpt: str | None = None
    eai_label: str | None = None
    dependent: int = 0
    also: tuple[str, ...] = ()
    fixes: tuple[str, ...] = ()
    field: str | None = None
    about: tuple[str, ...] = ()
    meant: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Label the finding by its code, unless it comes with another label."""
        if self.eai_label is None and self.code in CODES:
            object.__setattr__(self, "eai_label", CODES[self.code].eai)

    def __repr__(self) -> str:
        # Of what was written by others, the beginning is enough here.
        text = " ".join(f"{self.code} ({self.severity}) {self.place}: {self.literal or self.message}".split())
        return f"<Diagnostic {text}>" if len(text) <= 185 else f"<Diagnostic {text[:182]}...>"

    @property
    def brief(self) -> str:
        """The finding in one line: code, place, and what was needed or what is wrong."""
        text = f"needs {self.literal}" if self.literal is not None else self.message.partition("\n")[0]
        return f"{self.code}  {self.place}: {text}"

    def __str__(self) -> str:
        """Return the finding as a short block of text for a terminal or for a model's prompt."""
        kind = "" if self.severity == "error" else f" ({self.severity})"
        lines = [f"{self.code}{kind}  {self.place}".rstrip()]
        if self.literal is not None:
            lines.append(_row("needs", self.literal))
        lines.extend(
            _row("but" if self.literal and index == 0 else "", line)
            for index, line in enumerate(self.message.splitlines())
        )
        if self.excerpt is not None:
            lines.extend(f"  {'':7} | {line}" for line in self.excerpt.splitlines())
        if self.start:
            reach = f"; from there the plan stops at {self.stops_at}" if self.stops_at else ""
            lines.append(_row("start", ", ".join(self.start) + reach))
        if self.hint is not None:
            lines.extend(_rows("hint", self.hint))
        if self.dependent:
            lines.append(_row("", _dependent_text(self.dependent)))
        for index, other in enumerate(self.also):
            lines.append(_row("also" if index == 0 else "", other))
        for fix in self.fixes:
            lines.extend(_rows("fix", fix))
        return "\n".join(lines)

    def to_json(self) -> dict[str, object]:
        """Return the finding as JSON values; absent details are left out."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        entries = ((key, list(value) if isinstance(value, tuple) else value) for key, value in values.items())
        return {
            key: value
            for key, value in entries
            if key not in _NOT_WRITTEN and (key in _ALWAYS or value not in (None, "", [], 0))
        }


# Indices are kept even when they are 0 or null: they distinguish subtask 0 from the whole task.
_ALWAYS = frozenset({"code", "severity", "message", "subtask", "step"})
# Fields for repairs.
_NOT_WRITTEN = frozenset({"field", "about", "meant"})


def _row(label: str, text: str) -> str:
    return f"  {label:7} {text}".rstrip()


def _rows(label: str, text: str) -> list[str]:
    return [_row(label if index == 0 else "", line) for index, line in enumerate(text.splitlines())]


def _dependent_text(count: int) -> str:
    noun = "later failure follows" if count == 1 else "later failures follow"
    return f"{count} {noun} from this one"


@dataclass(frozen=True, slots=True)
class CodeInfo:
    """Meaning of a diagnostic code.

    Attributes:
        eai: Label in the Embodied Agent Interface's taxonomy of errors, None where it has none.
    """

    meaning: str
    eai: str | None = None


CODES: Mapping[str, CodeInfo] = MappingProxyType(
    {
        "bddl/syntax": CodeInfo("A formula's text is no BDDL, such as one with a missing parenthesis.", "PARSE_ERROR"),
        "bddl/unknown-predicate": CodeInfo("A formula uses a predicate that the vocabulary lacks.", "HALLUCINATION"),
        "bddl/unknown-object": CodeInfo("A role or a formula names an object that the scene lacks.", "UNSEEN_OBJECT"),
        "bddl/unknown-category": CodeInfo("A quantifier ranges over a category of which the scene has no object."),
        "bddl/too-many-instances": CodeInfo("The quantifiers of a task say too much to be decided in this scene."),
        "bddl/arity": CodeInfo("A predicate has too few or too many arguments.", "PARAMETER_ERROR"),
        "bddl/kind": CodeInfo("A formula says of an object what its kind cannot be.", "AFFORDANCE_ERROR"),
        "task/role-scope": CodeInfo("The roles of a subtask do not fit each other or its goal.", "PARAMETER_ERROR"),
        "task/contradictory": CodeInfo("A condition, or the scene's facts, cannot be true in any state."),
        "task/vacuous": CodeInfo("A subtask's goal holds already when it starts.", "ADDITIONAL_STEP"),
        "task/empty": CodeInfo("A task has no subtasks, so nothing is done.", "MISSING_STEP"),
        "task/size": CodeInfo("An item is too wide to be grasped, or is scaled by too much.", "AFFORDANCE_ERROR"),
        "task/infeasible": CodeInfo("A subtask is one that geometry found impossible, in the same circumstances."),
        "task/scaled": CodeInfo("An object is run at another size than it has in the scene."),
        "flow/unknown-primitive": CodeInfo("A flow uses a primitive that does not exist.", "HALLUCINATION"),
        "flow/parameter": CodeInfo("A primitive's parameter has the wrong form or range.", "PARAMETER_ERROR"),
        "flow/unfilled": CodeInfo("Numbers are left for the executor's geometric planner to fill in."),
        "flow/kind": CodeInfo("A primitive acts on an object whose kind it cannot act on.", "AFFORDANCE_ERROR"),
        "flow/no-flow": CodeInfo("A subtask has no action flow: none was given, and none exists or was found."),
        "flow/searched": CodeInfo("A subtask came without a flow, and a search found one."),
        "flow/precondition": CodeInfo("A primitive's precondition does not hold when it runs.", "MISSING_STEP"),
        "flow/goal-not-reached": CodeInfo("A subtask's goal does not hold when its flow has run.", "MISSING_STEP"),
        "locality/outside-scope": CodeInfo("A step changes an object that its subtask does not speak of."),
        "locality/clobbers": CodeInfo("A step undoes another subtask's goal, which its own is not there to change."),
        "locality/cargo": CodeInfo("What lies on or in the grasped object moves with it."),
        "context/start": CodeInfo("The first subtask's initial condition is false at the start."),
        "context/refuted": CodeInfo("A later subtask's initial condition is false where it starts.", "MISSING_STEP"),
        "context/open": CodeInfo("What a step or a condition needs is unknown."),
        "context/undecided": CodeInfo(
            "The solver's time ran out before the plan was decided exactly, or too much was unknown."
        ),
        "context/goal-gap": CodeInfo("A subtask's goal says less than what the rest of the plan needs of it."),
        "goal/not-reached": CodeInfo("The task goal does not hold at the end.", "MISSING_STEP"),
        "goal/undone": CodeInfo("A step undoes what a subtask had reached of the task goal.", "WRONG_TEMPORAL_ORDER"),
        "goal/holds-at-start": CodeInfo("The task goal holds before anything has moved.", "ADDITIONAL_STEP"),
        "goal/omits-effect": CodeInfo("The task goal does not speak of what a subtask is there to bring about."),
        "revision/repeated": CodeInfo("A revised flow is one that failed already, up to a tolerance on its numbers."),
        "revision/assumes": CodeInfo("A revised flow needs something unknown that the flow before did not need."),
        "revision/too-long": CodeInfo("A revised flow has more steps than a revision may have."),
        "revision/exhausted": CodeInfo("A subtask was revised as often as the history allows."),
    }
)

WRONG_ORDER = "WRONG_TEMPORAL_ORDER"
