"""`scene2demo tasks`: list what can be done in a scene, proved, and on request by geometry.

Exit code 0 when the scene admits anything, with --feasible when anything is feasible; else 1.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, check
from executor.cli.options import READ_SCENE, CommonOptions, Flag, FullSize, KeepSizes, Maybe, RobotName
from executor.cli.output import OUT, counting, print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from oag.planning import NoPlan
    from oag.wish_list import AdmittedTask, Wish

Kind = Literal[
    "open", "close", "pick", "take-out", "put-into", "put-onto", "fill", "stack", "all", "empty",
    "switch-on", "switch-off", "stand-up",
]  # fmt: skip


@dataclass(frozen=True)
class Options(CommonOptions):
    """List every wish that a scene admits, by kind, each with a sentence that is understood and a proved plan.

    Wishes appear as soon as they are proved. `generate --all-tasks` makes demonstrations of all that are feasible.
    """

    scene: tyro.conf.Positional[Annotated[str, READ_SCENE]]
    """Name of a scene, or a scene's JSON file."""
    kind: Annotated[tuple[Kind, ...], tyro.conf.arg(metavar="KIND...", help_behavior_hint="(default: every kind)")] = ()
    """Which kinds of wishes: open, close, pick, take-out, put-into, put-onto, fill (put into an item), stack (onto an
    item), all (of a kind), empty (all that is at a place), switch-on, switch-off, stand-up."""
    feasible: Flag = False
    """Also go through each plan by geometry, as `plan` does, in the scene as it is written."""
    limit_s: float = 20.0
    """With --feasible: CPU seconds after which a plan is left without an answer."""
    most: Maybe[int] = None
    """Most wishes to list."""
    out: Maybe[Path] = None
    """With --feasible: file for the answers, a line of JSON each; the same command goes on where it ended."""
    seed: int = 0
    """With --feasible: seeds the planning."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    robot: RobotName = None


def execute(options: Options) -> int:
    """Print each wish as soon as it is proved, and a table of how many there are by kind."""
    check(options.most is None or options.most >= 1, "--most", options.most, "at least 1")
    check(options.out is None or options.feasible, "--out", options.out, "--feasible as well")
    quiet = options.json
    with counting("loading the planner", quiet=quiet):
        from executor.campaign.versions import scene_version
        from executor.cli.execution import check_seed, check_unit_limit
        from executor.cli.inputs import robot_asked_for
        from executor.scenes.file import scene_for
        from executor.scenes.validation import require_valid
        from llm import tasks
        from oag.sizes import Sizing
        from oag.wish_list import KINDS
    check_seed(options.seed)
    check_unit_limit(options.limit_s)
    scene = scene_for(
        "", options.scene, robot=robot_asked_for(options.robot, full_size=options.full_size), listen=tell_notes
    )
    tell_warnings(require_valid(scene))
    refused: list[tuple[Wish, NoPlan]] = []
    found = tasks(
        scene,
        options.kind or KINDS,
        sizing=Sizing(options.seed, options.keep_sizes),
        on_refusal=lambda wish, why: refused.append((wish, why)),
    )
    listing = _FeasibleTasks(quiet)
    if options.feasible:
        from executor.rollouts.admitted import Answers

        answers = Answers(options.out, scene, options.seed, scene_version(scene.robot.model.keeps_order))
        for answer in answers.of(islice(found, options.most), options.limit_s):
            listing.add(answer.found, answer.feasible, answer.reason, asked=True)
    else:
        for each in islice(found, options.most):
            listing.add(each)
    code = DONE if (listing.counts["feasible"] if options.feasible else listing.rows) else FAILED
    reasons = Counter(why.problem for _, why in refused)
    if quiet:
        without = [{"kind": w.kind, "wish": str(w), "reason": why.to_json()} for w, why in refused]
        print_json({"ok": code == DONE, "exit_code": code, "tasks": listing.rows, "refused": without})
        return code
    listing.print_table()
    for reason, count in reasons.most_common(5):
        tell(f"  without a plan {count} x: {reason}", style="yellow")
    return code


class _FeasibleTasks:
    """The wishes so far, shown as they come."""

    def __init__(self, quiet: bool) -> None:
        self.quiet, self.rows, self.counts = quiet, list[dict[str, object]](), Counter[str]()
        self._by_kind: dict[str, Counter[str]] = {}

    def add(self, found: AdmittedTask, feasible: bool | None = None, reason: str = "", *, asked: bool = False) -> None:
        """Show one wish, below the heading of its kind."""
        answer = {"feasible": feasible, "reason": reason} if asked else {}
        self.rows.append({**found.to_json(), **answer})
        word = {True: "feasible", False: "infeasible", None: "no answer"}[feasible] if asked else ""
        if found.wish.kind not in self._by_kind:
            self._by_kind[found.wish.kind] = Counter()
            if not self.quiet:
                say(found.wish.kind, style="bold")
        self._by_kind[found.wish.kind].update(["proved", word])
        self.counts.update(["proved", word])
        if not self.quiet:
            style = {True: "green", False: "red", None: "yellow"}[feasible] if asked else None
            steps = pluralize(len(found.task.subtasks), "subtask")
            note = f"  {word}{f': {reason}' if reason else ''}" if asked else ""
            say(f"  {found.sentence:50} {steps:>11}{note}", style=style)

    def print_table(self) -> None:
        """Print how many wishes there are by kind."""
        from rich.box import SIMPLE_HEAD
        from rich.table import Table

        words = ["proved", *(word for word in ("feasible", "infeasible", "no answer") if self.counts[word])]
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        table.add_column("kind")
        for word in words:
            table.add_column(word, justify="right")
        for kind, counts in self._by_kind.items():
            table.add_row(kind, *(str(counts[word]) for word in words))
        table.add_row("all kinds", *(str(self.counts[word]) for word in words), style="bold")
        OUT.print(table)
