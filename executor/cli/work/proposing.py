"""A plan proposed by a language model, whose every word is kept in the run's folder."""

from __future__ import annotations

from executor.cli.options.running import Run
from executor.results.run_folder import RunFolder
from llm import Budget, Image, Metered, ModelProposer, Proposal
from llm.wire.connect import connect
from oag import Scene

REPLAY = "replay:"


def connected(options: Run, folder: RunFolder) -> Metered | None:
    """Returns the model that a run asks, with the run's budget, None when it asks none; all it says is recorded.

    Raises:
        ModelError: The model is not known, or its recording cannot be read or made.
    """
    if options.model is None:
        return None
    budget = Budget(tokens=options.max_tokens, cost_usd=options.max_cost_usd, time_s=options.max_time_s)
    # A replay has its record already.
    record = None if options.model.startswith(REPLAY) else folder.exchanges
    return connect(options.model, budget=budget, record=record)


def propose_by_model(
    options: Run, model: Metered, scene: Scene, folder: RunFolder, images: tuple[Image, ...] = ()
) -> Proposal:
    """Returns a model's proposal for a run's query; what it was asked and answered is in the folder, also on failure.

    Args:
        options: The run.
        model: The model, connected.
        scene: Where it is to be done.
        folder: The run's folder.
        images: Pictures of the scene, for module 1.

    Raises:
        QueryError: The query is not understood, or cannot be done in the scene.
        ModelError: The model did not reply, or the budget is spent.
        AnswersRefused: None of the model's answers held.
    """
    proposer = ModelProposer(model, name=options.model or "", images=images)
    try:
        return proposer.propose(options.query, scene)
    finally:
        if proposer.conversation is not None:
            folder.write_conversation(proposer.conversation.to_json())
