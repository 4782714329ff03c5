"""The history of one subtask's self-evolution: attempts and the revisions between them, to which can only be added.

Source: the paper's evolution history H_(<tau) = {(flow_i, critiques_i, reason_(i+1))}.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, Self

from bddl.visible import counted
from oag.model.errors import HistoryFull, RecordError
from oag.model.jsonfile import ReadBy, Source, index, load
from oag.revision.records import BLAMED_LATER, Attempt, Hindsight, Revision

SCHEMA = "scene2demo-history/2"
# Source: the paper's limit on iterations.
MOST_REVISIONS = 5


class Iteration(NamedTuple):
    """One attempt, and the revision that was made because of it; None after the last.

    A revision whose `subtask` is an earlier one changed that subtask's flow; the next attempt starts from elsewhere.
    """

    attempt: Attempt
    revision: Revision | None = None


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
        """The revisions of this subtask's own flow, in order."""
        return tuple(r for _, r in self.iterations if r is not None and self._is_own(r))

    @property
    def exhausted(self) -> bool:
        """True when no further revision may be made."""
        return len(self.revisions) >= self.limit

    @property
    def limit_reached(self) -> str:
        """The words for a history that is exhausted."""
        return f"{counted(self.limit, 'revision')} {'was' if self.limit == 1 else 'were'} tried, and that is the limit"

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal."""
        return bool(self.iterations) and self.iterations[-1].attempt.succeeded

    def add(self, attempt: Attempt, revision: Revision | None = None) -> Self:
        """Returns the history with one more attempt, and the revision made because of it.

        Raises:
            HistoryFull: The evolution has ended already, or the revision would be one too many.
        """
        which = f"subtask {self.subtask + 1}"
        if self.iterations and self.iterations[-1].revision is None:
            ended = f"the evolution of {which} ended with attempt {len(self.iterations)}"
            raise HistoryFull(f"{ended}: nothing was revised after it, so there is nothing more to try")
        if revision is not None and self.exhausted and self._is_own(revision):
            raise HistoryFull(f"{which} was revised {counted(self.limit, 'time')}, and that is the limit")
        return replace(self, iterations=(*self.iterations, Iteration(attempt, revision)))

    def reopened(self, hindsight: Hindsight) -> tuple[Attempt, Self]:
        """Returns the last attempt, which succeeded, as one that failed after all, and the history before it.

        Adding the attempt again, with the revision that is made because of it, goes on with the evolution.

        Raises:
            RecordError: There is no success that could be blamed, or the later subtask does not come later.
        """
        if not self.solved or hindsight.subtask <= self.subtask:
            problem = f"T{self.subtask + 1} cannot be blamed for a failure of T{hindsight.subtask + 1}"
            raise RecordError(problem, source="(history)", hint="only a subtask that was solved before can be")
        message = f"its goal was reached, but T{hindsight.subtask + 1} failed because of it: {hindsight.message}"
        last = self.iterations[-1].attempt
        failed = replace(last, outcome="failed", failure=BLAMED_LATER, message=message, hindsight=hindsight)
        return failed, replace(self, iterations=self.iterations[:-1])

    def superseded(self, revision: Revision) -> Self:
        """Returns the history whose last attempt no longer stands, since an earlier subtask was revised.

        Raises:
            RecordError: The revision is not one of an earlier subtask, or the last attempt was revised already.
        """
        if revision.subtask is None or revision.subtask >= self.subtask or not self.iterations:
            problem = "only a change before it supersedes an attempt"
            raise RecordError(problem, source="(history)", hint="see `reopened`")
        last, revised = self.iterations[-1]
        if revised is not None:
            raise RecordError("the last attempt was revised already", source="(history)", hint="add the next attempt")
        return replace(self, iterations=(*self.iterations[:-1], Iteration(last, revision)))

    def _is_own(self, revision: Revision) -> bool:
        return revision.subtask in (None, self.subtask)

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
    def from_json(cls, source: Source) -> Self:
        """Returns the history that a JSON file, or a mapping of the same form, describes.

        Raises:
            RecordError: The one first thing that is malformed, with its place and what was expected.
        """
        document = load(source, RecordError)
        form = document.read(_HistoryForm)
        history = cls(form.subtask, (), form.limit)
        for number, iteration in enumerate(form.iterations):
            try:
                history = history.add(*iteration)
            except HistoryFull as problem:
                raise document.fail(("iterations", number), str(problem)) from problem
        return history


@dataclass(frozen=True, slots=True)
class _HistoryForm:
    # The first version knew no hindsight and no causes in an earlier subtask; what it has is read as it was meant.
    schema: Literal["scene2demo-history/1", "scene2demo-history/2"]
    subtask: Annotated[int, ReadBy(index)]
    limit: Annotated[int, ReadBy(index)]
    iterations: tuple[Iteration, ...]
