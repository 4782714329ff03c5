"""Exceptions of this package: misuse, queries that cannot be turned into a task, and models that do not answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from bddl.syntax.errors import Portable
from bddl.visible import visible

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
    "ambiguous-relation",
    "ambiguous-object",
    "already-so",
    "ambiguous-reading",
    "too-large",
    "unproved",
    "model-declined",
]
"""Why a query becomes no task; the further it was understood before something stood in its way, the later it stands."""

_MOST_LISTED = 12


class LlmError(Portable):
    """Every exception that this package raises on purpose.

    Attributes:
        usage: What models were used for until then, as JSON, where somebody keeps count.
    """

    usage: Mapping[str, object] | None = None


class ProposerError(LlmError, TypeError):
    """Something was passed as a model that cannot propose anything."""

    def __init__(self, model: object) -> None:
        super().__init__(
            "model is None (the offline planner), a configuration string such as 'openai:gpt-5.2', "
            f"or an object with propose(query, scene) -> Proposal, "
            f"not {type(model).__name__} ({str(model)[:40]!r})"
        )
        self.model = model


class RequestError(LlmError, ValueError):
    """A request to a model is put together wrongly; the message says what it has to be."""


class ModelError(LlmError):
    """A model did not give a usable reply. Its subclasses say why; no message ever holds a key.

    What a server or a configuration says is shown, and steers no terminal.

    Attributes:
        model: Which model, as it was configured, such as "openai:gpt-5.2" or "replay:run.jsonl".
        problem: What went wrong, one sentence without its full stop.
        advice: What to do next, or empty.
        attempts: How often the request was sent; a server may have worked, and charge, each time.
    """

    attempts = 1

    def __init__(self, model: str, problem: str, advice: str = "") -> None:
        self.model, self.problem, self.advice = visible(model), visible(problem), visible(advice)
        said = f"{self.model}: {self.problem}"
        super().__init__(f"{said}. {self.advice}" if advice else said)


class ModelConfigError(ModelError, ValueError):
    """A model is not configured: unknown provider or name, missing key or address, or a faulty profile.

    Attributes:
        near: Legal configurations that resemble the one asked for.
        known: All legal ones.
    """

    def __init__(
        self, model: str, problem: str, advice: str = "", *, near: Sequence[str] = (), known: Sequence[str] = ()
    ) -> None:
        super().__init__(model, problem, advice)
        self.near = tuple(near)
        self.known = tuple(known)


class ModelUnavailable(ModelError):
    """The server could not be reached, was busy or failed, also after the last attempt."""


class ModelTimeout(ModelError):
    """No whole reply came in time."""


class ModelRefused(ModelError):
    """The server rejected the request (a 4xx status): sending it again would not help."""


class ModelCancelled(ModelError):
    """The caller cancelled while a reply was awaited."""


class BadReply(ModelError):
    """The server answered, but not with a chat completion."""


class ReplyTooLong(BadReply):
    """The answer exceeds the bound in bytes; reading stopped there."""


class BudgetSpent(ModelError):
    """A run's budget does not allow another request; the advice says what was used."""


class CassetteError(ModelError):
    """A file of recorded exchanges cannot be read or written."""


class ReplayMissing(CassetteError):
    """A recording holds no reply to a request, or none any more.

    Attributes:
        digest: The digest of the request.
        differences: How it differs from the nearest recorded one, a line each.
    """

    def __init__(
        self, model: str, problem: str, advice: str = "", *, digest: str = "", differences: Sequence[str] = ()
    ) -> None:
        lines = [advice, *(f"  {line}" for line in differences)]
        super().__init__(model, problem, "\n".join(lines))
        self.digest = digest
        self.differences = tuple(differences)


class PicturesMissing(LlmError):
    """A model is to look at pictures, and there are none; the message says why and what to do."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"there are no pictures for the model to look at: {reason}\n"
            "Go on with measurements alone (--views none), or make pictures possible"
        )
        self.reason = reason


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
        lines = [f'cannot plan "{shown_query(query)}": {problem}']
        if understood:
            lines.append(f"  understood  {understood}")
        lines.extend(_listing("in scene", self.scene))
        lines.extend(_listing("try", tuple(f'"{text}"' for text in self.suggestions)))
        super().__init__(visible("\n".join(lines)))


def _listing(head: str, items: tuple[str, ...]) -> list[str]:
    if len(items) > _MOST_LISTED:
        items = (*items[:_MOST_LISTED], f"and {len(items) - _MOST_LISTED} more")
    return [f"  {head if index == 0 else '':<11} {item}" for index, item in enumerate(items)]


def shown_query(query: str) -> str:
    """Returns the query on one line, cut where it is long."""
    line = " ".join(query.split())
    return line if len(line) <= 120 else f"{line[:117]}..."
