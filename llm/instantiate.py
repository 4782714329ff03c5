"""Module 3: the initial state and the goal of a simple task, as formulas and as a full BDDL problem.

Source: the paper's BDDL Generation, and its table of initial and goal states for T1 to T4.
"""

from __future__ import annotations

import bddl
from llm.decompose import Step
from llm.intent import IntentKind
from llm.surroundings import GRIPPER, Support
from oag import Scene

# Ids of the scene and its categories, and the gripper: no domain that names another dialect, such as `omnigibson`,
# whose categories are synsets.
DOMAIN = "scene2demo"


def states(step: Step) -> tuple[bddl.Formula, bddl.Formula]:
    """Returns the initial state and the goal of a simple task.

    Raises:
        ValueError: A pick without the place it starts from, or a placing without the place it ends at.
    """
    is_open = bddl.Atom("open", (step.target,))
    if step.kind is IntentKind.OPEN:
        return bddl.Not(is_open), is_open
    if step.kind is IntentKind.CLOSE:
        return is_open, bddl.Not(is_open)
    if step.kind is IntentKind.PICK:
        there = _stands(step.target, step.start)
        return there, bddl.Not(there)
    return bddl.Atom("inside", (step.target, GRIPPER)), _stands(step.target, step.end)


def problem(name: str, init: bddl.Formula, goal: bddl.Formula, scene: Scene) -> bddl.Problem:
    """Returns the BDDL problem of a simple task: the objects that its formulas name, with their scene categories.

    Args:
        name: The subtask's activity name.
        init: Its initial state.
        goal: Its goal.
        scene: The scene that has the objects; names that it lacks (the gripper) need no declaration.
    """
    named = dict.fromkeys(name for part in (init, goal) for atom in _atoms(part) for name in atom.args)
    objects = tuple(bddl.TypedObject(key, scene.objects[key].category) for key in named if key in scene.objects)
    return bddl.Problem(name, DOMAIN, objects, bddl.conjuncts(init), goal)


def _stands(target: str, place: Support | None) -> bddl.Atom:
    """Returns the atom that says where the target stands."""
    if place is None:
        raise ValueError(f"a simple task that moves {target} needs the place it starts from or ends at")
    return bddl.Atom(place.relation, (target, place.object_id))


def _atoms(formula: bddl.Formula) -> tuple[bddl.Atom, ...]:
    """Returns the formula's atoms in an order that does not depend on hashes."""
    return tuple(sorted(bddl.atoms(formula), key=bddl.format))
