"""Tasks beside the paper's: drawers, several objects, two containers, one of eight subtasks; scenes know everything."""

from __future__ import annotations

from typing import Any

SMALL = [0.05, 0.05, 0.1]
# Something goes into a bowl.
BOWL = [0.14, 0.14, 0.08]
LARGE = [0.6, 0.6, 1.0]


def scene(name: str, small: dict[str, str], large: dict[str, str], facts: list[str]) -> dict[str, Any]:
    """A scene of items and furniture in which what is not stated is false."""
    objects = {
        key: {"category": category, "bbox_extent": BOWL if category == "bowl" else SMALL}
        for key, category in small.items()
    }
    objects |= {key: {"category": category, "bbox_extent": LARGE} for key, category in large.items()}
    return {"name": name, "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}


def opening(fixture: str) -> dict[str, Any]:
    return subtask(
        f"open_{fixture}", fixture, None, None, f"(not (open {fixture}))", f"(open {fixture})", [17, 1, 2, 3, 4, 5]
    )


def closing(fixture: str) -> dict[str, Any]:
    flow = [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5]
    return subtask(f"close_{fixture}", fixture, None, None, f"(open {fixture})", f"(not (open {fixture}))", flow)


def picking(item: str, relation: str, support: str) -> dict[str, Any]:
    there = f"({relation} {item} {support})"
    flow = [17, 1, 2, 3, {"7": 0.2}, *([6] if relation == "inside" else [])]
    return subtask(f"pick_up_{item}", item, support, None, there, f"(not {there})", flow)


def placing(item: str, relation: str, support: str) -> dict[str, Any]:
    held = f"(inside {item} gripper)"
    flow = [18, {"13": 0.4}, {"9": 0.1}, 5]
    return subtask(f"put_{item}_{support}", item, None, support, held, f"({relation} {item} {support})", flow)


def subtask(
    name: str, target: str, before: str | None, after: str | None, init: str, goal: str, flow: list[Any]
) -> dict[str, Any]:
    return {
        "task_activity_name": name,
        "target": target,
        "support_init": before,
        "support_goal": after,
        "init": init,
        "goal": goal,
        "flow": flow,
    }


def task(name: str, goal: str, *subtasks: dict[str, Any]) -> dict[str, Any]:
    return {"task_activity_name": name, "goal": goal, "sub_tasks": list(subtasks)}


KITCHEN = {"fridge_0": "fridge", "cabinet_0": "bottom_cabinet", "table_0": "table"}
DESK = {"drawer_0": "drawer", "drawer_1": "drawer", "desk_0": "desk"}

# name -> (scene, task)
OTHERS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "pen_into_drawer": (
        scene("desk", {"pen_0": "pen", "book_0": "book"}, DESK, ["(ontop pen_0 desk_0)", "(ontop book_0 desk_0)"]),
        task(
            "pen_into_drawer",
            "(and (inside pen_0 drawer_0) (not (open drawer_0)))",
            opening("drawer_0"),
            picking("pen_0", "ontop", "desk_0"),
            placing("pen_0", "inside", "drawer_0"),
            closing("drawer_0"),
        ),
    ),
    "between_two_drawers": (
        scene("desk", {"pen_0": "pen", "book_0": "book"}, DESK, ["(inside pen_0 drawer_0)", "(ontop book_0 desk_0)"]),
        task(
            "between_two_drawers",
            "(and (inside pen_0 drawer_1) (not (open drawer_0)) (not (open drawer_1)))",
            opening("drawer_0"),
            opening("drawer_1"),
            picking("pen_0", "inside", "drawer_0"),
            placing("pen_0", "inside", "drawer_1"),
            closing("drawer_1"),
            closing("drawer_0"),
        ),
    ),
    "two_containers": (
        scene(
            "kitchen",
            {"cup_0": "cup", "apple_0": "apple"},
            KITCHEN,
            ["(ontop cup_0 table_0)", "(ontop apple_0 table_0)"],
        ),
        task(
            "two_containers",
            "(and (inside cup_0 cabinet_0) (inside apple_0 fridge_0) (not (open fridge_0)) (not (open cabinet_0)))",
            opening("cabinet_0"),
            picking("cup_0", "ontop", "table_0"),
            placing("cup_0", "inside", "cabinet_0"),
            closing("cabinet_0"),
            opening("fridge_0"),
            picking("apple_0", "ontop", "table_0"),
            placing("apple_0", "inside", "fridge_0"),
            closing("fridge_0"),
        ),
    ),
    "several_into_one": (
        scene(
            "kitchen",
            {"cup_0": "cup", "apple_0": "apple", "bowl_0": "bowl"},
            KITCHEN,
            ["(ontop cup_0 table_0)", "(ontop apple_0 table_0)", "(ontop bowl_0 cabinet_0)"],
        ),
        task(
            "several_into_one",
            "(and (inside cup_0 fridge_0) (inside apple_0 fridge_0) (ontop bowl_0 table_0) (not (open fridge_0)))",
            opening("fridge_0"),
            picking("cup_0", "ontop", "table_0"),
            placing("cup_0", "inside", "fridge_0"),
            picking("apple_0", "ontop", "table_0"),
            placing("apple_0", "inside", "fridge_0"),
            closing("fridge_0"),
            picking("bowl_0", "ontop", "cabinet_0"),
            placing("bowl_0", "ontop", "table_0"),
        ),
    ),
    "stack_and_store": (
        scene(
            "kitchen",
            {"cup_0": "cup", "bowl_0": "bowl"},
            KITCHEN,
            ["(inside cup_0 cabinet_0)", "(ontop bowl_0 table_0)", "(open fridge_0)"],
        ),
        task(
            "stack_and_store",
            "(and (inside cup_0 bowl_0) (not (open cabinet_0)) (not (open fridge_0)))",
            opening("cabinet_0"),
            picking("cup_0", "inside", "cabinet_0"),
            placing("cup_0", "inside", "bowl_0"),
            closing("cabinet_0"),
            closing("fridge_0"),
        ),
    ),
}
