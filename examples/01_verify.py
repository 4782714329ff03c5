"""Compose a task and prove it.

A task is a list of simple tasks, each with a target, two supports, a start and a goal, and an action flow of primitive
IDs. `compose` joins them into one object-action graph; `verify` decides whether the plan reaches the task's goal from
every state that fits what is known. The flows here are the paper's for "put the glass into the refrigerator".

    python examples/01_verify.py
"""

import oag
from oag.graph import to_mermaid

SCENE = {
    "name": "kitchen",
    "robot": {"position": [0, 0, 0], "yaw": 0.0},
    "objects": {
        "refrigerator_0": {
            "category": "refrigerator",
            "model": "upright_one_door",
            "position": [1.0, 0.0, 0.6],
            "orientation": [1, 0, 0, 0],
            "bbox_extent": [0.68, 0.6, 1.2],
            "scale": [1, 1, 1],
        },
        "table_0": {
            "category": "table",
            "model": "four_legs",
            "position": [0.0, -1.2, 0.3],
            "orientation": [1, 0, 0, 0],
            "bbox_extent": [0.9, 0.5, 0.6],
            "scale": [1, 1, 1],
        },
        "glass_0": {
            "category": "water_glass",
            "model": "tumbler",
            "position": [0.0, -1.2, 0.64],
            "orientation": [1, 0, 0, 0],
            "bbox_extent": [0.05, 0.05, 0.08],
            "scale": [1, 1, 1],
        },
    },
    "facts": ["(ontop glass_0 table_0)", "(not (open refrigerator_0))"],
    "closed": ["ontop", "inside", "open"],
}


def simple_task(name, target, init, goal, flow, support_init=None, support_goal=None):
    """Return one subtask in the paper's JSON form."""
    return {
        "task_activity_name": name,
        "task_detail_message": "",
        "target": target,
        "support_init": support_init,
        "support_goal": support_goal,
        "init": init,
        "goal": goal,
        "flow": flow,
    }


OPEN, SHUT = "(open refrigerator_0)", "(not (open refrigerator_0))"
ON_TABLE, IN_HAND = "(ontop glass_0 table_0)", "(inside glass_0 gripper)"
IN_FRIDGE = "(inside glass_0 refrigerator_0)"

TASK = {
    "task_activity_name": "put_glass_into_refrigerator",
    "task_detail_message": "Open the refrigerator, put the glass inside, close it.",
    "goal": f"(and {IN_FRIDGE} {SHUT})",
    "sub_tasks": [
        simple_task("open_refrigerator", "refrigerator_0", SHUT, OPEN, [1, 2, 3, 4, 5]),
        simple_task("pick_up_glass", "glass_0", ON_TABLE, f"(not {ON_TABLE})", [17, 1, 2, 3, {"7": 0.2}], "table_0"),
        simple_task(
            "put_glass", "glass_0", IN_HAND, IN_FRIDGE, [18, {"13": 0.4}, {"9": 0.1}, 5], None, "refrigerator_0"
        ),
        simple_task("close_refrigerator", "refrigerator_0", OPEN, SHUT, [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5]),
    ],
}

if __name__ == "__main__":
    scene = oag.Scene.from_json(SCENE)
    graph = oag.compose(oag.Task.from_json(TASK, scene=scene))
    report = graph.verify()
    print(report)
    print(to_mermaid(graph))
    if not report:
        raise SystemExit(1)
