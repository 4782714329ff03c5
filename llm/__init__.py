"""Proposals: from a query and a scene to a task with subtasks, formulas, scales and action flows.

    proposal = llm.propose("put the glass into the refrigerator", scene)
    report = oag.compose(proposal.task).verify()

The built-in offline planner needs no model. A query that it cannot place raises `QueryError`, which says what was
understood, what stands in the way and what would work; it never guesses silently (`Proposal.notes` says what was
taken on trust). With `model="openai:gpt-5.2"` or another configuration the five modules are asked of that model, and
the graph decides which of its answers are taken (docs/models.md).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from llm.client.budget import Budget, Metered, Usage
from llm.client.transport import ChatReply, ChatRequest, Image, Message, Transport
from llm.errors import (
    BudgetSpent,
    LlmError,
    ModelConfigError,
    ModelError,
    ProposerError,
    QueryError,
    RefusalCode,
    RequestError,
)
from llm.offline.lexicon import Lexicon, LexiconError
from llm.offline.planner import OfflinePlanner, tasks
from llm.proposing.proposal import Expanded, Proposal, Proposer
from llm.structured.conversation import AnswersRefused, Conversation, PlanVerdict, Round
from oag import Scene
from oag.model.codec import shown
from oag.sizes import TO_THE_AIM, Sizing
from oag.task_definition import required_scene

if TYPE_CHECKING:
    from llm.client.connect import connect
    from llm.client.recording import Recorder, Replay
    from llm.proposing.model_proposer import ModelProposer

__all__ = [
    "AnswersRefused",
    "Budget",
    "BudgetSpent",
    "ChatReply",
    "ChatRequest",
    "Conversation",
    "Expanded",
    "Image",
    "Lexicon",
    "LexiconError",
    "LlmError",
    "Message",
    "Metered",
    "ModelConfigError",
    "ModelError",
    "ModelProposer",
    "OfflinePlanner",
    "PlanVerdict",
    "Proposal",
    "Proposer",
    "ProposerError",
    "QueryError",
    "Recorder",
    "RefusalCode",
    "Replay",
    "RequestError",
    "Round",
    "Transport",
    "Usage",
    "connect",
    "propose",
    "tasks",
]


def propose(query: str, scene: Scene, model: Proposer | str | None = None, *, sizing: Sizing = TO_THE_AIM) -> Proposal:
    """Propose a task for a query in a scene; `oag.compose(proposal.task).verify()` gives its certificate.

    Args:
        query: The request, in English.
        scene: The scene.
        model: None for the offline planner, a configuration string such as "openai:gpt-5.2" or "replay:FILE", or an
            object that proposes. The last one, such as a `ModelProposer` with a budget, uses its own `sizing`.
        sizing: Rule for the sizes of manipulated objects; by default an object that is too wide is scaled to the
            aim.

    Raises:
        QueryError: The query is no text, is not understood, is ambiguous, or cannot be executed in the scene.
        SceneError: The scene is no `Scene`, but for example the name of one.
        ProposerError: `model` cannot propose.
        ModelConfigError: The configuration string names no known model, or its key is missing.
        ModelError: The model did not reply.
        AnswersRefused: No answer of the model was valid in the allowed rounds.
    """
    if not isinstance(query, str):
        raise QueryError("not-understood", str(query), f"expected a sentence in English, got {shown(query)}")
    required_scene(scene)
    if model is None:
        return OfflinePlanner(sizing=sizing).propose(query, scene)
    proposer: object = model
    if isinstance(model, str):
        # pydantic is loaded with the first question to a model.
        from llm.client.connect import connect
        from llm.proposing.model_proposer import ModelProposer

        proposer = ModelProposer(connect(model), name=model, sizing=sizing)
    # A class has the method too, but unbound.
    if isinstance(proposer, type) or not isinstance(proposer, Proposer):
        raise ProposerError(proposer)
    return proposer.propose(query, scene)


# pydantic is loaded with the first question to a model.
_PLACES = {
    "ModelProposer": "llm.proposing.model_proposer",
    "Recorder": "llm.client.recording",
    "Replay": "llm.client.recording",
    "connect": "llm.client.connect",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'llm' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
