"""What the graph's checks and its feedback are worth, with answers that a model really wrote.

    python -m benchmarks.feedback record FOLDER --model local:FILE.gguf [--seeds 0,1,2] [--most-s 1200]
    python -m benchmarks.feedback table FOLDER... [--execute]

`record` asks the model for the 40 queries of `feedback_queries.toml`, in an order drawn once, until the time is used
up, and keeps each query's exchanges in a file: one with feedback of up to three rounds, one unconstrained, without a
schema and without checks. `table` asks nobody: an attempt with fewer rounds is the beginning of the recorded one, so
each way is a replay; where it goes on otherwise, there is no plan, and the row counts it as "not recorded". With
--execute plans are run in physics: unconstrained ones as they are, the others if they are proved.

Ways: `unconstrained` (the first readable answers, executed as they are), `checked` (first answers, only proved plans
run), `feedback 1` and `feedback 3` (so many rounds for each module, and returns of the plan). "As asked" compares the
plan's goal with the offline planner's. Forms count different decompositions of a query over the seeds.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import bddl
import llm
from bddl.errors import Scene2DemoError
from benchmarks.baselines.methods import UncheckedRun
from executor.campaign.rate import Rate
from executor.scenes.file import load_scene
from llm.client.connect import connect
from llm.client.transport import ChatReply, ChatRequest, Transport
from llm.errors import ReplayMissing
from llm.proposing.model_proposer import Draft
from llm.proposing.session import ModuleSession
from llm.structured.ask import Log
from llm.structured.conversation import Conversation
from oag import Scene, SceneError, Task, Verdict, compose
from oag.normal_form import canonical

QUERIES = Path(__file__).with_name("feedback_queries.toml")
FREE, BOUND = "unconstrained", "constrained"
WAYS = {FREE: 0, "checked": 0, "feedback 1": 1, "feedback 3": 3}


@dataclass(frozen=True)
class Unconstrained:
    """Forward requests without their schema."""

    transport: Transport

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the transport's reply."""
        return self.transport.complete(replace(request, json_schema=None, mode="plain"))


class Unchecked(ModuleSession):
    """Take the first readable answer to each question."""

    def ask(self, module, schema, check, places, images=(), *, about=None, **_):  # type: ignore[no-untyped-def]
        """Return a module's answer, whatever it says."""
        return super().ask(module, schema, lambda _: (), places, images, about=about)


@dataclass
class Outcome:
    """What became of one query by one way."""

    verdict: str = "none"
    as_asked: bool = False
    succeeded: bool = False
    simulated_s: float = 0.0
    requests: int = 0
    tokens: int = 0
    form: str = ""


def queries() -> list[tuple[str, str]]:
    """Return (scene, query) in the order in which they are asked: drawn once, so that any beginning is a sample."""
    listed = [(scene, query) for scene, asked in tomllib.loads(QUERIES.read_text()).items() for query in asked]
    random.Random("feedback").shuffle(listed)
    return listed


def draft(transport: Transport, query: str, scene: Scene) -> Task:
    """Return the task of the first answers; raises AnswersRefused where one cannot be read."""
    session = Unchecked(transport, query, scene, Log(Conversation("model", query, scene.name)), 1)
    made = Draft().with_roles(session, None).with_conditions(session).with_flows(session)
    return made.task(session, searched=False)


def attempt(transport: Transport, way: str, query: str, scene: Scene) -> Task | None:
    """Return the task that a model proposes by one of the ways; None without one."""
    rounds = WAYS[way]
    # Answers that nobody has checked name what is not there, in formulas that nobody can read.
    with suppress(llm.AnswersRefused, llm.QueryError, bddl.BDDLError, SceneError, ValueError, LookupError):
        if way == FREE:
            return draft(Unconstrained(transport), query, scene)
        proposer = llm.ModelProposer(transport, rounds=rounds + 1, revisions=rounds, cross_check=False)
        return proposer.propose(query, scene).task
    return None


def record(folder: Path, model: str, seeds: list[int], most_s: float) -> None:
    """Record both conversations of each query, until the time is used up; files that exist are kept."""
    ends, scenes = time.monotonic() + most_s, dict[str, Scene]()
    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        for number, (name, query) in enumerate(queries()):
            for way in (BOUND, FREE):
                file = folder / f"{number:02d}-{seed}-{way}.jsonl"
                if file.exists():
                    continue
                if time.monotonic() > ends:
                    return
                scenes.setdefault(name, load_scene(name))
                begun = file.with_suffix(".begun")
                begun.unlink(missing_ok=True)
                asked = connect(model, record=begun, seed=seed)
                task = attempt(asked, FREE if way == FREE else "feedback 3", query, scenes[name])
                begun.rename(file)
                verdict = "no plan" if task is None else compose(task, scene=scenes[name]).verify().verdict.value
                print(f"{file.name}: {name}, {query!r}: {verdict}, {asked.usage.summary()}", flush=True)


class Counted:
    """Count the requests and tokens of a replay."""

    def __init__(self, file: Path, seed: int) -> None:
        self.transport = connect(f"replay:{file}", seed=seed)

    def outcome(self, way: str, query: str, scene: Scene, goal: bddl.Formula | None, *, execute: bool) -> Outcome:
        """Return what becomes of a query by one way; without a goal it is one that cannot be done."""
        try:
            task = attempt(self.transport, way, query, scene)
        except ReplayMissing:
            task, missing = None, True
        else:
            missing = False
        usage = self.transport.usage
        found = Outcome("not recorded" if missing else "none", requests=usage.requests, tokens=usage.tokens)
        if task is None:
            return found
        graph = compose(task, scene=scene)
        found.verdict = graph.verify().verdict.value
        found.form = json.dumps([(part.target, str(part.goal)) for part in canonical(task).subtasks])
        # A goal that nobody has checked may name what is not there.
        with suppress(bddl.BDDLError):
            found.as_asked = goal is not None and bool(bddl.equivalent(task.goal, goal, scene.categories))
        if execute and goal is not None and (way == FREE or found.verdict == Verdict.PROVED.value):
            asked = replace(task, goal=goal)
            world = scene.with_scales(task.scales)
            # Sizes that nobody has checked may be none that a model has, and a scene of them may not stand.
            with suppress(Scene2DemoError):
                done = UncheckedRun(compose(asked, scene=world), world, 0).from_start()
                found.succeeded, found.simulated_s = done.succeeded, done.simulated_s
        return found


@dataclass
class Column:
    """Outcomes of one model by one way."""

    outcomes: list[Outcome] = field(default_factory=list)
    forms: defaultdict[int, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def row(self, title: str, *, execute: bool) -> str:
        """Return the row of a table."""
        n = len(self.outcomes)
        proved = sum(one.verdict == "PROVED" for one in self.outcomes)
        meant = sum(one.verdict == "PROVED" and one.as_asked for one in self.outcomes)
        done = sum(one.succeeded for one in self.outcomes)
        wasted = sum(one.simulated_s for one in self.outcomes if not one.succeeded)
        lost = sum(one.verdict == "not recorded" for one in self.outcomes)
        cells = [f"{n}, {lost} not recorded" if lost else str(n), *(_share(count, n) for count in (proved, meant))]
        cells += [_share(done, n), f"{wasted:.0f}"] if execute else ["-", "-"]
        cells += [f"{sum(one.requests for one in self.outcomes) / n:.1f}"]
        cells += [f"{sum(one.tokens for one in self.outcomes) / n:.0f}"]
        repeated = [forms for forms in self.forms.values() if sum(forms.values()) > 1]
        cells += [f"{sum(map(len, repeated)) / len(repeated):.1f} of {len(repeated)}" if repeated else "-"]
        return f"| {title} | " + " | ".join(cells) + " |"


def _share(count: int, n: int) -> str:
    low, high = Rate(count, n).interval_percent or (0.0, 0.0)
    return f"{count} ({low:.0f} to {high:.0f} %)"


def table(folders: list[Path], *, execute: bool) -> Iterator[str]:
    """Yield the rows: a model and a way each."""
    yield "| model, way | runs | proved | proved, as asked | succeeded | wasted s | requests | tokens | forms a query |"
    yield "|---|---|---|---|---|---|---|---|---|"
    listed, scenes, goals = queries(), dict[str, Scene](), dict[int, bddl.Formula | None]()
    for folder in folders:
        columns = {way: Column() for way in WAYS}
        for file in sorted(folder.glob(f"*-{BOUND}.jsonl")):
            number, seed = map(int, file.stem.split("-")[:2])
            free = file.with_name(f"{number:02d}-{seed}-{FREE}.jsonl")
            if not free.exists():
                continue
            name, query = listed[number]
            scene = scenes.setdefault(name, load_scene(name))
            if number not in goals:
                goals[number] = None
                with suppress(llm.QueryError):
                    goals[number] = llm.propose(query, scene).task.goal
            for way, column in columns.items():
                replayed = Counted(free if way == FREE else file, seed)
                found = replayed.outcome(way, query, scene, goals[number], execute=execute)
                column.outcomes.append(found)
                column.forms[number][found.form] += 1
        for way, column in columns.items():
            if column.outcomes:
                yield column.row(f"{folder.name}, {way}", execute=execute)
        answers = sum(len(file.read_text().splitlines()) for file in folder.glob("*.jsonl"))
        yield f"\n{folder.name}: {answers} recorded answers\n"


def main() -> int:
    """Record, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("record", "table"))
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--model", default="", help="the model to record, such as local:FILE.gguf")
    parser.add_argument("--seeds", default="0", help="seeds of the model, with commas")
    parser.add_argument("--most-s", type=float, default=1200.0, help="when no further query is begun [s]")
    parser.add_argument("--execute", action="store_true", help="run the plans in physics")
    options = parser.parse_args()
    if options.what == "record":
        if not options.model or len(options.folders) != 1:
            parser.error("record needs one folder and --model")
        try:
            connect(options.model)
            seeds = [int(seed) for seed in options.seeds.split(",")]
        except (Scene2DemoError, ValueError) as problem:
            parser.error(str(problem))
        record(options.folders[0], options.model, seeds, options.most_s)
        return 0
    if missing := [str(folder) for folder in options.folders if not folder.is_dir()]:
        parser.error(f"no folder: {', '.join(missing)}; `record` makes them")
    for line in table(options.folders, execute=options.execute):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
