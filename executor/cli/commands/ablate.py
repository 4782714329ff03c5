"""`scene2demo ablate views|look-back`: the same episodes with a model that sees more or less of them.

Returns 0 when the table is complete, 1 when the plan is not proved or the model stopped answering, 130 after Ctrl-C,
which leaves a table of the episodes that were finished.
"""

from __future__ import annotations

from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.executing import check_limit, check_seed, refuse, task_to_run
from executor.cli.inputs import refuse_existing
from executor.cli.judging import Judging, chosen_views
from executor.cli.output import print_json, say, tell, tell_notes
from executor.cli.words.running import AblateOptions
from executor.evolution.ablation import AblationRow, AblationSetting, look_back_settings, row_of, table, view_settings
from executor.evolution.record import Evolution
from executor.machine.files import write_json
from executor.pictures.cameras import VIEWS
from llm.answers.conversation import Conversation
from llm.answers.spending import Spending
from oag import ObjectActionGraph, compose
from oag.task.sizes import resizings

SCHEMA = "scene2demo-ablation/1"
FILE = "ablation.json"
BY_CTRL_C = "interrupted"


def execute(options: AblateOptions) -> int:
    """Runs every setting, prints the table, and returns the exit code."""
    check_seed(options.seed, options.episodes)
    if options.judged.model is None:
        raise BadOption("--model", "is missing", "a model: without one nothing is looked at, and nothing can be varied")
    check_limit(options.limit)
    chosen = settings(options, chosen_views(options.judged.views))
    if options.out is not None:
        refuse_existing(options.out / FILE, force=options.force or options.resume)
    task, scene = task_to_run(options.task, options.scene, keep_sizes=options.keep_sizes)
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    if not options.json:
        tell_notes(map(str, resizings(task.scales, scene)))
    rows: list[AblationRow] = []
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    judged_by = Judging(options.judged, options.out, force=options.force, resume=options.resume, quiet=options.json)
    with judged_by as judging:
        for setting in chosen:
            rows.append(_row(options, setting, graph, judging))
            if not options.json:
                tell(f"{setting.letters}, {setting.look_back} back: {rows[-1].after} of {rows[-1].trials} succeeded")
            if rows[-1].stopped:
                break
    kept = [row for row in rows if row.trials or row.stopped != BY_CTRL_C]
    return _finish(options, kept, rows[-1].stopped, judging.spending)


def settings(options: AblateOptions, views: tuple[str, ...]) -> tuple[AblationSetting, ...]:
    """Returns the settings that a command compares.

    Raises:
        BadOption: There are no views to look back with, or views were chosen that are to be varied.
    """
    if options.what == "views":
        if views != VIEWS:
            raise BadOption("--views", options.judged.views, "all three, since their subsets are compared")
        return view_settings(options.judged.look_back)
    if not views:
        raise BadOption("--views", options.judged.views, "at least one view to look back with")
    return look_back_settings(views)


def _row(options: AblateOptions, setting: AblationSetting, graph: ObjectActionGraph, judging: Judging) -> AblationRow:
    """Runs the episodes of a setting; Ctrl-C, too, leaves those that were finished."""
    episodes: list[tuple[Evolution, Conversation]] = []
    stopped = ""
    try:
        for seed in range(options.seed, options.seed + options.episodes):
            evolution = judging.evolve(
                graph, views=setting.views, look_back=setting.look_back, learn=False, seed=seed, limit=options.limit
            )
            team = judging.teams[-1]
            episodes.append((evolution, team.conversation))
            stopped = team.stopped
            if stopped:
                break
    except KeyboardInterrupt:
        stopped = BY_CTRL_C
    return row_of(setting, episodes, stopped)


def _finish(options: AblateOptions, rows: list[AblationRow], stopped: str, spending: Spending | None) -> int:
    """Writes and prints the table.

    Args:
        options: What was typed.
        rows: Settings with at least one episode, or that the model did not answer.
        stopped: Why nothing more was run; empty when everything was.
        spending: What the model took.
    """
    interrupted = stopped == BY_CTRL_C
    code = INTERRUPTED if interrupted else FAILED if stopped else DONE
    data: dict[str, object] = {
        "schema": SCHEMA,
        "what": options.what,
        "model": options.judged.model,
        "seed": options.seed,
        "episodes": options.episodes,
        "measurements": options.judged.measurements,
        "rows": [row.to_json() for row in rows],
        "usage": None if spending is None else spending.to_json(),
    }
    if options.out is not None and rows:
        write_json(options.out / FILE, data)
    if options.json:
        print_json({"ok": not stopped, "exit_code": code, "interrupted": interrupted, **data})
        return code
    if rows:
        say(table(rows))
    if spending is not None:
        say(spending.total())
    if interrupted:
        tell("scene2demo: interrupted; finished episodes are in the table", style="yellow")
    elif stopped:
        tell(f"scene2demo: stopped: {stopped}", style="red")
    if options.out is not None and rows:
        say(f"results in {options.out}")
    return code
