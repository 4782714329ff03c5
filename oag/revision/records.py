"""Records of a self-evolution: what an inspector saw, what was tried, and what was changed and why.

Plain data with a JSON form, written by whoever runs the loop and read by supervisors, reports and training sets.

Source: the paper's Self-Evolution: critiques m_(tau, j), the revised flow with its explanation r_(tau+1).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Literal, Self, TypeVar, get_args

from oag.model.actions import ActionFlow, flow_from_json
from oag.model.errors import FlowError
from oag.model.jsonfile import JsonNode
from oag.model.primitives import Primitive
from oag.revision.grounds import Grounds

Outcome = Literal["succeeded", "failed"]
Change = Literal["sequence", "parameters"]
Origin = Literal["measurements", "model", "both"]
BLAMED_LATER = "blamed-later"
"""The failure of an attempt whose subtask was reached, but because of which a later one failed."""
_Word = TypeVar("_Word", bound=str)


@dataclass(frozen=True, slots=True)
class Critique:
    """What an inspector says of one executed step.

    Attributes:
        step: Index in the flow, from 0.
        primitive: What was done.
        motion_verified: Whether the robot moved as the primitive means; None when that was not judged.
        state_reached: Whether the intended change came about; None when that was not judged.
        state_contrast: What differs between the step's beginning and its end, in words.
        anomaly: What happened that should not have, such as a collision; None when nothing did.
        text: The diagnosis in a sentence or two.
        evidence: What it rests on.
        origin: Whether measurements, a model that looked at frames, or both were asked.

    Source: the paper's three aspects of a critique: motion verification, state contrast, anomaly detection.
    """

    step: int
    primitive: Primitive
    motion_verified: bool | None = None
    state_reached: bool | None = None
    state_contrast: str = ""
    anomaly: str | None = None
    text: str = ""
    evidence: Grounds = field(default_factory=Grounds)
    origin: Origin = "measurements"

    @property
    def finds_fault(self) -> bool:
        """True when anything about the step was wrong."""
        return self.motion_verified is False or self.state_reached is False or self.anomaly is not None

    def to_json(self) -> dict[str, object]:
        """Returns the critique as JSON values."""
        return _written(self)

    @classmethod
    def read(cls, node: JsonNode) -> Self:
        """Returns the critique that a JSON value describes."""
        name = node.require("primitive").string()
        if name not in Primitive.__members__:
            raise node.require("primitive").fail(f"there is no primitive {name!r}")
        return cls(
            step=_index(node.require("step")),
            primitive=Primitive[name],
            motion_verified=_flag(node, "motion_verified"),
            state_reached=_flag(node, "state_reached"),
            state_contrast=node.text("state_contrast", ""),
            anomaly=node.text("anomaly"),
            text=node.text("text", ""),
            evidence=Grounds.read(node.optional("evidence", {})),
            origin=_word(node, "origin", get_args(Origin), "measurements"),
        )


@dataclass(frozen=True, slots=True)
class Hindsight:
    """Why an attempt that reached its goal counts as failed after all: a later subtask failed because of it.

    Attributes:
        subtask: Index of the later subtask, from 0.
        failure: Kind of its failure, such as "slipped".
        message: That failure in a sentence.
    """

    subtask: int
    failure: str
    message: str = ""

    def to_json(self) -> dict[str, object]:
        """Returns the hindsight as JSON values."""
        return _written(self)

    @classmethod
    def read(cls, node: JsonNode) -> Self:
        """Returns what a JSON value describes."""
        return cls(_index(node.require("subtask")), node.require("failure").string(), node.text("message", ""))


@dataclass(frozen=True, slots=True)
class Attempt:
    """One execution of a subtask's flow from its saved initial state.

    Attributes:
        flow: The flow as it was asked for, open numbers left open.
        outcome: Whether the subtask's goal was reached.
        failed_step: Index of the earliest step that failed; None when it succeeded, or when every step ran and the
            goal was not reached all the same.
        failure: Kind of failure, such as "unexpected-contact"; empty on success.
        message: The failure in a sentence.
        critiques: One for each step that was judged, in order.
        filled: The flow with the numbers that were run; None when they were all given.
        seed: Seed of the episode; None when it has none.
        state_hash: Hash of the states it went through; empty when there is none.
        start: Hash of the states that led to its initial state; attempts of one subtask differ in it when an earlier
            subtask was revised between them.
        hindsight: Which later failure it was blamed for; the outcome is then "failed", the failure "blamed-later".
            None when it was blamed for none.
    """

    flow: ActionFlow
    outcome: Outcome
    failed_step: int | None = None
    failure: str = ""
    message: str = ""
    critiques: tuple[Critique, ...] = ()
    filled: ActionFlow | None = None
    seed: int | None = None
    state_hash: str = ""
    start: str = ""
    hindsight: Hindsight | None = None

    @property
    def succeeded(self) -> bool:
        """True when the subtask's goal was reached."""
        return self.outcome == "succeeded"

    def to_json(self) -> dict[str, object]:
        """Returns the attempt as JSON values."""
        return _written(self)

    @classmethod
    def read(cls, node: JsonNode) -> Self:
        """Returns the attempt that a JSON value describes."""
        filled, hindsight = node.get("filled"), node.get("hindsight")
        return cls(
            flow=_flow(node.require("flow")),
            outcome=_word(node, "outcome", get_args(Outcome)),
            failed_step=_optional_index(node, "failed_step"),
            failure=node.text("failure", ""),
            message=node.text("message", ""),
            critiques=tuple(map(Critique.read, node.optional("critiques", []).elements())),
            filled=None if filled is None else _flow(filled),
            seed=_optional_index(node, "seed"),
            state_hash=node.text("state_hash", ""),
            start=node.text("start", ""),
            hindsight=None if hindsight is None else Hindsight.read(hindsight),
        )


@dataclass(frozen=True, slots=True)
class Revision:
    """A changed flow, and why it was changed.

    Attributes:
        flow: The new flow.
        change: "sequence" when primitives were added, taken out or exchanged, "parameters" when only numbers differ.
        explanation: The supervisor's reason, for people and for the next round.
        cause: The root cause in a few words, such as "door in the way".
        cause_step: Index of the step of the old flow that it lies in; None when it lies in none.
        origin: Whether a search over measurements, a model, or both made it.
        subtask: Index of the subtask whose flow this is, when the cause lies in an earlier subtask than the one that
            failed; `cause_step` is a step of that subtask then. None: the one that failed.
        refused: What was answered before and may not run, with the reason, each in words; nothing of it ever moved.
        note: Name of the note of a memory that it was taken from; empty for none.
    """

    flow: ActionFlow
    change: Change
    explanation: str
    cause: str = ""
    cause_step: int | None = None
    origin: Origin = "measurements"
    subtask: int | None = None
    refused: tuple[str, ...] = ()
    note: str = ""

    def to_json(self) -> dict[str, object]:
        """Returns the revision as JSON values, the note only where there is one."""
        written = _written(self)
        return ({"note": self.note} if self.note else {}) | {
            key: value for key, value in written.items() if key != "note"
        }

    @classmethod
    def read(cls, node: JsonNode) -> Self:
        """Returns the revision that a JSON value describes."""
        return cls(
            flow=_flow(node.require("flow")),
            change=_word(node, "change", get_args(Change)),
            explanation=node.text("explanation", ""),
            cause=node.text("cause", ""),
            cause_step=_optional_index(node, "cause_step"),
            origin=_word(node, "origin", get_args(Origin), "measurements"),
            subtask=_optional_index(node, "subtask"),
            refused=tuple(text.string() for text in node.optional("refused", []).elements()),
            note=node.text("note", ""),
        )


def change_between(old: ActionFlow, new: ActionFlow) -> Change:
    """Returns how one flow became another: "parameters" when the primitives are the same ones, else "sequence"."""
    same = [action.primitive for action in old] == [action.primitive for action in new]
    return "parameters" if same else "sequence"


def _written(record: Critique | Hindsight | Attempt | Revision) -> dict[str, object]:
    return {entry.name: _plain(getattr(record, entry.name)) for entry in fields(record)}


def _plain(value: Any) -> object:
    if isinstance(value, Primitive):
        return value.name
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value.to_json() if hasattr(value, "to_json") else value


def _flow(node: JsonNode) -> ActionFlow:
    try:
        return flow_from_json(list(node.value) if isinstance(node.value, tuple) else node.value)
    except FlowError as problem:
        raise node.fail(str(problem)) from problem


def _index(node: JsonNode) -> int:
    number = node.number()
    if number < 0 or number != int(number):
        raise node.fail(f"expected a whole number from 0 up, got {number:g}")
    return int(number)


def _optional_index(node: JsonNode, key: str) -> int | None:
    found = node.get(key)
    return None if found is None else _index(found)


def _flag(node: JsonNode, key: str) -> bool | None:
    found = node.get(key)
    if found is None or isinstance(found.value, bool):
        return None if found is None else bool(found.value)
    raise found.fail(f"expected true, false or null, got {found.value!r}")


def _word(node: JsonNode, key: str, words: tuple[_Word, ...], default: _Word | None = None) -> _Word:
    if default is not None and node.get(key) is None:
        return default
    given = node.require(key).string()
    for word in words:
        if word == given:
            return word
    raise node.require(key).fail(f"expected {' or '.join(map(repr, words))}, got {given!r}")
