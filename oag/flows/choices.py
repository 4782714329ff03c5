"""Goals that leave a choice: a flow is searched for one of the ways to meet them, in turn.

UNGRASP puts the target where the goal says, and a goal such as `(or (inside g box_0) (inside g box_1))`, or one that
says `exists`, names no place for it. Each way to make such a goal true is a conjunction of literals that does.

Source: docs/semantics.md, Flows that are searched; `bddl.options` lists the ways, all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import bddl
from oag.model.facts import GRIPPER
from oag.model.scene import Scene
from oag.table.library import placement_of
from oag.table.start import contradictions, start_state
from oag.task.task import SimpleTask

# So many ways to meet goals are tried in one task; there may be more, and then nothing is claimed of them.
MOST_WAYS = 64


def narrowed(subtask: SimpleTask, scene: Scene) -> Iterator[SimpleTask]:
    """Yields a subtask with one way to meet its goal for its goal, those that change least of the start first.

    Args:
        subtask: One whose goal is no conjunction of literals; of any other there is nothing to choose.
        scene: Where the plan starts.

    Yields:
        Each goal makes the one given true, whatever else is the case. A goal support that was
        given is kept; where none was, it is where the way puts the target.
    """
    if bddl.literals(subtask.goal) is not None:
        return
    known = start_state(scene, None)
    state = {atom: value for atom in _atoms(subtask.goal, scene) if (value := known.holds(atom)) is not None}
    try:
        for way in bddl.options(subtask.goal, scene.categories, state):
            goal = bddl.And(tuple(literal.formula for literal in way))
            placement = placement_of(goal, subtask.target)
            support = subtask.support_goal if placement is None else placement.support
            if contradictions(way) is None and subtask.support_goal in (None, support):
                yield replace(subtask, goal=goal.parts[0] if len(goal.parts) == 1 else goal, support_goal=support)
    except bddl.SearchLimit:
        return


def _atoms(formula: bddl.Formula, scene: Scene) -> tuple[bddl.Atom, ...]:
    """Returns the atoms that a formula speaks of in a scene; what the hand holds is not among them."""
    grounded = bddl.ground(formula, scene.categories).atoms
    return tuple(atom for atom in grounded if GRIPPER not in atom.args)
