"""A plan proposed by a language model, whose every word is kept in the run's folder."""

from __future__ import annotations

from executor.cli.options import Run
from executor.run_folder import RunFolder
from llm import Budget, ModelProposer, Proposal, connect
from oag import Scene

REPLAY = "replay:"


def propose_by_model(options: Run, model: str, scene: Scene, folder: RunFolder) -> Proposal:
    """Returns a model's proposal for a run's query; what it was asked and answered is in the folder, also on failure.

    Args:
        options: The run; its budget is the model's.
        model: Which model, such as "openai:gpt-5.2" or "replay:FILE".
        scene: Where it is to be done.
        folder: The run's folder.

    Raises:
        QueryError: The query is not understood, or cannot be done in the scene.
        ModelError: The model is not known, did not reply, or the budget is spent.
        AnswersRefused: None of the model's answers held.
    """
    budget = Budget(tokens=options.max_tokens, cost_usd=options.max_cost_usd, time_s=options.max_time_s)
    # A replay has its record already.
    record = None if model.startswith(REPLAY) else folder.exchanges
    proposer = ModelProposer(connect(model, budget=budget, record=record), name=model)
    try:
        return proposer.propose(options.query, scene)
    finally:
        if proposer.conversation is not None:
            folder.write_conversation(proposer.conversation.to_json())
