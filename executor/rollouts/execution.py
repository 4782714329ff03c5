"""Runs a verified task in the physics, from its start or from one of an earlier rollout's checkpoints."""

from __future__ import annotations

from executor.records.events import Listener, ignore
from executor.records.rollout import Failure, Rollout
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.judge import as_failure
from executor.rollouts.running import RECORD_HZ, Run
from executor.scenes.vary import vary as vary_scene
from oag import ObjectActionGraph, Scene, TaskError
from oag.model.jsonfile import shown


def composed(graph: object) -> ObjectActionGraph:
    """Returns a graph.

    Raises:
        TaskError: It is none, but a task, say.
    """
    if isinstance(graph, ObjectActionGraph):
        return graph
    hint = "oag.compose(task, scene) makes one of a task"
    raise TaskError(f"expected an object-action graph, got {shown(graph)}", source="(argument)", hint=hint)


def rollout(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    listen: Listener = ignore,
    record_hz: float = RECORD_HZ,
    vary: bool = True,
) -> Rollout:
    """Returns what happened when a task's flows were executed by physics.

    Equal scene, flow and seed give equal states, bit by bit, in any process.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning.
        listen: Told when subtasks and steps begin and end.
        record_hz: Samples a second.
        vary: Whether the scene is varied by the seed.

    Raises:
        TaskError: `graph` is no graph.
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        RolloutInterrupted: Ctrl-C; carries the finished part.
    """
    graph = composed(graph)
    concrete = (scene or graph.scene).with_scales(graph.task.scales)
    if vary:
        concrete = vary_scene(concrete, seed)
    return Run(graph, concrete, seed, listen, record_hz).from_start()


def resume(graph: ObjectActionGraph, earlier: Rollout, subtask: int, *, listen: Listener = ignore) -> Rollout:
    """Returns the rollout that goes on from an earlier one's checkpoint; its last hash is equal to the earlier one's.

    The subtasks before are taken over as they were; the trajectory has the resumed part alone.

    Args:
        graph: The task that was executed.
        earlier: What was recorded.
        subtask: Index of the subtask to start with.
        listen: As for `rollout`.

    Raises:
        TaskError: `graph` is no graph.
        IndexError: The earlier rollout did not get to that subtask.
        CheckpointError: Its checkpoint cannot be read.
    """
    graph = composed(graph)
    if not 0 <= subtask < len(earlier.subtasks):
        raise IndexError(f"subtask {subtask} is not among the {len(earlier.subtasks)} recorded ones")
    checkpoint = Checkpoint.from_bytes(earlier.subtasks[subtask].checkpoint)
    run = Run(graph, earlier.scene, earlier.seed, listen, earlier.record_hz)
    run.subtasks = list(earlier.subtasks[:subtask])
    return run.from_checkpoint(checkpoint, subtask)


def failure_of(rollout: Rollout) -> Failure | None:
    """Returns what ended a rollout: a step's failure, or what the task goal still lacks."""
    return rollout.failure or as_failure(rollout.goal_readings, rollout.task.name)
