"""The Inspector and the Supervisor of one model, ready for a self-evolution: the one place that puts them together.

team = judges("openai:gpt-5.2", task="put the glass away")
executor.evolve(graph, scene, inspector=team.inspector, supervisor=team.supervisor)
team.conversation.to_json()
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from llm.answers.conversation import Conversation, Round
from llm.evolution.asking import ROUNDS, Asking
from llm.evolution.model_inspector import ALL_VIEWS, LOOK_BACK, ModelInspector
from llm.evolution.model_inspector import MOST_PICTURES as MOST_INSPECTED
from llm.evolution.model_supervisor import MOST_PICTURES as MOST_SUPERVISED
from llm.evolution.model_supervisor import ModelSupervisor
from llm.memory.folder import SkillMemory
from llm.memory.supervisor import notes_for
from llm.wire.connect import connect
from llm.wire.transport import Transport


@dataclass(frozen=True, slots=True)
class Judges:
    """Who judges and who revises, and what was said to them.

    Attributes:
        inspector: Judges steps.
        supervisor: Revises flows.
        asking: Whom both ask.
    """

    inspector: ModelInspector
    supervisor: ModelSupervisor
    asking: Asking

    @property
    def conversation(self) -> Conversation:
        """Every round of both."""
        return self.asking.conversation

    @property
    def stopped(self) -> str:
        """Why nothing is asked any more; empty while all is well."""
        return self.asking.stopped


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
    memory: SkillMemory | None = None,
    listen: Callable[[Round], None] | None = None,
) -> Judges:
    """Returns an Inspector and a Supervisor behind which one model stands.

    Args:
        model: A configuration such as "openai:gpt-5.2" or "replay:FILE"; or what `connect` returns, with a budget and a
            recording.
        name: What the model is called in records; by default the configuration.
        task: What the evolution is about, for the record.
        scene: Name of the scene, for the record.
        views: Cameras whose pictures they see; none for measurements only.
        look_back: How many steps before the judged one the Inspector sees.
        measurements: Whether they are told what was measured.
        rounds: Most questions for one answer.
        most_pictures: Most pictures in a question; by default 36 for the Inspector, 24 for the Supervisor.
        memory: Notes that the Supervisor is shown.
        listen: Gets every round.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing.
        CassetteError: A recording cannot be read.
        RequestError: Neither views nor measurements, an unknown view, or a number that makes no sense.
    """
    transport = connect(model) if isinstance(model, str) else model
    called = name or (model if isinstance(model, str) else "model")
    asking = Asking(transport, Conversation(called, task, scene, listen=listen), rounds)
    inspected, supervised = (
        (MOST_INSPECTED, MOST_SUPERVISED) if most_pictures is None else (most_pictures, most_pictures)
    )
    inspector = ModelInspector(asking, tuple(views), look_back, measurements, inspected)
    notes = None if memory is None else partial(notes_for, memory)
    supervisor = ModelSupervisor(asking, tuple(views), measurements, supervised, notes)
    return Judges(inspector, supervisor, asking)
