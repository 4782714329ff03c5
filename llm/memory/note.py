"""A note of one correction: what failed, where, what changed it into a success, and how often that was so.

Kept as Markdown with a front part in TOML between lines of `+++`, which is checked strictly when it is read; only the
front part counts, the text below it is for people.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from llm.errors import LlmError
from oag import ActionFlow, FlowError, Primitive, flow_from_json, flow_to_json
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


@dataclass(frozen=True, slots=True)
class Trial:
    """One time that a correction was run.

    Attributes:
        task: The task's name.
        seed: The episode's seed; None when it had none.
        outcome: Whether the subtask's goal was reached with it.
        revisions: How many revisions the subtask had until then.
    """

    task: str
    seed: int | None
    outcome: Outcome
    revisions: int = 1


@dataclass(frozen=True, slots=True)
class Note:
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

    cause: str
    primitive: Primitive
    kind: Kind
    target: str
    support: str
    before: ActionFlow
    after: ActionFlow
    lesson: str = ""
    evidence: tuple[Trial, ...] = ()

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


LONGEST_FILE = 150_000
"""A note with as much evidence and as long words as are legal has fewer characters."""
_FENCE = "+++"
_LONGEST_FLOW = 4_000
# What notes are made of. TOML has more, such as dotted keys: 40 kB of them become gigabytes before they are refused.
_LINE = re.compile(
    r"""\[\[evidence\]\]|\w+\s*=\s*(?:"(?:[^"\\]|\\.)*"|'[^']*'|[+-]?\d+|\[\s*\])\s*(?:\#.*)?|\#.*|""", re.ASCII
)
_SHAPE = re.compile(r"\A\+\+\+\n(.*?\n)\+\+\+(?:\n|\Z)", re.DOTALL)


class NoteError(LlmError):
    """A file is no note; the message says what is wrong with it."""


def _printable(text: str) -> str:
    for sign in text:
        if unicodedata.category(sign) in ("Cc", "Cf", "Cs"):
            code = {"code": f"U+{ord(sign):04X}"}
            raise PydanticCustomError("control_character", "the text has the control character {code}", code)
    return text


def _primitive(name: str) -> str:
    if name not in Primitive.__members__:
        raise PydanticCustomError("primitive", "there is no primitive {name}", {"name": name[:60]})
    return name


def _flow(text: str) -> str:
    _read_flow(text)
    return text


def _read_flow(text: str) -> ActionFlow:
    try:
        flow = flow_from_json(STRICT.decode(text))
    except (FlowError, ValueError, RecursionError) as problem:
        raise PydanticCustomError("flow", "no action flow: {said}", {"said": str(problem)[:200]}) from None
    if not 1 <= len(flow) <= MOST_STEPS:
        raise PydanticCustomError("flow", "a flow has 1 to {most} steps", {"most": MOST_STEPS})
    return flow


_Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(_printable)]
_FlowText = Annotated[str, Field(max_length=_LONGEST_FLOW), AfterValidator(_flow)]


class _Front(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _TrialEntry(_Front):
    task: _Line
    seed: int | None = Field(default=None, ge=0)
    outcome: Outcome
    revisions: int = Field(ge=0, le=1_000)


class _NoteFront(_Front):
    format: Literal["scene2demo-skill/1"]
    cause: _Line
    primitive: Annotated[str, AfterValidator(_primitive)]
    kind: Kind
    target: _Line
    support: Annotated[str, Field(max_length=120), AfterValidator(_printable)]
    before: _FlowText
    after: _FlowText
    lesson: Annotated[str, Field(max_length=LONGEST_LESSON), AfterValidator(_printable)]
    evidence: list[_TrialEntry] = Field(max_length=MOST_EVIDENCE)


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
        front = _NoteFront.model_validate(tomllib.loads(found[1]))
    except tomllib.TOMLDecodeError as problem:
        raise NoteError(f"its front part is no TOML: {problem}") from None
    except RecursionError:
        raise NoteError("its front part is nested too deeply") from None
    except ValidationError as problem:
        first = problem.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise NoteError(f"{place}: {first['msg']}") from None
    except ValueError as problem:  # A number of thousands of digits.
        raise NoteError(f"its front part cannot be read: {problem}") from None
    return Note(
        cause=front.cause,
        primitive=Primitive[front.primitive],
        kind=front.kind,
        target=front.target,
        support=front.support,
        before=_read_flow(front.before),
        after=_read_flow(front.after),
        lesson=front.lesson,
        evidence=tuple(Trial(e.task, e.seed, e.outcome, e.revisions) for e in front.evidence),
    )


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
        lines += ["", "[[evidence]]", *(f"{key} = {_value(value)}" for key, value in _told(entry).items())]
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


def _told(entry: Trial) -> Mapping[str, object]:
    seed = {} if entry.seed is None else {"seed": entry.seed}
    return {"task": entry.task, **seed, "outcome": entry.outcome, "revisions": entry.revisions}


def _value(value: object) -> str:
    return _quoted(value) if isinstance(value, str) else str(value)


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
