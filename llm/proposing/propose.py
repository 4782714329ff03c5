"""Public entry point: propose a task for a query in a scene, by the offline planner, a model or any `Proposer`."""

from __future__ import annotations

from importlib import import_module
from typing import Protocol, runtime_checkable

from llm.errors import ProposerError, QueryError
from llm.offline.planner import OfflinePlanner
from llm.proposing.proposal import Proposal
from oag import Scene
from oag.model.codec import shown
from oag.sizes import TO_THE_AIM, Sizing
from oag.task import required_scene


@runtime_checkable
class Proposer(Protocol):
    """Interface of everything that turns a query into a proposal: the offline planner, or a model."""

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Return the task for a query in a scene, or raise a QueryError."""
        ...


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
        transport = import_module("llm.client.recording").connect(model)
        proposer = import_module("llm.proposing.model_proposer").ModelProposer(transport, name=model, sizing=sizing)
    # A class has the method too, but unbound.
    if isinstance(proposer, type) or not isinstance(proposer, Proposer):
        raise ProposerError(proposer)
    return proposer.propose(query, scene)
