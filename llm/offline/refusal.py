"""Why one reading of a query does not become a task; the readings' refusals are compared before one is shown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from llm.errors import RefusalCode
from llm.intent import Intent
from llm.request import Request

# The further a reading got before something stood in its way, the more it says about what was meant.
_PROGRESS: tuple[RefusalCode, ...] = (
    "empty",
    "too-long",
    "not-understood",
    "unknown-action",
    "missing-place",
    "unknown-object",
    "several-objects",
    "wrong-place",
    "unsupported-relation",
    "unknown-place",
    "hand-full",
    "affordance",
    "ambiguous-relation",
    "ambiguous-object",
    "already-so",
    "ambiguous-reading",
    "too-large",
    "unproved",
    "model-declined",
)


_MOST_NAMED = 6


def alternatives(ids: Iterable[str], link: str = " or ") -> str:
    """Returns ids, or what is said of them, as a sentence lists them; of many, the first ones and how many more."""
    named = tuple(ids)
    if len(named) > _MOST_NAMED:
        named = (*named[: _MOST_NAMED - 1], f"{len(named) - _MOST_NAMED + 1} more")
    return link.join(named)


class Refusal(Exception):
    """One reading's obstacle; `understand` turns the one that says most into a QueryError.

    Attributes:
        code: Which refusal it is.
        problem: What stands in the way.
        understood: What was understood, or empty for the reading's own words.
        scene: Descriptions of objects that matter here.
        instead: Wishes that may have been meant; some of them may not be possible either.
    """

    def __init__(
        self,
        code: RefusalCode,
        problem: str,
        *,
        understood: str = "",
        scene: Sequence[str] = (),
        instead: Sequence[Intent | Request] = (),
    ) -> None:
        super().__init__(problem)
        self.code: RefusalCode = code
        self.problem = problem
        self.understood = understood
        self.scene = tuple(scene)
        # Whether the reading lacks a verb or a place, so that it could not have become a plan.
        self.in_vain = False
        self.instead: tuple[Intent | Request, ...] = tuple(instead)

    @property
    def progress(self) -> tuple[bool, int]:
        """How far the reading got; what is larger says more."""
        return not self.in_vain, _PROGRESS.index(self.code)

    @property
    def leaves_choice(self) -> bool:
        """Whether the reading could still have been meant, so that no other one may be taken in its place."""
        return self.code.startswith("ambiguous") and not self.in_vain
