"""The front door: a query and a scene go in, a proposed task comes out, whoever proposes it."""

from __future__ import annotations

from importlib import import_module
from typing import Protocol, runtime_checkable

from llm.errors import ProposerError, QueryError
from llm.offline.planner import OfflinePlanner
from llm.proposal import Proposal
from oag import Scene
from oag.model.jsonfile import shown
from oag.task.sizes import TO_THE_AIM, Sizing
from oag.task.task import required_scene


@runtime_checkable
class Proposer(Protocol):
    """Whatever turns a query into a proposal: the offline planner, or a model behind an interface of its own."""

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Returns the task for a query in a scene, or raises a QueryError."""
        ...


def propose(query: str, scene: Scene, model: Proposer | str | None = None, *, sizing: Sizing = TO_THE_AIM) -> Proposal:
    """Returns a task for a query in a scene; `oag.compose(proposal.task).verify()` gives its certificate.

    Args:
        query: What the user wants, in English.
        scene: Where it is to be done.
        model: Who proposes: None for the offline planner, a configuration string such as "openai:gpt-5.2" or
            "replay:FILE", or an object that proposes, such as a `ModelProposer` with a budget, which goes by its own
            `sizing`.
        sizing: What becomes of the sizes of what is handled: by default what is too wide is scaled to the aim.

    Raises:
        QueryError: The query is no text, is not understood, can mean several things, or cannot be done in the scene.
        SceneError: The scene is no `Scene`, but the name of one, say.
        ProposerError: `model` cannot propose.
        ModelConfigError: The configuration string names no model that is known, or its key is missing.
        ModelError: The model did not reply.
        AnswersRefused: None of the model's answers held in the rounds that it had.
    """
    if not isinstance(query, str):
        raise QueryError("not-understood", str(query), f"expected a sentence in English, got {shown(query)}")
    required_scene(scene)
    if model is None:
        return OfflinePlanner(sizing=sizing).propose(query, scene)
    proposer: object = model
    if isinstance(model, str):
        transport = import_module("llm.wire.connect").connect(model)
        proposer = import_module("llm.modules.proposer").ModelProposer(transport, name=model, sizing=sizing)
    # A class has the method too, but not bound to anything.
    if isinstance(proposer, type) or not isinstance(proposer, Proposer):
        raise ProposerError(proposer)
    return proposer.propose(query, scene)
