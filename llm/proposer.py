"""The front door: a query and a scene go in, a proposed task comes out, whoever proposes it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from llm.errors import ProposerError
from llm.offline.planner import OfflinePlanner
from llm.proposal import Proposal
from oag import Scene


@runtime_checkable
class Proposer(Protocol):
    """Whatever turns a query into a proposal: the offline planner, or a model behind an interface of its own."""

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Returns the task for a query in a scene, or raises a QueryError."""
        ...


def propose(query: str, scene: Scene, model: Proposer | None = None) -> Proposal:
    """Returns a task for a query in a scene; it is not verified yet (`oag.compose(proposal.task).verify()`).

    Args:
        query: What the user wants, in English.
        scene: Where it is to be done.
        model: Who proposes; None for the offline planner.

    Raises:
        QueryError: The query is not understood, can mean several things, or cannot be done in the scene.
        ProposerError: `model` cannot propose.
    """
    proposer = OfflinePlanner() if model is None else model
    # A class has the method too, but not bound to anything.
    if isinstance(proposer, type) or not isinstance(proposer, Proposer):
        raise ProposerError(proposer)
    return proposer.propose(query, scene)
