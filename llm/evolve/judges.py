"""Set up the Inspector and the Supervisor that ask one vision-language model.

    team = judges("openai:gpt-5.2", task="put the glass away")
    executor.evolve(graph, scene, inspector=team.inspector, supervisor=team.supervisor)
    team.conversation.to_json()

Source: the paper's Robotic Safety Inspector and Robotic Task Supervisor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from llm.client.connect import connect
from llm.client.transport import Transport
from llm.evolve.judge_session import ALL_VIEWS, ROUNDS, JudgeSession
from llm.evolve.model_inspector import LOOK_BACK, MOST_INSPECTED, ModelInspector
from llm.evolve.model_supervisor import MOST_SUPERVISED, ModelSupervisor
from llm.structured.conversation import Conversation, Round


@dataclass(frozen=True, slots=True)
class Judges:
    """Inspector and Supervisor of one model, and their conversation."""

    inspector: ModelInspector
    supervisor: ModelSupervisor
    session: JudgeSession

    @property
    def conversation(self) -> Conversation:
        """Rounds of both."""
        return self.session.conversation

    @property
    def stopped(self) -> str:
        """Why the model is no longer asked; empty while it is."""
        return self.session.stopped


def judges(
    model: str | Transport,
    *,
    name: str = "",
    task: str = "",
    scene: str = "",
    views: Sequence[str] = ALL_VIEWS,
    look_back: int = LOOK_BACK,
    measurements: bool = True,
    rounds: int = ROUNDS,
    most_pictures: int | None = None,
    only_faulty: bool = False,
    listen: Callable[[Round], None] | None = None,
) -> Judges:
    """Set up an Inspector and a Supervisor that ask one model.

    Args:
        model: A configuration such as "openai:gpt-5.2" or "replay:FILE"; or the result of `connect`, with a budget
            and a recording.
        name: Name of the model in records; by default the configuration.
        task: Subject of the evolution, for the record.
        scene: Name of the scene, for the record.
        views, look_back, measurements, rounds: See `ModelInspector`, `ModelSupervisor` and `JudgeSession`.
        most_pictures: Most pictures in a question; by default 36 for the Inspector, 24 for the Supervisor.
        only_faulty: See `ModelInspector`.
        listen: Called with every round.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing.
        CassetteError: A recording cannot be read.
        RequestError: Neither views nor measurements, an unknown view, or an invalid number.
    """
    transport = connect(model) if isinstance(model, str) else model
    called = name or (model if isinstance(model, str) else "model")
    session = JudgeSession(transport, Conversation(called, task, scene, listen=listen), rounds)
    inspected, supervised = (
        (MOST_INSPECTED, MOST_SUPERVISED) if most_pictures is None else (most_pictures, most_pictures)
    )
    inspector = ModelInspector(session, tuple(views), look_back, measurements, inspected, only_faulty)
    supervisor = ModelSupervisor(session, tuple(views), measurements, supervised)
    return Judges(inspector, supervisor, session)
