"""Exceptions of `llm`: misuse of the API, queries that become no task, and models that give no usable reply."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from bddl.errors import Scene2DemoError
from bddl.terminal import escape_control

RefusalCode = Literal[
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
    "ambiguous-object",
    "already-so",
    "ambiguous-reading",
    "too-large",
    "unproved",
    "model-declined",
]
"""Reasons why a query becomes no task, ordered by progress: a later code means that more of it was understood."""

_MOST_LISTED = 12


class LlmError(Scene2DemoError):
    """Base of every exception that this package raises on purpose.

    Attributes:
        usage: Usage of models until then, as JSON, where it is counted.
    """

    usage: Mapping[str, object] | None = None


class ProposerError(LlmError, TypeError):
    """An object passed as `model` cannot propose anything."""

    def __init__(self, model: object) -> None:
        super().__init__(
            "model is None (the offline planner), a configuration string such as 'openai:gpt-5.2', "
            f"or an object with propose(query, scene) -> Proposal, "
            f"not {type(model).__name__} ({str(model)[:40]!r})"
        )
        self.model = model


class RequestError(LlmError, ValueError):
    """A request to a model is malformed; the message states what it has to be."""


class ModelError(LlmError):
    """A model gave no usable reply. Subclasses give the reason; no message contains a key.

    Texts of servers and configurations are shown with control characters escaped.

    Attributes:
        model: The model as configured, such as "openai:gpt-5.2" or "replay:run.jsonl".
        problem: What went wrong, one sentence without its full stop.
        advice: What to do next, or empty.
        attempts: How often the request was sent; a server may have worked, and charge, each time.
    """

    attempts = 1

    def __init__(self, model: str, problem: str, advice: str = "") -> None:
        self.model, self.problem, self.advice = escape_control(model), escape_control(problem), escape_control(advice)
        text = f"{self.model}: {self.problem}"
        super().__init__(f"{text}. {self.advice}" if advice else text)


class ModelConfigError(ModelError, ValueError):
    """A model is not configured: unknown provider or name, missing key or address, or a faulty profile.

    Attributes:
        near: Valid configurations that resemble the requested one.
        known: All valid configurations.
    """

    def __init__(
        self, model: str, problem: str, advice: str = "", *, near: Sequence[str] = (), known: Sequence[str] = ()
    ) -> None:
        super().__init__(model, problem, advice)
        self.near = tuple(near)
        self.known = tuple(known)


class ModelUnavailable(ModelError):
    """The server could not be reached, was busy or failed, also after the last attempt."""

    exit_code = 1


class ModelTimeout(ModelError):
    """No whole reply came in time."""

    exit_code = 1


class ModelRefused(ModelError):
    """The server rejected the request (a 4xx status): sending it again would not help."""

    exit_code = 1


class BadReply(ModelError):
    """The server answered, but not with a chat completion."""

    exit_code = 1


class ReplyTooLong(BadReply):
    """The answer exceeds the limit in bytes; reading stopped there."""


class BudgetSpent(ModelError):
    """A run's budget allows no further request; the advice states what was used."""

    exit_code = 1


class CassetteError(ModelError):
    """A file of recorded exchanges cannot be read or written."""


class ReplayMissing(CassetteError):
    """A recording holds no reply to a request, or none that is left.

    Attributes:
        digest: The digest of the request.
        differences: Differences from the nearest recorded request, a line each.
    """

    def __init__(
        self, model: str, problem: str, advice: str = "", *, digest: str = "", differences: Sequence[str] = ()
    ) -> None:
        lines = [advice, *(f"  {line}" for line in differences)]
        super().__init__(model, problem, "\n".join(lines))
        self.digest = digest
        self.differences = tuple(differences)


class PicturesMissing(LlmError):
    """A model needs pictures and there are none; the message gives the reason and advice."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"there are no pictures for the model to look at: {reason}\n"
            "Go on with measurements alone (--views none), or make pictures possible"
        )
        self.reason = reason


class QueryError(LlmError):
    """A query has no interpretation, several, or one that cannot be executed in the scene.

    Attributes:
        code: Kind of refusal.
        query: The query as given.
        problem: The obstacle, one sentence without its full stop.
        understood: The part that was understood, or empty.
        scene: What the scene has, as far as it helps.
        suggestions: Queries that would work.
        among: Ids of the objects that may be meant, where it is not said which, or none of them is where it is said.
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
        among: Sequence[str] = (),
    ) -> None:
        self.code: RefusalCode = code
        self.query = query
        self.problem = problem
        self.understood = understood
        self.scene = tuple(scene)
        self.suggestions = tuple(suggestions)
        self.among = tuple(among)
        lines = [f'cannot plan "{shown_query(query)}": {problem}']
        if understood:
            lines.append(f"  understood  {understood}")
        lines.extend(_listing("in scene", self.scene))
        lines.extend(_listing("try", tuple(f'"{text}"' for text in self.suggestions)))
        super().__init__(escape_control("\n".join(lines)))


def _listing(head: str, items: tuple[str, ...]) -> list[str]:
    if len(items) > _MOST_LISTED:
        items = (*items[:_MOST_LISTED], f"and {len(items) - _MOST_LISTED} more")
    return [f"  {head if index == 0 else '':<11} {item}" for index, item in enumerate(items)]


def shown_query(query: str) -> str:
    """Return the query on one line, truncated if it is long."""
    line = " ".join(query.split())
    return line if len(line) <= 120 else f"{line[:117]}..."
