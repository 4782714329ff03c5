"""`scene2demo plan`: plan a sentence or a goal, prove the plan, and go through it by geometry; nothing moves.

Exit code 0 when the plan is proved and feasible, else 1, also where the search had no answer in its time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, check
from executor.cli.options import (
    CommonOptions,
    DomainFile,
    FullSize,
    KeepSizes,
    Maybe,
    ModelOptions,
    OptionalSentence,
    RobotName,
    SceneName,
)
from executor.cli.output import counting, print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from executor.records import Event
    from executor.rollouts.feasibility import Feasibility
    from llm import Proposal
    from llm.structured.conversation import Spending
    from oag import Report, Scene, Task
    from oag.planning import NoPlan
    from oag.sizes import Sizing


@dataclass(frozen=True)
class Options(CommonOptions):
    """Plan a sentence or a goal in a scene, prove the plan, and go through all of it by geometry; nothing moves.

    A goal is a BDDL formula: `--goal "(forall (?c - cup) (inside ?c cabinet_0))"`.

    Each subtask is planned in the state that it will find: stances, grasps, doors, places, and free ways between them.
    That is the rule by which `run` refuses. Slips, stalls and other effects of forces are not looked at.
    """

    scene: SceneName
    query: OptionalSentence = ""
    goal: Maybe[str] = None
    """A goal in BDDL instead of a sentence; quantifiers range over the scene."""
    domain: DomainFile = None
    seed: int = 0
    """Varies the scene and seeds the planning, as in `run`."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    robot: RobotName = None
    asked: ModelOptions = field(default_factory=ModelOptions)
    record: Maybe[Path] = None
    """With --model: new file for what the model answers; --model replay:FILE repeats it."""


_KNOWN = ("flow/unfilled", "context/goal-gap", "task/scaled")
"""Notes of every proved plan: geometry fills in numbers and judges by what later subtasks need; sizes come first."""


def execute(options: Options) -> int:
    """Print the verdict as soon as there is one, and what was planned for each subtask."""
    missing, both = "a sentence is missing", "a sentence and a goal are given"
    expected = 'one of them, such as "put the glass into the refrigerator" or --goal "(open refrigerator_0)"'
    check(bool(options.query or options.goal), "plan:", missing, expected)
    check(not (options.query and options.goal), "plan:", both, expected)
    for name, value in (("--record", options.record), ("--models", " ".join(options.asked.models))):
        check(not value or options.asked.model is not None, name, value, "--model with it")
    check(options.asked.model is None or options.goal is None, "--model", options.asked.model, "a sentence, not --goal")
    quiet = options.json
    with counting("loading the planner and the simulator", quiet=quiet):
        from executor.cli.execution import check_seed
        from executor.cli.inputs import domain_in, robot_asked_for
        from executor.rollouts.feasibility import feasible
        from executor.scenes.file import scene_for
        from executor.scenes.validation import require_valid
        from oag import compose
        from oag.planning import NoPlan
        from oag.sizes import Sizing
    check_seed(options.seed)
    asked = options.goal or options.query
    with counting(f"reading the scene {options.scene}", quiet=quiet):
        scene = scene_for(
            asked,
            options.scene,
            robot=robot_asked_for(options.robot, full_size=options.full_size),
            listen=tell_notes,
            domain=domain_in(options.domain),
        )
        tell_warnings(require_valid(scene))
    spending = _spending(options)
    with counting("planning, and proving the plan", quiet=quiet):
        made = _planned(options, scene, Sizing(options.seed, options.keep_sizes), spending)
    head: dict[str, object] = {"query": options.query} if options.goal is None else {"goal": options.goal}
    head |= {} if spending is None else {"usage": spending.to_json()}
    if isinstance(made, NoPlan):
        if quiet:
            print_json({"ok": False, "exit_code": FAILED, **head, "refusal": made.to_json()})
        else:
            say(str(made), style="red")
        return FAILED
    task, report, notes = made
    if not quiet:
        tell_notes(notes)
        if spending is not None:
            tell(f"  {spending.total()}")
        say(report.text(without=_KNOWN if report else ()))
    found, unskilled = None, _without_skill(task)
    if report and not unskilled:
        with counting("going through the plan by geometry, subtask by subtask", quiet=quiet) as on_progress:

            def listen(event: Event) -> None:
                if event.kind == "subtask-start":
                    on_progress(event.subtask, event.subtask_count)

            found = feasible(compose(task, scene=scene), scene, options.seed, listen=listen)
    code = DONE if found else FAILED
    reason = unskilled if report else "the plan is not proved"
    if options.json:
        head = {"ok": code == DONE, "exit_code": code, **head, "notes": list(notes)}
        plan: dict[str, object] = {"plan": task.to_json(), "feasibility": None if found is None else found.to_json()}
        plan |= {} if found is not None else {"not_asked": reason}
        print_json({**head, **report.to_json(), **plan})
    elif found is None:
        tell(f"\nwhether it is feasible was not asked, since {reason}", style="yellow")
    else:
        _print_feasibility(found)
    return code


def _without_skill(task: Task) -> str:
    """Return why the robot cannot carry out a plan in an own domain; empty where it has a skill for each primitive."""
    from executor.skills.library import MissingSkill, require_skills

    try:
        require_skills(task)
    except MissingSkill as problem:
        return str(problem)
    return ""


def _spending(options: Options) -> Spending | None:
    """Return the typed model with its usage, None without one; nothing is sent yet."""
    if options.asked.model is None:
        return None
    from executor.cli.evolution_setup import connect_model, spending_of
    from executor.cli.inputs import refuse_existing

    if options.record is not None:
        refuse_existing(options.record, force=False, option="--record")
    return spending_of(connect_model(options.asked, options.record), quiet=options.json)


def _proposed_by_model(options: Options, scene: Scene, sizing: Sizing, spending: Spending) -> Proposal:
    from executor.cli.evolution_setup import report_spending_on_error
    from llm import ModelProposer

    proposer = ModelProposer(spending.model, name=options.asked.model or "", sizing=sizing, listen=spending.add_round)
    with report_spending_on_error(spending, quiet=options.json):
        return proposer.propose(options.query, scene)


def _planned(
    options: Options, scene: Scene, sizing: Sizing, spending: Spending | None
) -> tuple[Task, Report, tuple[str, ...]] | NoPlan:
    """Return the plan of a sentence or a goal with its report and notes, or why a goal has none."""
    from llm import propose
    from oag import compose, plan
    from oag.planning import NoPlan
    from oag.sizes import planned_resizings

    if options.goal is None:
        proposal = (
            propose(options.query, scene, sizing=sizing)
            if spending is None
            else _proposed_by_model(options, scene, sizing, spending)
        )
        graph = compose(proposal.task, scene=scene)
        return graph.task, graph.verify(), proposal.notes
    made = plan(scene, options.goal, sizing=sizing)
    if made.task is None or made.report is None:
        return made.refusal or NoPlan("no-plan", "none was found")
    names = [f"T{number} {subtask.name}" for number, subtask in enumerate(made.task.subtasks, 1)]
    sizes = map(str, planned_resizings(made.task.scales, scene))
    return made.task, made.report, (f"the plan is {', '.join(names) or 'to do nothing'}", *sizes)


def _print_feasibility(found: Feasibility) -> None:
    done = sum(subtask.record.succeeded for subtask in found.subtasks)
    words, style = ("FEASIBLE", "green") if found else ("INFEASIBLE" if found.decided else "NO ANSWER", "red")
    say(f"\n{words}  {done} of {pluralize(len(found.task.subtasks), 'subtask')}, by geometry", style=style)
    for subtask in found.subtasks:
        good = subtask.record.succeeded
        say(f"  {'✓' if good else '✗'} {subtask if good else found.reason}", style=None if good else "red")
    for detour in found.detours:
        say(f"  note: {detour.reason}", style="yellow")
