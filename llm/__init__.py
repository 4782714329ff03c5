"""Proposals: from a query and a scene to a task with subtasks, formulas, scales and action flows.

    proposal = llm.propose("put the glass into the refrigerator", scene)
    report = oag.compose(proposal.task).verify()

The built-in offline planner needs no model. A query that it cannot place raises `QueryError`, which says what was
understood, what stands in the way and what would work; it never guesses silently (`Proposal.notes` says what was
taken on trust). With `model="openai:gpt-5.2"` or another configuration the five modules are asked of that model, and
the graph decides which of its answers are taken (docs/models.md).
"""

import importlib
from typing import TYPE_CHECKING, Any

from llm.client.transport import Budget, ChatReply, ChatRequest, Image, Message, Metered, Transport, Usage
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
from llm.offline.planner import OfflinePlanner
from llm.proposing.propose import Expanded, Proposal, Proposer, propose
from llm.structured.conversation import AnswersRefused, Conversation, PlanVerdict, Round

if TYPE_CHECKING:
    from llm.client.recording import Recorder, Replay, connect
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
]

# pydantic is loaded with the first question to a model.
_PLACES = {
    "ModelProposer": "llm.proposing.model_proposer",
    "Recorder": "llm.client.recording",
    "Replay": "llm.client.recording",
    "connect": "llm.client.recording",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'llm' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
