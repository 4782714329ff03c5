"""`scene2demo plan`: plan a sentence, prove the plan, and go through it by geometry; nothing moves.

Exit code 0 when the plan is proved and feasible, else 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED
from executor.cli.options import CommonOptions, FullSize, KeepSizes, SceneName, Sentence
from executor.cli.output import counting, print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from executor.records import Event
    from executor.rollouts.feasibility import Feasibility


@dataclass(frozen=True)
class Options(CommonOptions):
    """Plan a sentence in a scene, prove the plan, and go through all of it by geometry; nothing moves.

    Each subtask is planned in the state that it will find: stances, grasps, doors, places, and free ways between them.
    That is the rule by which `run` refuses. Slips, stalls and other effects of forces are not looked at.
    """

    query: Sentence
    scene: SceneName
    seed: int = 0
    """Varies the scene and seeds the planning, as in `run`."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False


def execute(options: Options) -> int:
    """Print the verdict as soon as there is one, and what was planned for each subtask."""
    quiet = options.json
    with counting("loading the planner and the simulator", quiet=quiet):
        from executor.cli.execution import check_seed
        from executor.rollouts.feasibility import feasible
        from executor.scenes.file import scene_for
        from executor.scenes.validation import require_valid
        from llm import propose
        from oag import compose
        from oag.sizes import Sizing
    check_seed(options.seed)
    with counting(f"reading the scene {options.scene}", quiet=quiet):
        scene = scene_for(options.query, options.scene, full_size=options.full_size, listen=tell_notes)
        tell_warnings(require_valid(scene))
    with counting("planning, and proving the plan", quiet=quiet):
        proposal = propose(options.query, scene, sizing=Sizing(options.seed, options.keep_sizes))
        graph = compose(proposal.task, scene=scene)
        report = graph.verify()
    if not quiet:
        tell_notes(proposal.notes)
        say(str(report))
    found = None
    if report:
        with counting("going through the plan by geometry, subtask by subtask", quiet=quiet) as on_progress:

            def listen(event: Event) -> None:
                if event.kind == "subtask-start":
                    on_progress(event.subtask, event.subtask_count)

            found = feasible(graph, scene, options.seed, listen=listen)
    code = DONE if found else FAILED
    if options.json:
        head = {"ok": code == DONE, "exit_code": code, "query": options.query, "notes": list(proposal.notes)}
        plan = {"plan": graph.task.to_json(), "feasibility": None if found is None else found.to_json()}
        print_json({**head, **report.to_json(), **plan})
    elif found is None:
        tell("\nwhether it is feasible was not asked, since the plan is not proved", style="yellow")
    else:
        _print_feasibility(found)
    return code


def _print_feasibility(found: Feasibility) -> None:
    done = sum(subtask.record.succeeded for subtask in found.subtasks)
    words, style = ("FEASIBLE", "green") if found else ("INFEASIBLE", "red")
    say(f"\n{words}  {done} of {pluralize(len(found.task.subtasks), 'subtask')}, by geometry", style=style)
    for subtask in found.subtasks:
        good = subtask.record.succeeded
        say(f"  {'✓' if good else '✗'} {subtask if good else found.reason}", style=None if good else "red")
    for detour in found.detours:
        say(f"  note: {detour.reason}", style="yellow")
