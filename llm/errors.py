"""Exceptions of this package: misuse, and queries that cannot be turned into a task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

RefusalCode = Literal[
    "empty",
    "too-long",
    "not-understood",
    "unknown-action",
    "missing-place",
    "several-steps",
    "several-objects",
    "unknown-object",
    "ambiguous-object",
    "ambiguous-reading",
    "ambiguous-relation",
    "unsupported-relation",
    "wrong-place",
    "unknown-place",
    "affordance",
    "already-so",
    "hand-full",
]


class LlmError(Exception):
    """Every exception that this package raises on purpose."""


class ProposerError(LlmError, TypeError):
    """Something was passed as a model that cannot propose anything."""

    def __init__(self, model: object) -> None:
        super().__init__(
            f"model is None (the offline planner) or an object with propose(query, scene) -> Proposal, "
            f"not {type(model).__name__} ({str(model)[:40]!r})"
        )
        self.model = model


class ProposalError(LlmError):
    """A proposal's JSON does not have the documented form.

    Attributes:
        place: Where in the JSON.
        problem: What was expected there, and what was found.
    """

    def __init__(self, place: str, problem: str) -> None:
        super().__init__(f"proposal {place}: {problem}")
        self.place = place
        self.problem = problem


class QueryError(LlmError):
    """A query is understood in no way, or in more than one, or asks for what cannot be done in the scene.

    Attributes:
        code: Which of the refusals it is.
        query: The query as it was given.
        problem: What stands in the way, one sentence without its full stop.
        understood: What was understood of it, or empty.
        scene: What the scene has, as far as it helps.
        suggestions: Queries that would work.
    """

    def __init__(
        self,
        code: RefusalCode,
        query: str,
        problem: str,
        *,
        understood: str = "",
        scene: Sequence[str] = (),
        suggestions: Sequence[str] = (),
    ) -> None:
        self.code: RefusalCode = code
        self.query = query
        self.problem = problem
        self.understood = understood
        self.scene = tuple(scene)
        self.suggestions = tuple(suggestions)
        lines = [f'cannot plan "{_shown(query)}": {problem}']
        if understood:
            lines.append(f"  understood  {understood}")
        lines.extend(_listing("in scene", self.scene))
        lines.extend(_listing("try", tuple(f'"{text}"' for text in self.suggestions)))
        super().__init__("\n".join(lines))


def _listing(head: str, items: tuple[str, ...]) -> list[str]:
    """Returns lines with the head before the first item and blanks before the others."""
    return [f"  {head if index == 0 else '':<11} {item}" for index, item in enumerate(items)]


def _shown(query: str) -> str:
    """Returns the query on one line, cut where it is long."""
    line = " ".join(query.split())
    return line if len(line) <= 120 else f"{line[:117]}..."
