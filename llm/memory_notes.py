"""Notes of corrections that worked: their file format, and the search for notes that resemble a failure.

A note is Markdown with a TOML front part between lines of `+++`. The front part is validated strictly; only it
counts, and the text below it is for people. Similarity is a sum of points, each of them reported. There is no
embedding and no index: a memory has hundreds of notes, and a person can check every score.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainValidator, ValidationError
from pydantic_core import PydanticCustomError

import bddl
from llm.errors import LlmError
from llm.evolve.diagnosis import CauseKind, diagnose
from llm.structured.schema import without_control
from oag import Primitive, Scene, Task
from oag.model.actions import ActionFlow, flow_from_json, flow_to_json
from oag.model.codec import STRICT
from oag.model.diagnostics import FlowError
from oag.model.forms import first_mistake
from oag.model.symbols import kind_of
from oag.revision import MOST_STEPS, Attempt

SCHEMA = "scene2demo-skill/1"
MOST_EVIDENCE = 200
LONGEST_LESSON = 600
PROVEN = 2
"""Number of episodes a correction must have helped in before it is tried ahead of corrections from measurements."""
Kind = Literal["open", "close", "pick", "place", "other"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Outcome = Literal["succeeded", "failed"]
_NAME_WORDS = 6
_LONGEST_FLOW = 4_000
LONGEST_FILE = 150_000
"""Upper limit: a note with the most evidence and the longest legal words has fewer characters."""
_FENCE = "+++"


class NoteError(LlmError):
    """A file is no valid note; the message gives the reason."""


def _primitive(value: object) -> Primitive:
    if isinstance(value, Primitive):
        return value
    if not isinstance(value, str) or value not in Primitive.__members__:
        raise PydanticCustomError("primitive", "there is no primitive {name}", {"name": str(value)[:60]})
    return Primitive[value]


def _flow(value: object) -> ActionFlow:
    """Parse a flow from a text; a flow that is parsed already is returned unchanged."""
    if isinstance(value, tuple):
        return value
    try:
        if not isinstance(value, str) or len(value) > _LONGEST_FLOW:
            raise ValueError(f"expected a text of at most {_LONGEST_FLOW} characters")
        flow = flow_from_json(STRICT.decode(value))
    except (FlowError, ValueError, RecursionError) as problem:
        raise PydanticCustomError("flow", "no action flow: {said}", {"said": str(problem)[:200]}) from None
    if not 1 <= len(flow) <= MOST_STEPS:
        raise PydanticCustomError("flow", "a flow has 1 to {most} steps", {"most": MOST_STEPS})
    return flow


_Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(without_control)]
_Flow = Annotated[ActionFlow, PlainValidator(_flow)]


class _Front(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Trial(_Front):
    """One run of a correction.

    Attributes:
        task: The task's name.
        seed: The episode's seed; None when it had none.
        outcome: Whether the subtask's goal was reached with it.
        revisions: Number of revisions of the subtask until then.
    """

    task: _Line
    seed: int | None = Field(default=None, ge=0)
    outcome: Outcome
    revisions: int = Field(ge=0, le=1_000)


class Note(_Front):
    """One correction.

    Attributes:
        cause: Root cause in a few words, as named by the search over measurements or by a model.
        primitive: Primitive of the step with the cause.
        kind: Kind of the subtask.
        target: Category of its target.
        support: Category of the target's source or destination; empty for none.
        before: The flow that failed.
        after: The flow that succeeded.
        lesson: Reason of the change, in a few sentences.
        evidence: Its runs.
    """

    cause: _Line
    primitive: Annotated[Primitive, PlainValidator(_primitive)]
    kind: Kind
    target: _Line
    support: Annotated[str, Field(max_length=120), AfterValidator(without_control)]
    before: _Flow
    after: _Flow
    lesson: Annotated[str, Field(max_length=LONGEST_LESSON), AfterValidator(without_control)] = ""
    evidence: Annotated[tuple[Trial, ...], Field(max_length=MOST_EVIDENCE, strict=False)] = ()

    @property
    def name(self) -> str:
        """Name of the note and of its file: words of the cause, and a digest of all but lesson and evidence."""
        words = re.findall(r"[a-z0-9]+", f"{self.kind} {self.target} {self.cause}".lower().replace("_", " "))
        flows = [flow_to_json(self.before), flow_to_json(self.after)]
        key = json.dumps([self.cause, self.primitive.name, self.kind, self.target, self.support, *flows])
        digest = hashlib.sha256(key.encode()).hexdigest()[:8]
        return "-".join((*(word[:20] for word in words[:_NAME_WORDS]), digest))

    @property
    def successes(self) -> int:
        """Number of successful runs."""
        return sum(entry.outcome == "succeeded" for entry in self.evidence)

    @property
    def proven(self) -> bool:
        """Whether it helped in several episodes: an offset of a single one is no skill."""
        return self.successes >= PROVEN

    @property
    def rate(self) -> float:
        """Rate of successful runs, with one success and one failure added, so that one case is not certainty."""
        return (self.successes + 1) / (len(self.evidence) + 2)

    def line(self) -> str:
        """Return the note on one line, for a model."""
        place = f", {self.support}" if self.support else ""
        return (
            f"{self.kind} {self.target}{place}: at {self.primitive.name}, {self.cause}. "
            f"{json.dumps(flow_to_json(self.before))} failed, {json.dumps(flow_to_json(self.after))} "
            f"worked in {self.successes} of {len(self.evidence)} runs. {self.lesson}"
        )


# Legal lines of notes. TOML has more, such as dotted keys: 40 kB of them become gigabytes before they are refused.
_LINE = re.compile(
    r"""\[\[evidence\]\]|\w+\s*=\s*(?:"(?:[^"\\]|\\.)*"|'[^']*'|[+-]?\d+|\[\s*\])\s*(?:\#.*)?|\#.*|""", re.ASCII
)
_SHAPE = re.compile(r"\A\+\+\+\n(.*?\n)\+\+\+(?:\n|\Z)", re.DOTALL)


def read_note(text: str) -> Note:
    """Parse the text of a note's file.

    Raises:
        NoteError: It holds no note, or an invalid one; the message names the field.
    """
    if len(text) > LONGEST_FILE:
        raise NoteError(f"it has {len(text)} characters; a note has at most {LONGEST_FILE}")
    found = _SHAPE.match(text.replace("\r\n", "\n"))
    if found is None:
        raise NoteError(f"it does not begin with a front part between two lines of {_FENCE}")
    for number, line in enumerate(found[1].split("\n"), start=2):
        if _LINE.fullmatch(line.strip()) is None:
            expected = "a name, = and a text in quotes or a whole number; or [[evidence]]"
            raise NoteError(f"its front part is no TOML of a note: line {number}: expected {expected}")
    try:
        front = tomllib.loads(found[1])
        if (form := front.pop("format", None)) != SCHEMA:
            raise NoteError(f"format: it is {form!r:.60}, and this reads {SCHEMA}")
        return Note.model_validate(front)
    except tomllib.TOMLDecodeError as problem:
        raise NoteError(f"its front part is no TOML: {problem}") from None
    except ValidationError as problem:
        raise NoteError(first_mistake(problem, Note)) from None
    except ValueError as problem:  # A number of thousands of digits.
        raise NoteError(f"its front part cannot be read: {problem}") from None


def note_text(note: Note) -> str:
    """Return a note as the text of its file; `read_note` reads it back."""
    front = {
        "format": SCHEMA,
        "cause": note.cause,
        "primitive": note.primitive.name,
        "kind": note.kind,
        "target": note.target,
        "support": note.support,
        "before": json.dumps(flow_to_json(note.before)),
        "after": json.dumps(flow_to_json(note.after)),
        "lesson": note.lesson,
    }
    lines = [_FENCE, *(f"{key} = {_quoted(value)}" for key, value in front.items())]
    if not note.evidence:
        lines.append("evidence = []")
    for entry in note.evidence:
        row = {"task": _quoted(entry.task), "seed": entry.seed, "outcome": _quoted(entry.outcome)}
        row["revisions"] = entry.revisions
        lines += ["", "[[evidence]]", *(f"{key} = {value}" for key, value in row.items() if value is not None)]
    place = f" ({note.support})" if note.support else ""
    lines += [
        _FENCE,
        "",
        f"# {note.kind} {note.target}{place}: {note.cause}",
        "",
        note.lesson,
        "",
        f"- failed: `{front['before']}`",
        f"- works: `{front['after']}`, in {note.successes} of {len(note.evidence)} runs",
    ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


ENOUGH = 5.0
"""Least score of a recalled note, such as that of the same cause at the same primitive."""

HOPELESS = 0.34
"""A note is not recalled once its rate is below this because it failed when tried."""

# The cause counts most: a correction of another cause would waste an attempt.
_CAUSE, _PRIMITIVE, _KIND, _TARGET, _TYPE, _SUPPORT = 3.0, 2.0, 2.0, 2.0, 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Circumstances:
    """Features by which a failure is compared; empty or None if unknown."""

    cause: str
    primitive: Primitive | None
    kind: Kind
    target: str
    support: str = ""


@dataclass(frozen=True, slots=True)
class Recalled:
    """A note that resembles a failure."""

    note: Note
    score: float
    why: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.note.name}: {self.score:g} points ({', '.join(self.why)}), helped {self.note.rate:.0%}"


def circumstances(task: Task, subtask: int, scene: Scene, attempt: Attempt) -> Circumstances:
    """Return the features of a failed attempt, from its critiques and its subtask."""
    cause = diagnose(attempt)
    kind, target, support = about(task, subtask, scene)
    return Circumstances(
        cause="" if cause is None else cause.kind.value,
        primitive=None if cause is None else attempt.flow[cause.step].primitive,
        kind=kind,
        target=target,
        support=support,
    )


def about(task: Task, subtask: int, scene: Scene) -> tuple[Kind, str, str]:
    """Return the kind of a subtask, and the categories of its target and of its support."""
    roles = task.subtasks[subtask]
    place = roles.support_goal or roles.support_init
    known = scene.objects
    return (
        _kind(roles.goal),
        known[roles.target].category if roles.target in known else roles.target,
        known[place].category if place is not None and place in known else "",
    )


def recall(notes: Iterable[Note], of: Circumstances, most: int = 5) -> tuple[Recalled, ...]:
    """Return the notes with enough points, the most similar first; ties by success."""
    # A correction of another cause would waste an attempt, however similar the rest is.
    related = [note for note in notes if note.rate >= HOPELESS and (not of.cause or _alike(note.cause, of.cause) > 0)]
    enough = [one for one in (_compared(note, of) for note in related) if one.score >= ENOUGH]
    enough.sort(key=lambda one: (-one.score, -one.note.rate, -one.note.successes, one.note.name))
    return tuple(enough[:most])


def _compared(note: Note, of: Circumstances) -> Recalled:
    points: list[tuple[float, str]] = []
    alike = _alike(note.cause, of.cause)
    if alike > 0:
        points.append((round(_CAUSE * alike, 2), "cause" if alike == 1 else "words of the cause"))
    if note.primitive is of.primitive:
        points.append((_PRIMITIVE, note.primitive.name))
    if note.kind == of.kind:
        points.append((_KIND, f"to {note.kind}"))
    if note.target == of.target:
        points.append((_TARGET, note.target))
    elif kind_of(note.target, 0.0) is kind_of(of.target, 0.0):
        points.append((_TYPE, "targets of one type"))
    if note.support and note.support == of.support:
        points.append((_SUPPORT, note.support))
    return Recalled(note, sum(value for value, _ in points), tuple(f"{words} {value:g}" for value, words in points))


def _alike(one: str, other: str) -> float:
    """Return the similarity of two causes, 0 to 1: measured ones are equal or not, others share words."""
    if one in _MEASURED and other in _MEASURED:
        return float(one == other)
    first, second = (set(re.findall(r"[a-z]+", text.lower())) - _SMALL for text in (one, other))
    return len(first & second) / len(first | second) if first | second else 0.0


_MEASURED = frozenset(kind.value for kind in CauseKind)
_SMALL = frozenset({"the", "a", "an", "is", "was", "in", "of", "to", "it", "its", "not", "no"})


def _kind(goal: bddl.Formula) -> Kind:
    for literal in bddl.literals(goal) or ():
        if literal.atom.predicate == "open":
            return "open" if literal.value else "close"
        if literal.atom.predicate in ("inside", "ontop"):
            return "place" if literal.value else "pick"
    return "other"
