"""Records of a self-evolution: what an inspector saw, what was tried, and what was changed and why.

Plain data with a JSON form, written by whoever runs the loop and read by supervisors, reports and training sets; its
fields are what `History.from_json` reads by.

Source: the paper's Self-Evolution: critiques m_(tau, j), the revised flow with its explanation r_(tau+1).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

from oag.model.actions import ActionFlow, flow_from_json
from oag.model.jsonfile import ReadBy, expected, index, shown
from oag.model.primitives import Primitive
from oag.revision.grounds import Grounds

Outcome = Literal["succeeded", "failed"]
Change = Literal["sequence", "parameters"]
Origin = Literal["measurements", "model", "both"]
BLAMED_LATER = "blamed-later"
"""The failure of an attempt whose subtask was reached, but because of which a later one failed."""


def _flag(value: object) -> bool | None:
    if value is None or isinstance(value, bool):
        return value
    raise ValueError(expected("true, false or null", value))


def _primitive(value: object) -> Primitive:
    found = Primitive.__members__.get(value) if isinstance(value, str) else None
    if found is None:
        raise ValueError(f"there is no primitive {shown(value)}")
    return found


_Flag = Annotated[bool | None, ReadBy(_flag)]
_Flow = Annotated[ActionFlow, ReadBy(flow_from_json)]
_Index = Annotated[int, ReadBy(index)]


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

    step: _Index
    primitive: Annotated[Primitive, ReadBy(_primitive)]
    motion_verified: _Flag = None
    state_reached: _Flag = None
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


@dataclass(frozen=True, slots=True)
class Hindsight:
    """Why an attempt that reached its goal counts as failed after all: a later subtask failed because of it.

    Attributes:
        subtask: Index of the later subtask, from 0.
        failure: Kind of its failure, such as "slipped".
        message: That failure in a sentence.
    """

    subtask: _Index
    failure: str
    message: str = ""

    def to_json(self) -> dict[str, object]:
        """Returns the hindsight as JSON values."""
        return _written(self)


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

    flow: _Flow
    outcome: Outcome
    failed_step: _Index | None = None
    failure: str = ""
    message: str = ""
    critiques: tuple[Critique, ...] = ()
    filled: _Flow | None = None
    seed: _Index | None = None
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

    flow: _Flow
    change: Change
    explanation: str
    cause: str = ""
    cause_step: _Index | None = None
    origin: Origin = "measurements"
    subtask: _Index | None = None
    refused: tuple[str, ...] = ()
    note: str = ""

    def to_json(self) -> dict[str, object]:
        """Returns the revision as JSON values, the note only where there is one."""
        written = _written(self)
        return ({"note": self.note} if self.note else {}) | {
            key: value for key, value in written.items() if key != "note"
        }


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
