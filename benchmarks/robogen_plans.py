"""What `verify` makes of the decompositions that RoboGen recorded of its language model.

    python -m benchmarks.robogen_plans DIR

DIR is a checkout of RoboGen; its `example_tasks` have a scene (YAML) and a decomposition (`substeps.txt`) each. Nothing
of it is executed. Their sentences are read by verb: grasp, approach, release; open, pull out, close; put or move into,
move out of. The words say which object is meant: the scene's fixture, or an item. A decomposition with any other step
(turn, press, rotate, tilt ...) says what these predicates cannot, and counts as outside the language.

Each is read twice. "As written": a hand lets go only where a step says so. "As its code does": grasping first lets go
of what is held, as RoboGen's `grasp_object` does. The task goal is read off the steps, so that a step that was left out
from the beginning cannot be seen.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

import oag
from oag.model.symbols import Kind, kind_of

TAKE, LIFT = [17, 1, 2, 3], {"7": None}
LET_GO: list[Any] = [5, 6]
_STEP = re.compile(
    r"(?P<verb>grasp|approach|release|open|partially open|pull|close|put|move|place) (?P<what>.+?)"
    r"(?: (?P<where>into|out of) (?P<there>.+)| (?P<out>out))?$"
)


class OutsideTheLanguage(ValueError):
    """A step says what the predicates cannot; the text is its verb."""


@dataclass(frozen=True)
class Recorded:
    """One recorded decomposition.

    Attributes:
        name: Of its folder.
        steps: Its sentences, in order.
        scene: The scene that its configuration describes, as a scene file says it.
        fixture: Id of the one thing with joints.
        items: Ids of the things that can be taken.
    """

    name: str
    steps: tuple[str, ...]
    scene: dict[str, Any]
    fixture: str
    items: tuple[str, ...]


def recorded(checkout: Path) -> Iterator[Recorded]:
    """Yield the recorded decompositions of a checkout, in the order of their names."""
    for substeps in sorted(checkout.glob("example_tasks/*/task_*/substeps.txt")):
        folder = substeps.parents[1]
        steps = tuple(line.strip() for line in substeps.read_text(encoding="utf-8").splitlines() if line.strip())
        configurations = (yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.yaml")))
        found = next(c for c in configurations if any("task_description" in part for part in c))
        yield _described(folder.name, steps, found)


def _described(name: str, steps: tuple[str, ...], parts: list[dict[str, Any]]) -> Recorded:
    said = {key: value for part in parts if "name" not in part for key, value in part.items()}
    table = "table_0" if said.get("use_table") else "floor_0"
    objects: dict[str, Any] = {table: {"category": table.removesuffix("_0"), "bbox_extent": [1.5, 1.5, 0.4]}}
    items, fixture = [], ""
    relations = [[word.strip() for word in text.split(",")] for text in said.get("spatial_relationships") or ()]
    inside = {_id(words[1]) for words in relations if words[0] == "in"}
    for part in (part for part in parts if "name" in part):
        key, side_m = _id(part["name"]), float(part.get("size", 0.1))
        if part.get("type") == "urdf":
            category = key.removesuffix("_0")
            known = kind_of(category, side_m) is Kind.ARTICULATED
            objects[key] = {"category": category if known else "cabinet", "bbox_extent": [side_m, side_m, side_m]}
            fixture = fixture or key
        else:
            objects[key] = {"category": key.removesuffix("_0"), "bbox_extent": [0.05, 0.05, 0.1]}
            items.append(key)
    joints = [value for key, value in said.items() if key.startswith("joint_")]
    is_open = any(str(value) not in ("0", "0.0") for value in joints)
    facts = [f"(inside {item} {fixture})" if item in inside else f"(ontop {item} {table})" for item in items]
    facts.append(f"(open {fixture})" if is_open else f"(not (open {fixture}))")
    scene = {"name": name, "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
    return Recorded(name, steps, scene, fixture, tuple(items))


def _id(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])|\s+", "_", name.strip()).lower() + "_0"


def as_task(plan: Recorded, *, grasping_lets_go: bool) -> dict[str, Any]:
    """Return a decomposition as a task file.

    Args:
        plan: As recorded.
        grasping_lets_go: Whether a grasp first lets go of what is held.

    Raises:
        OutsideTheLanguage: A step cannot be said.
    """
    subtasks: list[dict[str, Any]] = []
    rests = {item: fact for item in plan.items for fact in plan.scene["facts"] if f" {item} " in fact}
    for sentence in plan.steps:
        found = _STEP.match(sentence)
        if found is None or (found["verb"] == "pull" and not found["out"]):
            raise OutsideTheLanguage(sentence.split()[0])
        target, verb = _meant(found["what"], plan), found["verb"]
        holding = bool(subtasks) and subtasks[-1]["flow"][-2:] != LET_GO
        if verb in ("grasp", "approach"):
            if grasping_lets_go and holding and subtasks[-1]["flow"] != TAKE:
                subtasks[-1]["flow"] += LET_GO
            if not (subtasks and subtasks[-1]["target"] == target and subtasks[-1]["flow"] == TAKE):
                subtasks.append(_subtask(target, "(and)", "(and)", [*TAKE]))
        elif verb == "release":
            if holding:
                subtasks[-1]["flow"] += LET_GO
        else:
            _complete(subtasks, plan, rests, target, verb, found["where"])
    return {"task_activity_name": plan.name, "sub_tasks": subtasks}


def _complete(
    subtasks: list[dict[str, Any]], plan: Recorded, rests: dict[str, str], target: str, verb: str, where: str | None
) -> None:
    """Add to the grasp before it what a step is for; without one, the step stands alone."""
    taken = bool(subtasks) and subtasks[-1]["target"] == target and subtasks[-1]["flow"] == TAKE
    subtask = subtasks.pop() if taken else _subtask(target, "(and)", "(and)", [])
    is_open = f"(open {plan.fixture})"
    if target == plan.fixture and verb in ("open", "partially open", "pull", "close"):
        # One predicate for all doors of a thing: a second one is opened where it holds already.
        opens = verb != "close"
        goal = is_open if opens else f"(not {is_open})"
        subtasks.append(subtask | {"goal": goal, "flow": [*subtask["flow"], {"4" if opens else "19": None}]})
    elif target in plan.items and where is not None:
        before, support = rests[target], rests[target].split()[-1].rstrip(")")
        taking = subtask | {"support_init": support, "init": before, "goal": f"(not {before})"}
        if where == "out of":
            subtasks.append(taking | {"flow": [*subtask["flow"], LIFT, 6]})
            return
        subtasks.append(taking | {"flow": [*subtask["flow"], LIFT]})
        held, inside = f"(inside {target} gripper)", f"(inside {target} {plan.fixture})"
        flow = [18, {"13": None}, {"8": None}]
        subtasks.append(_subtask(target, held, inside, flow) | {"support_goal": plan.fixture})
    else:
        raise OutsideTheLanguage(verb)


def _subtask(target: str, init: str, goal: str, flow: list[Any]) -> dict[str, Any]:
    empty = {"support_init": None, "support_goal": None}
    return {"target": target, **empty, "init": init, "goal": goal, "flow": flow}


def _meant(words: str, plan: Recorded) -> str:
    """Return the object that words name: the fixture if it is named, an item if that is, else the fixture."""
    said = "".join(words.lower().split())
    named = [name for name in (plan.fixture, *plan.items) if name.removesuffix("_0").replace("_", "") in said]
    return named[0] if named else plan.fixture


def judged(plan: Recorded, *, grasping_lets_go: bool) -> tuple[str, str, bool]:
    """Return the verdict of a decomposition, what is wrong first, and whether a fix is proved.

    Raises:
        OutsideTheLanguage: A step cannot be said.
    """
    scene = oag.Scene.from_json(plan.scene)
    task = oag.Task.from_json(as_task(plan, grasping_lets_go=grasping_lets_go), scene=scene)
    report = oag.compose(task, scene=scene).verify()
    reason = "" if report else report.errors[0].message if report.errors else "rests on what is unknown"
    return report.verdict.value, reason, bool(report) or any(fix.proves and not fix.assumption for fix in report.fixes)


def main(words: Sequence[str]) -> int:
    """Print what became of each decomposition, and the counts."""
    if len(words) != 1 or not (Path(words[0]) / "example_tasks").is_dir():
        print(
            "usage: python -m benchmarks.robogen_plans DIR, a checkout of RoboGen with example_tasks", file=sys.stderr
        )
        return 2
    plans = list(recorded(Path(words[0])))
    outside: Counter[str] = Counter()
    verdicts: dict[bool, Counter[str]] = {False: Counter(), True: Counter()}
    for plan in plans:
        try:
            both = {code: judged(plan, grasping_lets_go=code) for code in (False, True)}
        except OutsideTheLanguage as step:
            outside[str(step)] += 1
            continue
        for code, (verdict, _, mended) in both.items():
            verdicts[code].update([verdict, *(["with a proved fix"] if mended and verdict != "PROVED" else [])])
        print(f"{plan.name}: {both[False][0]} as written, {both[True][0]} as its code does")
        for reason in dict.fromkeys(reason for _, reason, _ in both.values() if reason):
            print(f"    {reason}")
    print(f"\n{len(plans)} decompositions; {outside.total()} outside the language: {dict(outside.most_common())}")
    for code, counts in verdicts.items():
        print(f"{'as its code does' if code else 'as written'}: {dict(counts.most_common())}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
