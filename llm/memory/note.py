"""A note of one correction: what failed, where, what changed it into a success, and how often that was so.

Kept as Markdown with a front part in TOML between lines of `+++`, which is checked strictly when it is read; only the
front part counts, the text below it is for people.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainValidator, ValidationError
from pydantic_core import PydanticCustomError

from llm.answers.base import without_control
from llm.errors import LlmError
from oag import ActionFlow, FlowError, Primitive, flow_from_json, flow_to_json
from oag.model.forms import first_mistake
from oag.model.jsonfile import STRICT
from oag.revision.admission import MOST_STEPS

SCHEMA = "scene2demo-skill/1"
MOST_EVIDENCE = 200
LONGEST_LESSON = 600
PROVEN = 2
"""In how many episodes a correction has to have helped before it is tried ahead of what measurements call for."""
Kind = Literal["open", "close", "pick", "place", "other"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Outcome = Literal["succeeded", "failed"]
_NAME_WORDS = 6
_LONGEST_FLOW = 4_000
LONGEST_FILE = 150_000
"""A note with as much evidence and as long words as are legal has fewer characters."""
_FENCE = "+++"


class NoteError(LlmError):
    """A file is no note; the message says what is wrong with it."""


def _primitive(value: object) -> Primitive:
    if isinstance(value, Primitive):
        return value
    if not isinstance(value, str) or value not in Primitive.__members__:
        raise PydanticCustomError("primitive", "there is no primitive {name}", {"name": str(value)[:60]})
    return Primitive[value]


def _flow(value: object) -> ActionFlow:
    """Returns the flow that a text holds; one that is read already as it is."""
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
    """One time that a correction was run.

    Attributes:
        task: The task's name.
        seed: The episode's seed; None when it had none.
        outcome: Whether the subtask's goal was reached with it.
        revisions: How many revisions the subtask had until then.
    """

    task: _Line
    seed: int | None = Field(default=None, ge=0)
    outcome: Outcome
    revisions: int = Field(ge=0, le=1_000)


class Note(_Front):
    """One correction.

    Attributes:
        cause: Root cause in a few words, as the search over measurements names it, or as a model did.
        primitive: What was done at the step that it lies in.
        kind: What the subtask was about.
        target: Category of its target.
        support: Category of where the target was taken from or put; empty for none.
        before: The flow that failed.
        after: The flow that succeeded.
        lesson: Why it was changed so, in a few sentences.
        evidence: When it was run.
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
        """What it is called, and its file: words of the cause, and a digest of everything but lesson and evidence."""
        words = re.findall(r"[a-z0-9]+", f"{self.kind} {self.target} {self.cause}".lower().replace("_", " "))
        flows = [flow_to_json(self.before), flow_to_json(self.after)]
        key = json.dumps([self.cause, self.primitive.name, self.kind, self.target, self.support, *flows])
        digest = hashlib.sha256(key.encode()).hexdigest()[:8]
        return "-".join((*(word[:20] for word in words[:_NAME_WORDS]), digest))

    @property
    def successes(self) -> int:
        """How often it helped."""
        return sum(entry.outcome == "succeeded" for entry in self.evidence)

    @property
    def proven(self) -> bool:
        """Whether it helped in more than one episode: an offset that a single one had is no skill."""
        return self.successes >= PROVEN

    @property
    def rate(self) -> float:
        """How often it helped, of how often it was run, with one of each added, so that one case is not certainty."""
        return (self.successes + 1) / (len(self.evidence) + 2)

    def line(self) -> str:
        """Returns the note on one line, for a model."""
        place = f", {self.support}" if self.support else ""
        return (
            f"{self.kind} {self.target}{place}: at {self.primitive.name}, {self.cause}. "
            f"{json.dumps(flow_to_json(self.before))} failed, {json.dumps(flow_to_json(self.after))} "
            f"worked in {self.successes} of {len(self.evidence)} runs. {self.lesson}"
        )


# What notes are made of. TOML has more, such as dotted keys: 40 kB of them become gigabytes before they are refused.
_LINE = re.compile(
    r"""\[\[evidence\]\]|\w+\s*=\s*(?:"(?:[^"\\]|\\.)*"|'[^']*'|[+-]?\d+|\[\s*\])\s*(?:\#.*)?|\#.*|""", re.ASCII
)
_SHAPE = re.compile(r"\A\+\+\+\n(.*?\n)\+\+\+(?:\n|\Z)", re.DOTALL)


def read_note(text: str) -> Note:
    """Returns the note that a file's text holds.

    Raises:
        NoteError: It holds none, or one that is wrong; the message names the field.
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
    """Returns a note as the text of its file; `read_note` reads it back."""
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
        told = {"task": _quoted(entry.task), "seed": entry.seed, "outcome": _quoted(entry.outcome)}
        told["revisions"] = entry.revisions
        lines += ["", "[[evidence]]", *(f"{key} = {value}" for key, value in told.items() if value is not None)]
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
