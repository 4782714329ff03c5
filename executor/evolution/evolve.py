"""Self-evolution: a failed subtask is criticised, its flow revised, its start restored, and run again.

Source: the paper's Algorithm 1. Its reset to the subtask's saved initial state is exact here: every attempt starts
from the same checkpoint, so that the flow which succeeds in the end does so again, to the last bit, when run by itself.
"""

from __future__ import annotations

from executor.evolution.frames import FrameSource
from executor.evolution.loop import EvolutionLoop
from executor.evolution.record import Evolution
from executor.records.rollout import Listener, ignore
from executor.rollouts.running import RECORD_HZ, Run, composed
from executor.scenes.vary import vary as vary_scene
from executor.world.belief import true_scene
from executor.world.faults import Fault
from llm.evolution import Inspector, MeasuredInspector, SearchSupervisor, Supervisor
from oag import ObjectActionGraph, Scene

MOST_REVISIONS = 5
"""How many revisions a subtask may have, the paper's limit."""


def evolve(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    inspector: Inspector | None = None,
    supervisor: Supervisor | None = None,
    limit: int = MOST_REVISIONS,
    listen: Listener = ignore,
    record_hz: float = RECORD_HZ,
    vary: bool = True,
    faults: tuple[Fault, ...] = (),
    frames: FrameSource | None = None,
) -> Evolution:
    """Returns what became of a task whose failing flows were revised.

    Equal scene, flows, seed, inspector and supervisor give an equal story, bit by bit; the two that come with the
    package need no model.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning.
        inspector: Judges steps; by default from measurements.
        supervisor: Revises flows; by default by a search that measurements guide.
        limit: How many revisions a subtask may have.
        listen: Told when subtasks and steps begin and end, and when a flow is revised.
        record_hz: Samples a second.
        vary: Whether the scene is varied by the seed.
        faults: What is wrong on purpose, in experiments.
        frames: Draws failed attempts, for an inspector or supervisor that looks at pictures.

    Raises:
        TaskError: `graph` is no graph.
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        ValueError: `limit` is negative.
        FaultUnfit, SceneError: The scene has nothing that a fault could be about.
        EvolutionInterrupted: Ctrl-C; carries what was done.
    """
    if limit < 0:
        raise ValueError(f"limit must not be negative, got {limit}")
    graph = composed(graph)
    nominal = scene or graph.scene
    concrete = nominal.with_scales(graph.task.scales)
    if vary:
        concrete = vary_scene(concrete, seed)
    concrete = true_scene(concrete, faults)
    run = Run(graph, concrete, seed, listen, record_hz, faults)
    try:
        return EvolutionLoop(
            run, nominal, inspector or MeasuredInspector(), supervisor or SearchSupervisor(), limit, frames
        ).run()
    finally:
        run.close()
