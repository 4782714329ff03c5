"""What certificates repeat of the plan and the start knowledge that they speak of.

Source: docs/semantics.md, Certificates; `oag/certificate/certificate.schema.json` has the form.
"""

from __future__ import annotations

import hashlib
import json

import bddl
from oag.model.actions import flow_to_json
from oag.model.categories import Kind
from oag.model.scene import Scene
from oag.table.start import scene_facts
from oag.task.task import Task


def digest(value: object) -> str:
    """Returns the SHA-256 of a JSON value's canonical text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def condition_json(formula: bddl.Formula) -> list[object] | str:
    """Returns a condition as certificates have it: [atom, value] for each literal, else the formula's text.

    Example:
        >>> import bddl
        >>> condition_json(bddl.parse_formula("(not (open box_0))"))
        [[['open', 'box_0'], False]]
    """
    literals = bddl.literals(formula)
    if literals is None:
        return bddl.format(formula)
    return [[[literal.atom.predicate, *literal.atom.args], literal.value] for literal in literals]


def plan_json(task: Task) -> dict[str, object]:
    """Returns what a certificate repeats of a plan: roles, conditions, flows, and the task goal."""
    return {
        "goal": condition_json(task.goal),
        "goal_given": task.goal_given,
        "subtasks": [
            {
                "target": subtask.target,
                "support_goal": subtask.support_goal,
                "init": condition_json(subtask.init),
                "goal": condition_json(subtask.goal),
                "flow": None if subtask.flow is None else flow_to_json(subtask.flow),
            }
            for subtask in task.subtasks
        ],
    }


def scene_json(scene: Scene) -> dict[str, object]:
    """Returns what a certificate repeats of a scene: categories, what can be taken or opened, and the start."""
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    return {
        "objects": scene.categories,
        "items": [key for key, kind in kinds.items() if kind is Kind.ITEM],
        "articulated": [key for key, kind in kinds.items() if kind is Kind.ARTICULATED],
        "start": [[list(fact), value] for fact, value in scene_facts(scene)],
    }
