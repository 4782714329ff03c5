"""The files of one evolved episode."""

from __future__ import annotations

from dataclasses import replace

from executor.evolution.record import Evolution
from executor.machine.files import write_json
from executor.results.evolution_files import evolution_json
from executor.results.evolution_pairs import write_pairs
from executor.results.evolution_pictures import draw_attempts
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord
from oag import Scene, compose


def evolved_record(record: RunRecord, evolution: Evolution, folder: RunFolder, scene: Scene) -> RunRecord:
    """Writes how an episode evolved, and returns its record: the plan that was run in the end, and what was drawn.

    Args:
        record: The run as it was asked for.
        evolution: What became of it.
        folder: The run's folder.
        scene: The nominal scene.
    """
    # What the folder calls the plan, and certifies, is the one that was run in the end.
    graph = compose(evolution.evolved, scene=scene)
    drawn = draw_attempts(evolution, folder.path)
    done = replace(
        record,
        graph=graph,
        report=graph.verify(),
        rollout=evolution.rollout,
        evolution=evolution,
        attempts=drawn,
    )
    folder.write_plan(done)
    folder.write_rollout(evolution.rollout)
    write_pairs(folder.path / "pairs.jsonl", evolution, drawn.files)
    # Last, since an episode that has it counts as complete.
    write_json(folder.path / "evolution.json", evolution_json(evolution))
    return done
