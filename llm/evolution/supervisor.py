"""Whoever revises the flow of a failed subtask, and what it is told and answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from llm.evolution.observation import AttemptSeen
from oag import Attempt, History, Revision, Scene, Task


@dataclass(frozen=True, slots=True)
class Situation:
    """What a supervisor is told of a failed attempt.

    Attributes:
        task: The task with the flow that failed.
        subtask: Index of the failed subtask, from 0.
        scene: Where it was run.
        attempt: The failed attempt with the critiques of its steps.
        history: What was tried for this subtask before.
        objections: Why the answers given so far to this very question may not run, numbered and readable.
        earlier: Histories of the subtasks before, in order. The last attempt of each is the one that stands; it was
            judged as well, so that what it left behind, such as how an item was taken, can be looked up.
        seen: The failed attempt as it was seen, for one who looks at its pictures; None where there are none.
    """

    task: Task
    subtask: int
    scene: Scene
    attempt: Attempt
    history: History
    objections: tuple[str, ...] = ()
    earlier: tuple[History, ...] = ()
    seen: AttemptSeen | None = None


@dataclass(frozen=True, slots=True)
class GiveUp:
    """No revision.

    Attributes:
        reason: Why, in a sentence or two for a person.
        cause: The root cause in a few words; empty when it was not found.
        needed: What it would take, where it is evident that no flow of the library helps; empty otherwise.
        refused: What was answered before and may not run, with the reason, each in words.
    """

    reason: str
    cause: str = ""
    needed: str = ""
    refused: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Returns the answer as JSON values."""
        return {"reason": self.reason, "cause": self.cause, "needed": self.needed, "refused": list(self.refused)}


@runtime_checkable
class Supervisor(Protocol):
    """Revises flows.

    Source: the paper's Robotic Task Supervisor: root cause at the earliest failed step, revision of the sequence or of
    its parameters, nothing but the library's primitives.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns the revised flow, or why there is none.

        Where the cause lies in an earlier subtask, the revision is of that one's flow and has its index in `subtask`;
        the loop goes back to that subtask's start, runs the revised flow, and goes forward again. It counts as one of
        that subtask's revisions.
        """
        ...
