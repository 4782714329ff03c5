"""What a self-evolution leaves behind: every attempt at every subtask, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, replace

from executor.records import Rollout, SubtaskRecord
from llm.evolution import GiveUp
from oag import History, Task


@dataclass(frozen=True, slots=True)
class SubtaskStory:
    """One subtask's evolution.

    Attributes:
        history: Attempts with their critiques, and the revisions between them.
        records: What each attempt left behind, in the same order.
        gave_up: Why there was no further revision; None when the last attempt succeeded.
    """

    history: History
    records: tuple[SubtaskRecord, ...]
    gave_up: GiveUp | None = None

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal."""
        return self.history.solved

    @property
    def revisions(self) -> int:
        """How often the flow was revised."""
        return len(self.history.revisions)


@dataclass(frozen=True, slots=True)
class Evolution:
    """One episode with self-evolution.

    Attributes:
        original: The task before anything was revised.
        rollout: The episode as it counts in the end: the last attempt of every subtask, its task with the revised
            flows. A plain rollout of that task with the same scene and seed gives the same states.
        stories: One for each subtask that was begun.
    """

    original: Task
    rollout: Rollout
    stories: tuple[SubtaskStory, ...]

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
