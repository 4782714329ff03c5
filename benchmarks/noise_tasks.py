"""Ten tasks whose decompositions the noise model varies: the paper's T1 to T4 and six others.

Each is a list of blocks: subtasks that belong together (one door, or one thing carried from one place to another),
with the pairs of blocks whose order matters, written down by hand. Every flow begins with a navigation; the noise model
takes the first one away again, as plans do that start from the reset.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bddl

Json = dict[str, Any]
Block = tuple[Json, ...]

_DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
_FURNITURE = (0.7, 0.7, 1.0)
_THING = (0.05, 0.05, 0.1)
# Something goes into a bowl.
_BOWL = (0.14, 0.14, 0.08)


@dataclass(frozen=True)
class BaseTask:
    """A task before any noise.

    Attributes:
        name: For tables.
        scene: Scene file.
        goal: The task goal, as its conjuncts.
        blocks: In one of their orders.
        before: Pairs (i, j): block i has to come before block j.
        scales: Scales of the task.
    """

    name: str
    scene: Json = field(repr=False)
    goal: tuple[str, ...] = field(repr=False)
    blocks: tuple[Block, ...] = field(repr=False)
    before: frozenset[tuple[int, int]] = field(repr=False)
    scales: Json = field(repr=False)

    @property
    def subtasks(self) -> list[Json]:
        """All subtasks in the order of the blocks."""
        return [subtask for block in self.blocks for subtask in block]


def _subtask(target: str, start: str | None, end: str | None, init: str, goal: str, flow: list[Any]) -> Json:
    return {
        "task_activity_name": f"subtask about {target}",
        "task_detail_message": f"Do what is to be done with {target}.",
        "target": target,
        "support_init": start,
        "support_goal": end,
        "init": init,
        "goal": goal,
        "flow": flow,
    }


def opening(fixture: str) -> Block:
    """A door or drawer is opened."""
    is_open = f"(open {fixture})"
    return (_subtask(fixture, None, None, f"(not {is_open})", is_open, [17, 1, 2, 3, {"4": [0.0, 0.7]}, 5, 6]),)


def closing(fixture: str) -> Block:
    """A door or drawer is closed."""
    is_open = f"(open {fixture})"
    return (_subtask(fixture, None, None, is_open, f"(not {is_open})", [17, 1, 2, 3, {"19": [0.0, 0.7]}, 5, 6]),)


def carrying(item: str, rests: str, source: str, relation: str, end: str) -> Block:
    """A thing is picked up in one place and put down in another."""
    there = f"({rests} {item} {source})"
    pick = [17, 1, 2, 3, {"7": 0.2}, *([6] if rests == "inside" else [])]
    return (
        _subtask(item, source, None, there, f"(not {there})", pick),
        _subtask(
            item,
            None,
            end,
            f"(inside {item} gripper)",
            f"({relation} {item} {end})",
            [18, {"13": 0.4}, {"9": 0.1}, {"8": 0.2}, 5, 6],
        ),
    )


def _scene(name: str, furniture: Json, things: Iterable[str], facts: Iterable[str]) -> Json:
    objects: Json = {key: {"category": category, "bbox_extent": _FURNITURE} for key, category in furniture.items()}
    for key in things:
        category = key.rsplit("_", 1)[0]
        objects[key] = {"category": category, "bbox_extent": _BOWL if category == "bowl" else _THING}
    return {"name": name, "objects": objects, "facts": list(facts), "closed": ["inside", "ontop", "open"]}


def _paper(name: str) -> BaseTask:
    """One of the paper's tasks; every subtask but a picking up with its putting down is a block of its own."""
    task: Json = json.loads((_DATA / f"{name}.json").read_text(encoding="utf-8"))
    scene: Json = json.loads((_DATA / f"{name}_scene.json").read_text(encoding="utf-8"))
    blocks: list[list[Json]] = []
    for subtask in task["sub_tasks"]:
        if subtask["flow"][0] not in (17, 18):
            subtask["flow"] = [17, *subtask["flow"]]
        if "gripper" in subtask["init"]:
            blocks[-1].append(subtask)
        else:
            blocks.append([subtask])
    chain = frozenset((i, i + 1) for i in range(len(blocks) - 1))
    goal = tuple(map(str, bddl.conjuncts(bddl.parse_formula(task["goal"]))))
    return BaseTask(name, scene, goal, tuple(map(tuple, blocks)), chain, task["scales"])


def _drawers() -> BaseTask:
    scene = _scene(
        "two_drawers",
        {"drawer_0": "drawer", "drawer_1": "drawer", "desk_0": "desk"},
        ("pen_0", "phone_0"),
        ("(ontop pen_0 desk_0)", "(ontop phone_0 desk_0)"),
    )
    blocks = (
        opening("drawer_0"),
        carrying("pen_0", "ontop", "desk_0", "inside", "drawer_0"),
        closing("drawer_0"),
        opening("drawer_1"),
        carrying("phone_0", "ontop", "desk_0", "inside", "drawer_1"),
        closing("drawer_1"),
    )
    goal = ("(inside pen_0 drawer_0)", "(inside phone_0 drawer_1)", "(not (open drawer_0))", "(not (open drawer_1))")
    return BaseTask("drawers", scene, goal, blocks, frozenset({(0, 1), (1, 2), (3, 4), (4, 5)}), {})


def _shelf() -> BaseTask:
    things = ("apple_0", "cup_0", "bottle_0")
    scene = _scene("shelf", {"table_0": "table", "shelf_0": "shelf"}, things, [f"(ontop {t} table_0)" for t in things])
    blocks = tuple(carrying(thing, "ontop", "table_0", "ontop", "shelf_0") for thing in things)
    return BaseTask("several objects", scene, tuple(f"(ontop {t} shelf_0)" for t in things), blocks, frozenset(), {})


def _two_containers() -> BaseTask:
    scene = _scene(
        "two_containers",
        {"refrigerator_0": "fridge", "microwave_0": "microwave", "counter_0": "countertop"},
        ("milk_carton_0", "bowl_0"),
        ("(ontop milk_carton_0 counter_0)", "(ontop bowl_0 counter_0)"),
    )
    blocks = (
        opening("refrigerator_0"),
        carrying("milk_carton_0", "ontop", "counter_0", "inside", "refrigerator_0"),
        closing("refrigerator_0"),
        opening("microwave_0"),
        carrying("bowl_0", "ontop", "counter_0", "inside", "microwave_0"),
        closing("microwave_0"),
    )
    goal = (
        "(inside milk_carton_0 refrigerator_0)",
        "(inside bowl_0 microwave_0)",
        "(not (open refrigerator_0))",
        "(not (open microwave_0))",
    )
    return BaseTask("two containers", scene, goal, blocks, frozenset({(0, 1), (1, 2), (3, 4), (4, 5)}), {})


def _swap_in_fridge() -> BaseTask:
    scene = _scene(
        "swap_in_fridge",
        {"refrigerator_0": "fridge", "table_0": "table"},
        ("jar_0", "cup_0", "apple_0"),
        ("(inside jar_0 refrigerator_0)", "(ontop cup_0 table_0)", "(ontop apple_0 table_0)"),
    )
    blocks = (
        opening("refrigerator_0"),
        carrying("jar_0", "inside", "refrigerator_0", "ontop", "table_0"),
        carrying("cup_0", "ontop", "table_0", "inside", "refrigerator_0"),
        carrying("apple_0", "ontop", "table_0", "inside", "refrigerator_0"),
        closing("refrigerator_0"),
    )
    goal = (
        "(ontop jar_0 table_0)",
        "(inside cup_0 refrigerator_0)",
        "(inside apple_0 refrigerator_0)",
        "(not (open refrigerator_0))",
    )
    before = frozenset({(0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (3, 4)})
    return BaseTask("K = 8", scene, goal, blocks, before, {})


def _clear_table() -> BaseTask:
    things = ("plate_0", "fork_0", "spoon_0", "mug_0")
    scene = _scene(
        "clear_table", {"table_0": "table", "sink_0": "sink"}, things, [f"(ontop {t} table_0)" for t in things]
    )
    blocks = tuple(carrying(thing, "ontop", "table_0", "ontop", "sink_0") for thing in things)
    return BaseTask("table clearing", scene, tuple(f"(ontop {t} sink_0)" for t in things), blocks, frozenset(), {})


def _packing() -> BaseTask:
    scene = _scene(
        "packing",
        {"cabinet_0": "cabinet", "table_0": "table", "shelf_0": "shelf"},
        ("spoon_0", "bowl_0", "egg_0"),
        ("(ontop spoon_0 table_0)", "(ontop bowl_0 table_0)", "(ontop egg_0 table_0)"),
    )
    blocks = (
        carrying("spoon_0", "ontop", "table_0", "inside", "bowl_0"),
        opening("cabinet_0"),
        carrying("bowl_0", "ontop", "table_0", "inside", "cabinet_0"),
        carrying("egg_0", "ontop", "table_0", "ontop", "shelf_0"),
        closing("cabinet_0"),
    )
    goal = (
        "(inside spoon_0 bowl_0)",
        "(inside bowl_0 cabinet_0)",
        "(ontop egg_0 shelf_0)",
        "(not (open cabinet_0))",
    )
    return BaseTask("packing", scene, goal, blocks, frozenset({(0, 2), (1, 2), (2, 4)}), {})


def ten_tasks() -> tuple[BaseTask, ...]:
    """Return the ten tasks."""
    others = (_drawers(), _shelf(), _two_containers(), _swap_in_fridge(), _clear_table(), _packing())
    return (*(_paper(name) for name in ("T1", "T2", "T3", "T4")), *others)
