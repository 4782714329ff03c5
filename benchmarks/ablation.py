"""The paper's ablations: the same episodes with a model that gets more or fewer pictures of them.

    python -m benchmarks.ablation views TASK.json --scene SCENE --model MODEL [--episodes 5] [--out FOLDER]
    python -m benchmarks.ablation look-back TASK.json --scene SCENE --model MODEL --views head

Varies the subset of the cameras, or the number of steps to look back. Every setting runs the same scenes and seeds.
Exit code 0 when the table is complete, 1 when the plan is not proved or the model stopped answering, 130 after Ctrl-C,
which leaves a table of the finished episodes.

Source: the paper's ablations over camera views and over p_1.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Literal

import tyro

from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check, explain
from executor.cli.evolution_setup import EvolutionSetup, parse_views
from executor.cli.execution import check_limit, check_seed, refuse, task_to_run
from executor.cli.inputs import refuse_existing
from executor.cli.options import (
    CommonOptions,
    FirstSeed,
    GoOn,
    JudgeOptions,
    KeepSizes,
    Limit,
    Maybe,
    ReplaceResults,
    SceneName,
    TaskToRun,
)
from executor.cli.output import print_json, say, tell, tell_notes
from executor.rollouts.evolution_record import Evolution
from executor.sim.render.cameras import VIEWS
from executor.system.files import write_json
from llm.structured.conversation import Conversation, Spending
from oag import ObjectActionGraph, compose
from oag.measurements import clopper_pearson
from oag.sizes import planned_resizings

LOOK_BACKS = (0, 1, 2)


@dataclass(frozen=True, slots=True)
class AblationSetting:
    """Views and look-back of a model.

    Attributes:
        views: The paper's C.
        look_back: The paper's p_1.
    """

    views: tuple[str, ...]
    look_back: int

    @property
    def letters(self) -> str:
        """The cameras as the paper writes them, such as "G,H,W"."""
        return ",".join(view[0].upper() for view in self.views)


def view_settings(look_back: int) -> tuple[AblationSetting, ...]:
    """Return a setting for each subset of the cameras, the small ones first."""
    subsets = (subset for count in range(1, len(VIEWS) + 1) for subset in combinations(VIEWS, count))
    return tuple(AblationSetting(subset, look_back) for subset in subsets)


def look_back_settings(views: tuple[str, ...]) -> tuple[AblationSetting, ...]:
    """Return a setting for each look-back window."""
    return tuple(AblationSetting(views, look_back) for look_back in LOOK_BACKS)


@dataclass(frozen=True, slots=True)
class AblationRow:
    """Result of one setting.

    Attributes:
        setting: Cameras and look-back.
        trials: Episodes.
        before: How many succeeded without any revision.
        after: How many succeeded in the end.
        revisions: Of the episodes that succeeded, each one's number of revisions.
        questions: Requests to the model.
        input_tokens, output_tokens: As the server counted them.
        latencies_s: How long each reply took.
        stopped: Why the model got no more requests, where that was so.
    """

    setting: AblationSetting
    trials: int
    before: int
    after: int
    revisions: tuple[int, ...]
    questions: int
    input_tokens: int
    output_tokens: int
    latencies_s: tuple[float, ...]
    stopped: str = ""

    @property
    def mean_revisions(self) -> float | None:
        """Mean number of revisions of the episodes that succeeded; None without any."""
        return sum(self.revisions) / len(self.revisions) if self.revisions else None

    @property
    def mean_latency_s(self) -> float | None:
        """Mean time of a reply; None without any."""
        return sum(self.latencies_s) / len(self.latencies_s) if self.latencies_s else None

    def to_json(self) -> dict[str, object]:
        """Return the row as plain data."""
        return {
            "views": list(self.setting.views),
            "look_back": self.setting.look_back,
            "trials": self.trials,
            "successes_before": self.before,
            "successes_after": self.after,
            "interval_95_after": clopper_pearson(self.after, self.trials),
            "revisions": list(self.revisions),
            "revisions_mean": self.mean_revisions,
            "questions": self.questions,
            "input_tokens": self.input_tokens,
            "output_tokens": self.output_tokens,
            "latency_s_mean": self.mean_latency_s,
            "waited_s": sum(self.latencies_s),
            "stopped": self.stopped,
        }


def row_of(
    setting: AblationSetting, episodes: Sequence[tuple[Evolution, Conversation]], stopped: str = ""
) -> AblationRow:
    """Return the result of a setting's episodes.

    Args:
        setting: Cameras and look-back.
        episodes: Each with its conversation; tokens and times are counted from there, so that a replay has those of
            the recorded run.
        stopped: Why the model was asked nothing more.
    """
    evolutions = [evolution for evolution, _ in episodes]
    rounds = [one_round for _, conversation in episodes for one_round in conversation.rounds]
    return AblationRow(
        setting=setting,
        trials=len(evolutions),
        before=sum(evolution.succeeded_at_once for evolution in evolutions),
        after=sum(evolution.succeeded for evolution in evolutions),
        revisions=tuple(evolution.revisions for evolution in evolutions if evolution.succeeded),
        questions=len(rounds),
        input_tokens=sum(one_round.input_tokens or 0 for one_round in rounds),
        output_tokens=sum(one_round.output_tokens or 0 for one_round in rounds),
        latencies_s=tuple(one_round.latency_s for one_round in rounds),
        stopped=stopped,
    )


def table(rows: Sequence[AblationRow]) -> str:
    """Return the rows as a Markdown table, for a terminal and for a page alike."""
    head = ("views", "p1", "success", "at once", "revisions", "questions", "tokens in + out", "s an answer")
    cells = [head, *(_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(head))]
    lines = [f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |" for line in cells]
    rule = f"|{'|'.join('-' * (width + 2) for width in widths)}|"
    return "\n".join((lines[0], rule, *lines[1:]))


def _cells(row: AblationRow) -> tuple[str, ...]:
    revisions, latency = row.mean_revisions, row.mean_latency_s
    return (
        row.setting.letters or "-",
        str(row.setting.look_back),
        f"{row.after}/{row.trials}",
        f"{row.before}/{row.trials}",
        "-" if revisions is None else f"{revisions:.2f}",
        str(row.questions),
        f"{row.input_tokens} + {row.output_tokens}",
        "-" if latency is None else f"{latency:.1f}",
    )


@dataclass(frozen=True)
class AblationOptions(CommonOptions):
    """Compare what a model sees in self-evolution: cameras, or how many steps it looks back. Needs a model.

    Every setting runs the same episodes; the table has success, revisions, tokens and waiting times.
    """

    what: tyro.conf.Positional[Literal["views", "look-back"]]
    """What is varied: the subsets of the three cameras, or 0, 1 and 2 steps back."""
    task: TaskToRun
    scene: SceneName
    seed: FirstSeed = 0
    episodes: int = 1
    """How many episodes to run in each setting."""
    limit: Limit = 5
    keep_sizes: KeepSizes = False
    judged: JudgeOptions = field(default_factory=JudgeOptions)
    out: Maybe[Path] = None
    """Folder for the table, the recording and the pictures."""
    resume: GoOn = False
    force: ReplaceResults = False


SCHEMA = "scene2demo-ablation/1"
FILE = "ablation.json"
BY_CTRL_C = "interrupted"


def execute(options: AblationOptions) -> int:
    """Run every setting, print the table, and return the exit code."""
    check_seed(options.seed, options.episodes)
    if options.judged.model is None:
        raise BadOption("--model", "is missing", "a model: without one nothing is looked at, and nothing can be varied")
    check_limit(options.limit)
    chosen = settings(options, parse_views(options.judged.views))
    if options.out is not None:
        refuse_existing(options.out / FILE, force=options.force or options.resume)
    task, scene = task_to_run(options.task, options.scene, keep_sizes=options.keep_sizes)
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    if not options.json:
        tell_notes(map(str, planned_resizings(task.scales, scene)))
    rows: list[AblationRow] = []
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    judged_by = EvolutionSetup(
        options.judged, options.out, force=options.force, resume=options.resume, quiet=options.json
    )
    with judged_by as judging:
        for setting in chosen:
            rows.append(_row(options, setting, graph, judging))
            if not options.json:
                tell(f"{setting.letters}, {setting.look_back} back: {rows[-1].after} of {rows[-1].trials} succeeded")
            if rows[-1].stopped:
                break
    kept = [row for row in rows if row.trials or row.stopped != BY_CTRL_C]
    return _finish(options, kept, rows[-1].stopped, judging.spending)


def settings(options: AblationOptions, views: tuple[str, ...]) -> tuple[AblationSetting, ...]:
    """Return the settings that a command compares.

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


def _row(
    options: AblationOptions, setting: AblationSetting, graph: ObjectActionGraph, judging: EvolutionSetup
) -> AblationRow:
    """Run the episodes of a setting; Ctrl-C, too, keeps the finished ones."""
    episodes: list[tuple[Evolution, Conversation]] = []
    stopped = ""
    try:
        for seed in range(options.seed, options.seed + options.episodes):
            evolution = judging.evolve(
                graph, views=setting.views, look_back=setting.look_back, seed=seed, limit=options.limit
            )
            team = judging.teams[-1]
            episodes.append((evolution, team.conversation))
            stopped = team.stopped
            if stopped:
                break
    except KeyboardInterrupt:
        stopped = BY_CTRL_C
    return row_of(setting, episodes, stopped)


def _finish(options: AblationOptions, rows: list[AblationRow], stopped: str, spending: Spending | None) -> int:
    """Write and print the table.

    Args:
        options: The typed options.
        rows: Settings with at least one episode, or that the model did not answer.
        stopped: Why nothing more was run; empty when everything was.
        spending: Usage of the model.
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
        tell("ablation: interrupted; finished episodes are in the table", style="yellow")
    elif stopped:
        tell(f"ablation: stopped: {stopped}", style="red")
    if options.out is not None and rows:
        say(f"results in {options.out}")
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one ablation and return the exit code.

    Args:
        arguments: What was typed after the module's name; by default that of this process.
    """
    options = tyro.cli(
        AblationOptions,
        prog="python -m benchmarks.ablation",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.DisallowNone),
    )
    try:
        return execute(options)
    except (Exception, KeyboardInterrupt) as error:
        ending = explain(error)
        if options.debug and not ending.expected:
            raise
        tell(f"ablation: {ending.message}", style="red")
        return ending.code


if __name__ == "__main__":
    sys.exit(main())
