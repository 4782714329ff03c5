"""The history of one subtask's self-evolution: attempts and the revisions between them, to which can only be added.

Source: the paper's evolution history H_(<tau) = {(flow_i, critiques_i, reason_(i+1))}.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

from oag.errors import HistoryFull, RecordError
from oag.evolution.records import Attempt, Revision
from oag.jsonfile import Source, load

SCHEMA = "scene2demo-history/1"
# Source: the paper's limit on iterations.
MOST_REVISIONS = 5


class Iteration(NamedTuple):
    """One attempt, and the revision that was made because of it; None after the last."""

    attempt: Attempt
    revision: Revision | None


@dataclass(frozen=True, slots=True)
class History:
    """What was tried for one subtask so far.

    Attributes:
        subtask: Index of the subtask, from 0.
        iterations: In order; only the last may lack a revision.
        limit: How many revisions may be made.
    """

    subtask: int
    iterations: tuple[Iteration, ...] = ()
    limit: int = MOST_REVISIONS

    @property
    def failures(self) -> tuple[Attempt, ...]:
        """The attempts that failed, in order."""
        return tuple(attempt for attempt, _ in self.iterations if not attempt.succeeded)

    @property
    def revisions(self) -> tuple[Revision, ...]:
        """The revisions, in order."""
        return tuple(revision for _, revision in self.iterations if revision is not None)

    @property
    def exhausted(self) -> bool:
        """True when no further revision may be made."""
        return len(self.revisions) >= self.limit

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal."""
        return bool(self.iterations) and self.iterations[-1].attempt.succeeded

    def add(self, attempt: Attempt, revision: Revision | None = None) -> Self:
        """Returns the history with one more attempt, and the revision made because of it.

        Raises:
            HistoryFull: The evolution has ended already, or the revision would be one too many.
        """
        if self.iterations and self.iterations[-1].revision is None:
            raise HistoryFull(
                f"the evolution of subtask {self.subtask + 1} ended with attempt {len(self.iterations)}: "
                "nothing was revised after it, so there is nothing more to try"
            )
        if revision is not None and self.exhausted:
            raise HistoryFull(f"subtask {self.subtask + 1} was revised {self.limit} times, and that is the limit")
        return replace(self, iterations=(*self.iterations, Iteration(attempt, revision)))

    def to_json(self) -> dict[str, object]:
        """Returns the mapping that `from_json` reads back into an equal history."""
        return {
            "schema": SCHEMA,
            "subtask": self.subtask,
            "limit": self.limit,
            "iterations": [
                {"attempt": attempt.to_json(), "revision": None if revision is None else revision.to_json()}
                for attempt, revision in self.iterations
            ],
        }

    @classmethod
    def from_json(cls, source: Source | Mapping[str, object]) -> Self:
        """Returns the history that a JSON file, or a mapping of the same form, describes.

        Raises:
            RecordError: The one first thing that is malformed, with its place and what was expected.
        """
        root = load(source, RecordError)
        schema = root.require("schema").string()
        if schema != SCHEMA:
            raise root.require("schema").fail(f"expected {SCHEMA!r}, got {schema!r}")
        history = cls(int(root.require("subtask").number()), (), int(root.require("limit").number()))
        for node in root.require("iterations").elements():
            revision = node.get("revision")
            try:
                history = history.add(
                    Attempt.read(node.require("attempt")), None if revision is None else Revision.read(revision)
                )
            except HistoryFull as problem:
                raise node.fail(str(problem)) from problem
        return history
