"""`scene2demo plan`: plan a sentence or a goal, prove the plan, and check the arm's reach; nothing moves.

Exit code 0 when the plan is proved and everything in it can be reached, else 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from executor.cli.errors import DONE, FAILED, check
from executor.cli.options import CommonOptions, FullSize, KeepSizes, Maybe, OptionalSentence, SceneName
from executor.cli.output import counting, print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from executor.scenes.reachability import Reach
    from oag import Report, Scene, Task
    from oag.planning import NoPlan
    from oag.sizes import Sizing


@dataclass(frozen=True)
class Options(CommonOptions):
    """Plan a sentence or a goal in a scene, prove the plan, and ask whether the arm reaches what it needs.

    Nothing moves. A goal is a BDDL formula: `--goal "(forall (?c - cup) (inside ?c cabinet_0))"`.

    What is asked of the arm: a base pose on free floor and a posture inside its joints' limits for everything that the
    plan takes hold of, and for a spot wherever it puts it. Collisions, paths and physics are not looked at.
    """

    scene: SceneName
    query: OptionalSentence = ""
    goal: Maybe[str] = None
    """A goal in BDDL instead of a sentence; quantifiers range over the scene."""
    seed: int = 0
    """Seed of the random size adjustment of items, as in `run`."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False


def execute(options: Options) -> int:
    """Print the verdict as soon as there is one, and what the hand has to reach."""
    missing, both = "a sentence is missing", "a sentence and a goal are given"
    expected = 'one of them, such as "put the glass into the refrigerator" or --goal "(open refrigerator_0)"'
    check(bool(options.query or options.goal), "plan:", missing, expected)
    check(not (options.query and options.goal), "plan:", both, expected)
    quiet = options.json
    with counting("loading the planner and the simulator", quiet=quiet):
        from executor.cli.execution import check_seed
        from executor.scenes.file import scene_for
        from executor.scenes.reachability import reach
        from executor.scenes.validation import require_valid
        from oag.planning import NoPlan
        from oag.sizes import Sizing
    check_seed(options.seed)
    asked = options.goal or options.query
    with counting(f"reading the scene {options.scene}", quiet=quiet):
        scene = scene_for(asked, options.scene, full_size=options.full_size, listen=tell_notes)
        tell_warnings(require_valid(scene))
    with counting("planning, and proving the plan", quiet=quiet):
        made = _planned(options, scene, Sizing(options.seed, options.keep_sizes))
    head: dict[str, object] = {"query": options.query} if options.goal is None else {"goal": options.goal}
    if isinstance(made, NoPlan):
        if quiet:
            print_json({"ok": False, "exit_code": FAILED, **head, "refusal": made.to_json()})
        else:
            say(str(made), style="red")
        return FAILED
    task, report, notes = made
    if not quiet:
        tell_notes(notes)
        say(str(report))
    found = None
    if report:
        # A plan that is not proved has no defined targets of the hand.
        with counting("asking for the arm's reach, subtask by subtask", quiet=quiet) as on_progress:
            found = reach(scene.with_scales(task.scales), task, on_progress)
    code = DONE if found is not None and found.reachable else FAILED
    if options.json:
        head = {"ok": code == DONE, "exit_code": code, **head, "notes": list(notes)}
        plan = {"plan": task.to_json(), "reach": None if found is None else found.to_json()}
        print_json({**head, **report.to_json(), **plan})
    elif found is None:
        tell("\nthe reach of the arm was not asked, since the plan is not proved", style="yellow")
    else:
        _print_reach(found)
    return code


def _planned(options: Options, scene: Scene, sizing: Sizing) -> tuple[Task, Report, tuple[str, ...]] | NoPlan:
    """Return the plan of a sentence or a goal with its report and notes, or why a goal has none."""
    from llm import propose
    from oag import compose, plan
    from oag.planning import NoPlan
    from oag.sizes import planned_resizings

    if options.goal is None:
        proposal = propose(options.query, scene, sizing=sizing)
        graph = compose(proposal.task, scene=scene)
        return graph.task, graph.verify(), proposal.notes
    made = plan(scene, options.goal, sizing=sizing)
    if made.task is None or made.report is None:
        return made.refusal or NoPlan("no-plan", "none was found")
    names = [f"T{number} {subtask.name}" for number, subtask in enumerate(made.task.subtasks, 1)]
    sizes = map(str, planned_resizings(made.task.scales, scene))
    return made.task, made.report, (f"the plan is {', '.join(names) or 'to do nothing'}", *sizes)


def _print_reach(found: Reach) -> None:
    reached = sum(part.reachable for part in found.parts)
    words, style = ("REACHABLE", "green") if found.reachable else ("UNREACHABLE", "red")
    say(f"\n{words}  {reached} of {len(found.parts)} that the hand has to get to", style=style)
    for part in found.parts:
        say(f"  {'✓' if part.reachable else '✗'} {part}", style=None if part.reachable else "red")
