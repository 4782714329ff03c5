"""T7: how far each wish gets (understood, proved, feasible, succeeded), and whether a refusal has a true reason.

Labels say of some seeds whether their wish is possible, and which reasons for a refusal are true. Rates of refusals
rest on them alone. Every interval is exact (Clopper and Pearson); without labels all wishes count as one group.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from statistics import median
from typing import Any

import numpy as np

import bddl
import llm
from executor.campaign.planning_model import ANSWERS_REFUSED, Plan, model_failure, plan_offline, planned_by
from executor.campaign.rate import Rate
from executor.rollouts.feasibility import feasible
from executor.rollouts.rollout import rollout
from executor.rollouts.run_record import describe_rollout
from executor.scenes.generators import any_task
from executor.scenes.generators.any_task import AnyWish
from executor.scenes.pair import NotDrawn
from oag import ObjectActionGraph, compose
from oag.sizes import Sizing

Result = Mapping[str, Any]

_OWN_SIZES = Sizing(keep=True)
STAGES = ("read", "proof", "geometry", "physics")
"""Where a wish ends: not understood or refused by the reader, not proved, not feasible, or executed."""
# Label's reason -> codes of refusals and kinds of failures that state it.
_STATED: Mapping[str, frozenset[str]] = {
    "ambiguous": frozenset(("ambiguous-object", "ambiguous-reading", "several-objects")),
    "not-there": frozenset(("unknown-object", "wrong-place")),
    "no-such-part": frozenset(("unknown-object", "affordance", "no-such-part")),
    "too-wide": frozenset(("too-large", "too-wide-for-gripper")),
    "too-large": frozenset(("affordance", "too-large", "unreachable", "no-collision-free-path")),
    "no-opening": frozenset(("affordance",)),
    "no-support": frozenset(("affordance",)),
    "already-so": frozenset(("already-so",)),
    "other-skill": frozenset(("unknown-action", "unsupported-relation")),
    "moves-furniture": frozenset(("unknown-action", "affordance")),
}


@dataclass(frozen=True, slots=True)
class Label:
    """What a person says of a wish; `data/t7_labels.toml` has the meaning of each field."""

    seed: int
    half: str
    query: str
    possible: str
    reasons: tuple[str, ...]


@cache
def labels() -> Mapping[int, Label]:
    """Return the labels by seed."""
    text = resources.files(any_task.__package__).joinpath("data", "t7_labels.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["wish"]
    known = (Label(r["seed"], r["half"], r["query"], r["possible"], tuple(r.get("reasons", ()))) for r in rows)
    return {label.seed: label for label in known}


def run_wish(seed: int, plan: Plan = plan_offline) -> dict[str, Any]:
    """Draw a wish, and do as much of it as can be done: read, prove, ask geometry, execute.

    Args:
        seed: Seed of the wish; it seeds the planning too.
        plan: What reads and plans it.

    Returns:
        The result as plain data; `ended` is "refused" when nothing moved.
    """
    try:
        wish = any_task.draw(seed)
    except NotDrawn as problem:
        return {"ended": "not-drawn", "failure": {"kind": "not-drawn", "message": str(problem)}}
    return pursue(wish, plan)


def pursue(wish: AnyWish, plan: Plan = plan_offline) -> dict[str, Any]:
    """Do as much of a wish as can be done, and return the result as plain data, as `run_wish` does."""
    began = time.process_time()
    known = {"kind": wish.kind, "query": wish.query, "scene": wish.scene.name, **_label_of(wish)}
    found = known | _pursued(wish, plan) | planned_by(plan)
    return {**found, "cpu_s": round(time.process_time() - began, 2)}


def _label_of(wish: AnyWish) -> dict[str, Any]:
    label = labels().get(wish.seed)
    if label is None or label.query != wish.query:
        # A generator that has changed draws other wishes, of which the labels say nothing.
        return {"possible": None, "reasons": []}
    return {"possible": label.possible, "reasons": list(label.reasons)}


def _pursued(wish: AnyWish, plan: Plan) -> dict[str, Any]:
    try:
        task = plan(wish.query, wish.scene, _OWN_SIZES)
    except llm.QueryError as refusal:
        return _refused("proof" if refusal.code == "unproved" else "read", refusal.code, refusal.problem)
    except llm.AnswersRefused as refusal:
        return _refused("read", ANSWERS_REFUSED, str(refusal))
    except llm.ModelError as problem:
        return model_failure(problem)
    graph = compose(task, scene=wish.scene)
    names = [subtask.name for subtask in graph.task.subtasks]
    found: dict[str, Any] = {"subtask_names": names, "understood": _as_meant(graph, wish)}
    if not (report := graph.verify()):
        return found | _refused("proof", "unproved", report.verdict.value)
    answer = feasible(graph, wish.scene, wish.seed, vary=False)
    if answer.failure is not None:
        return found | _refused("geometry", answer.failure.kind.value, answer.reason)
    planned = compose(answer.task, scene=wish.scene)
    found |= {"subtask_names": [subtask.name for subtask in planned.task.subtasks], "repairs": len(answer.detours)}
    done = rollout(planned, wish.scene, wish.seed, vary=False, conditions=answer.conditions())
    return found | _ended_at("physics") | describe_rollout(done)


def _refused(stage: str, code: str, message: str) -> dict[str, Any]:
    return {"ended": "refused", **_ended_at(stage), "failure": {"kind": code, "message": message}}


def _ended_at(stage: str) -> dict[str, Any]:
    return {"stage": stage, "proved": STAGES.index(stage) > STAGES.index("proof")}


def _as_meant(graph: ObjectActionGraph, wish: AnyWish) -> bool:
    """Decide whether the goal asks for what is meant, as far as goals can say it."""
    meant = bddl.And((graph.task.goal, *(literal.formula for literal in wish.meant)))
    return bool(bddl.equivalent(graph.task.goal, meant, wish.scene.categories))


def wish_rows(results: Sequence[Result]) -> Iterator[tuple[str, str]]:
    """Yield names and values of the table of T7, for the terminal and for the report."""
    drawn = [result for result in results if result["ended"] != "not-drawn"]
    able = [result for result in drawn if _possible(result) == "yes"]
    unable = [result for result in drawn if _possible(result) == "no"]
    counted = able or [result for result in drawn if _possible(result) is None]
    yield "wishes", f"{len(drawn)}: {len(able)} possible, {len(unable)} impossible, others without a label or unsure"
    for name, holds in _LEVELS.items():
        yield f"{name}, of the possible", _share(counted, holds)
    for kind in dict.fromkeys(result["kind"] for result in counted if "kind" in result):
        yield f"  {kind}", _levels([result for result in counted if result.get("kind") == kind])
    lengths = sorted({len(result["subtask_names"]) for result in counted if result.get("subtask_names")})
    for length in lengths:
        own = [result for result in counted if len(result.get("subtask_names", ())) == length]
        yield f"  of {length} subtask{'s' if length > 1 else ''}", _levels(own)
    yield "refused, of the impossible", _share(unable, lambda result: result["ended"] == "refused")
    yield "with a true reason", _share(unable, has_true_reason)
    moved = [result for result in drawn if result.get("stage") == "physics"]
    yield "failed after motion, of the started", _share(moved, lambda result: result["ended"] == "failed")
    cpu_s = [result["cpu_s"] for result in drawn if "cpu_s" in result]
    if cpu_s:
        yield "CPU time of a wish", f"median {median(cpu_s):.1f} s, 90th percentile {np.quantile(cpu_s, 0.9):.1f} s"


def _possible(result: Result) -> str | None:
    """Return the label of a wish, also of one whose process was ended before it gave a result."""
    label = labels().get(result.get("seed", -1))
    return result.get("possible", None if label is None else label.possible)


def has_true_reason(result: Result) -> bool:
    """Decide whether a wish was refused before anything moved, for a reason that its label gives."""
    code = (result.get("failure") or {}).get("kind")
    return result["ended"] == "refused" and any(code in _STATED[reason] for reason in result.get("reasons", ()))


def _reached(stage: str) -> Callable[[Result], bool]:
    level = STAGES.index(stage)
    return lambda result: STAGES.index(result.get("stage", "read")) >= level and result.get("understood", False)


_LEVELS: Mapping[str, Callable[[Result], bool]] = {
    "understood": lambda result: result.get("understood", False),
    "proved": _reached("geometry"),
    "feasible": _reached("physics"),
    "succeeded": lambda result: result["ended"] == "succeeded" and result.get("understood", False),
}


def _share(results: Sequence[Result], holds: Callable[[Result], bool]) -> str:
    return str(Rate(sum(map(holds, results)), len(results)))


def _levels(results: Sequence[Result]) -> str:
    return ", ".join([f"{sum(map(holds, results))} {name}" for name, holds in _LEVELS.items()]) + f" of {len(results)}"
