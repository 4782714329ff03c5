"""`scene2demo plan`: plan a sentence, prove the plan, and check the arm's reach; nothing moves.

Exit code 0 when the plan is proved and everything in it can be reached, else 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from executor.cli.errors import DONE, FAILED
from executor.cli.options import CommonOptions, FullSize, KeepSizes, SceneName, Sentence
from executor.cli.output import counting, print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from executor.scenes.reachability import Reach


@dataclass(frozen=True)
class Options(CommonOptions):
    """Plan a sentence in a scene, prove the plan, and ask whether the arm reaches what it needs; nothing moves.

    What is asked of the arm: a base pose on free floor and a posture inside its joints' limits for everything that the
    plan takes hold of, and for a spot wherever it puts it. Collisions, paths and physics are not looked at.
    """

    query: Sentence
    scene: SceneName
    seed: int = 0
    """Seed of the random size adjustment of items, as in `run`."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False


def execute(options: Options) -> int:
    """Print the verdict as soon as there is one, and what the hand has to reach."""
    quiet = options.json
    with counting("loading the planner and the simulator", quiet=quiet):
        from executor.cli.execution import check_seed
        from executor.scenes.file import scene_for
        from executor.scenes.reachability import reach
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
        # A plan that is not proved has no defined targets of the hand.
        with counting("asking for the arm's reach, subtask by subtask", quiet=quiet) as on_progress:
            found = reach(scene.with_scales(graph.task.scales), graph.task, on_progress)
    code = DONE if found is not None and found.reachable else FAILED
    if options.json:
        head = {"ok": code == DONE, "exit_code": code, "query": options.query, "notes": list(proposal.notes)}
        plan = {"plan": graph.task.to_json(), "reach": None if found is None else found.to_json()}
        print_json({**head, **report.to_json(), **plan})
    elif found is None:
        tell("\nthe reach of the arm was not asked, since the plan is not proved", style="yellow")
    else:
        _print_reach(found)
    return code


def _print_reach(found: Reach) -> None:
    reached = sum(part.reachable for part in found.parts)
    words, style = ("REACHABLE", "green") if found.reachable else ("UNREACHABLE", "red")
    say(f"\n{words}  {reached} of {len(found.parts)} that the hand has to get to", style=style)
    for part in found.parts:
        say(f"  {'✓' if part.reachable else '✗'} {part}", style=None if part.reachable else "red")
