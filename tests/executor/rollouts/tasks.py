"""Tasks that the rollout tests run: T1 and T3 with flows whose numbers are open, and the paper's literal flows."""

from __future__ import annotations

from typing import Any

import oag
from executor.scenes import library

T1_GOAL = "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))"
T1_ROLES: list[dict[str, Any]] = [
    {
        "task_activity_name": "open_refrigerator",
        "target": "refrigerator_0",
        "init": "(not (open refrigerator_0))",
        "goal": "(open refrigerator_0)",
    },
    {
        "task_activity_name": "pick_up_glass",
        "target": "glass_0",
        "support_init": "table_0",
        "init": "(ontop glass_0 table_0)",
        "goal": "(not (ontop glass_0 table_0))",
    },
    {
        "task_activity_name": "put_glass_into_refrigerator",
        "target": "glass_0",
        "support_goal": "refrigerator_0",
        "init": "(inside glass_0 gripper)",
        "goal": "(inside glass_0 refrigerator_0)",
    },
    {
        "task_activity_name": "close_refrigerator",
        "target": "refrigerator_0",
        "init": "(open refrigerator_0)",
        "goal": "(not (open refrigerator_0))",
    },
]
T1_OPEN_FLOWS = [
    [17, 1, 2, 3, {"4": None}, 5, 6],
    [17, 1, 2, 3, {"7": None}],
    [18, {"13": None}, {"8": None}, 5, 6],
    [17, 1, 2, 3, {"19": None}, 5, 6],
]
T1_PAPER_FLOWS = [
    [1, 2, 3, 4, 5],
    [17, 1, 2, 3, {"7": 0.2}],
    [18, {"13": 0.4}, {"9": 0.1}, 5],
    [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5],
]
T3_ROLES: list[dict[str, Any]] = [
    {
        "task_activity_name": "pick_up_apple",
        "target": "apple_0",
        "support_init": "cabinet_0",
        "init": "(ontop apple_0 cabinet_0)",
        "goal": "(not (ontop apple_0 cabinet_0))",
    },
    {
        "task_activity_name": "put_apple_into_bowl",
        "target": "apple_0",
        "support_goal": "bowl_0",
        "init": "(inside apple_0 gripper)",
        "goal": "(inside apple_0 bowl_0)",
    },
]
T3_OPEN_FLOWS = [[17, 1, 2, 3, {"7": None}], [18, {"13": None}, {"8": None}, 5, 6]]
AJAR: list[Any] = [1, 2, 3, {"19": [0.0, 0.3]}, 5]
"""Proved, and leaves a door that stands at a half open by a fifth."""


def graph(
    scene: str | oag.Scene, roles: list[dict[str, Any]], flows: list[list[Any]], goal: str, scales: dict[str, float]
) -> oag.ObjectActionGraph:
    """Return a composed task over a scene, or over the package's scene of that name."""
    chosen = library.load(scene) if isinstance(scene, str) else scene
    fields = {"task_detail_message": "", "support_init": None, "support_goal": None}
    subtasks = [fields | role | {"flow": flow} for role, flow in zip(roles, flows, strict=True)]
    task = {
        "task_activity_name": f"{chosen.name}_task",
        "task_detail_message": "",
        "goal": goal,
        "scales": scales,
        "sub_tasks": subtasks,
    }
    return oag.compose(oag.Task.from_json(task, scene=chosen))


def t1(flows: list[list[Any]] = T1_OPEN_FLOWS) -> oag.ObjectActionGraph:
    """Return T1 with the given flows."""
    return graph("kitchen_t1", T1_ROLES, flows, T1_GOAL, {"glass_0": 0.71})


def t3(scale: float = 0.62) -> oag.ObjectActionGraph:
    """Return T3 with the apple at the given scale."""
    return graph("kitchen_t3", T3_ROLES, T3_OPEN_FLOWS, "(inside apple_0 bowl_0)", {"apple_0": scale})


def open_joints() -> oag.Scene:
    """Return T1's scene with the refrigerator's door at a half."""
    nominal = library.load("kitchen_t1").to_json()
    nominal["objects"]["refrigerator_0"]["parameters"] |= {"open_fraction": 0.5}  # type: ignore[index]
    return oag.Scene.from_json({**nominal, "facts": ["(ontop glass_0 table_0)", "(open refrigerator_0)"]})


def closing(flow: list[Any] = AJAR) -> oag.ObjectActionGraph:
    """Return the task of closing the refrigerator that stands open, by a flow."""
    return graph(open_joints(), T1_ROLES[3:], [flow], "(not (open refrigerator_0))", {})


def into_an_open_refrigerator(
    flows: list[list[Any]] | None = None, width_m: float = 0.6, shelf_heights_m: tuple[float, ...] = (0.42, 0.72)
) -> oag.ObjectActionGraph:
    """Return T1's second and third subtask, the refrigerator standing open from the start.

    Args:
        flows: Of the two subtasks; by default with open numbers.
        width_m: Outer width of the refrigerator.
        shelf_heights_m: Where it has shelves.
    """
    nominal = library.load("kitchen_t1").to_json()
    refrigerator = nominal["objects"]["refrigerator_0"]  # type: ignore[index]
    refrigerator["bbox_extent"] = [0.68, width_m, 1.2]
    refrigerator["parameters"] |= {"open_fraction": 0.85, "shelf_heights_m": list(shelf_heights_m)}
    facts = ["(ontop glass_0 table_0)", "(open refrigerator_0)"]
    scene = oag.Scene.from_json({**nominal, "facts": facts})
    fields = {"task_detail_message": "", "support_init": None, "support_goal": None}
    chosen = zip(T1_ROLES[1:3], flows or T1_OPEN_FLOWS[1:3], strict=True)
    task = {
        "task_activity_name": "put_glass_into_open_refrigerator",
        "task_detail_message": "",
        "goal": "(inside glass_0 refrigerator_0)",
        "scales": {"glass_0": 0.71},
        "sub_tasks": [fields | role | {"flow": flow} for role, flow in chosen],
    }
    return oag.compose(oag.Task.from_json(task, scene=scene), scene=scene)
