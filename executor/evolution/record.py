"""The record of a self-evolution: every attempt at every subtask, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bddl.visible import counted
from executor.records.rollout import Rollout, SubtaskRecord
from executor.world.faults import Fault
from llm.evolution import AttemptSeen, GiveUp
from oag import History, Task


@dataclass(frozen=True, slots=True)
class SubtaskStory:
    """One subtask's evolution.

    Attributes:
        history: Attempts with their critiques, and the revisions between them.
        records: What each attempt left behind, in the same order.
        gave_up: Why there was no further revision; None when the last attempt succeeded.
        sights: What was seen of each attempt, in the same order, with pictures where they can be drawn.
    """

    history: History
    records: tuple[SubtaskRecord, ...]
    gave_up: GiveUp | None = None
    sights: tuple[AttemptSeen, ...] = ()

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal, and nothing before it was changed since then."""
        return self.history.solved and self.history.iterations[-1].revision is None

    @property
    def revisions(self) -> int:
        """How often the subtask's flow was revised."""
        return len(self.history.revisions)


@dataclass(frozen=True, slots=True)
class Evolution:
    """One episode with self-evolution.

    Attributes:
        original: The task before anything was revised.
        rollout: The episode as it counts in the end: the last attempt of every subtask, its task with the revised
            flows. A plain rollout of that task with the same scene and seed gives the same states.
        stories: One for each subtask that was begun.
        faults: What was wrong on purpose.
    """

    original: Task
    rollout: Rollout
    stories: tuple[SubtaskStory, ...]
    faults: tuple[Fault, ...] = ()

    def __repr__(self) -> str:
        return f"<Evolution of {self.rollout!r}: {counted(self.revisions, 'revision')}>"

    @property
    def succeeded(self) -> bool:
        """True when every subtask and the task goal were reached in the end."""
        return self.rollout.succeeded

    @property
    def succeeded_at_once(self) -> bool:
        """True when they were reached without any revision."""
        return self.succeeded and self.revisions == 0

    @property
    def revisions(self) -> int:
        """How many revisions were made, over all subtasks."""
        return sum(story.revisions for story in self.stories)

    @property
    def evolved(self) -> Task:
        """The task with the flows that were run last, open numbers left open."""
        flows = {story.history.subtask: story.history.iterations[-1].attempt.flow for story in self.stories}
        subtasks = tuple(
            replace(subtask, flow=flows.get(index, subtask.flow))
            for index, subtask in enumerate(self.original.subtasks)
        )
        return replace(self.original, subtasks=subtasks)


class EvolutionInterrupted(KeyboardInterrupt):
    """Ctrl-C during an evolution; `partial` is what had been done."""

    def __init__(self, partial: Evolution) -> None:
        super().__init__("the evolution was interrupted")
        self.partial = partial
