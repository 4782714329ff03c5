"""Modules 2 to 5 without a model, and the task goal: from wishes to simple tasks with formulas, sizes and flows.

Source: the paper's Subtask Decomposition and BDDL Generation, with the table of initial and goal states for T1 to T4.
The task goal G is a departure (docs/proposition.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import bddl
from llm.errors import QueryError
from llm.offline.surroundings import Support, Surroundings
from llm.offline.wish import Intent, IntentKind, Request, enumeration
from oag import Action, ActionFlow, Primitive, Scene
from oag.flows import search
from oag.model.facts import GRIPPER
from oag.task.sizes import Gripper, Sizing, fitting

# Ids of the scene and its categories, and the gripper: no domain that names another dialect, such as `omnigibson`,
# whose categories are synsets.
DOMAIN = "scene2demo"
_MOST_NAMED = 6  # Of the things that a refusal offers instead.
TEMPLATES: Mapping[str, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN.value: search.OPEN,
        IntentKind.CLOSE.value: search.CLOSE,
        IntentKind.PICK.value: search.PICK,
        f"{IntentKind.PICK.value}, out of what it is inside": search.TAKE_OUT,
        IntentKind.PLACE.value: search.PLACE,
    }
)
"""The flows that simple tasks usually have, by what is done."""


@dataclass(frozen=True, slots=True)
class PlainTask:
    """A simple task before it has formulas: what is done to the target, from where, to where.

    Attributes:
        kind: One of the four kinds of simple tasks.
        target: Id of the object it acts on (o_t).
        start: For PICK, where the target stands (o_s1 and its relation).
        end: For PLACE, where the target shall stand (o_s2 and its relation).
    """

    kind: IntentKind
    target: str
    start: Support | None = None
    end: Support | None = None

    def states(self) -> tuple[bddl.Formula, bddl.Formula]:
        """Returns the initial state and the goal.

        Raises:
            ValueError: A pick without the place it starts from, or a placing without the place it ends at.
        """
        is_open = bddl.Atom("open", (self.target,))
        if self.kind is IntentKind.OPEN:
            return bddl.Not(is_open), is_open
        if self.kind is IntentKind.CLOSE:
            return is_open, bddl.Not(is_open)
        place = self.start if self.kind is IntentKind.PICK else self.end
        if place is None:
            raise ValueError(f"a simple task that moves {self.target} needs the place it starts from or ends at")
        there = bddl.Atom(place.relation, (self.target, place.object_id))
        if self.kind is IntentKind.PICK:
            return there, bddl.Not(there)
        return bddl.Atom("inside", (self.target, GRIPPER)), there

    def flow(self, scene: Scene) -> ActionFlow:
        """Returns the flow in a scene, its numbers open: the executor's geometric planner writes them."""
        flow = TEMPLATES[self.kind.value]
        if self.kind is IntentKind.PICK and self.start is not None:
            carrier = scene.objects.get(self.start.object_id)
            flow = search.taking(self.start.relation, "" if carrier is None else carrier.category)
        return tuple(Action(primitive) for primitive in flow)


def decompose(request: Request, around: Surroundings) -> tuple[PlainTask, ...]:
    """Returns the simple tasks of a request, in order.

    Doors in the way are opened first, while the hand is free. They stay open as long as the next wish needs them, and
    are closed again in reverse order. What is open already is neither opened nor closed, what is so already is not done
    again, and a door that a wish opens is left to the wishes. After picking something up no door is closed: the hand
    is not free.

    Args:
        request: Wishes that were checked against the scene.
        around: The scene and its facts.
    """
    steps: list[PlainTask] = []
    state = around
    # Doors that were opened on the way, not by a wish, and still are.
    opened: list[str] = []
    for index, intent in enumerate(request.intents):
        if intent.kind.is_about_a_door and intent.target in opened:
            opened.remove(intent.target)
        if state.fulfils(intent):
            continue
        if intent.kind.is_about_a_door:
            steps.append(PlainTask(intent.kind, intent.target))
        else:
            doors = state.doors_in_the_way(intent)
            steps += [PlainTask(IntentKind.OPEN, door) for door in doors]
            opened += doors
            steps += _moving(intent, state)
            state = state.with_doors(doors, True)
        state = state.after(intent)
        if state.held():
            continue
        needed = _needed(request.intents[index + 1 :], state, opened)
        done_with = [door for door in reversed(opened) if door not in needed]
        steps += [PlainTask(IntentKind.CLOSE, door) for door in done_with]
        state = state.with_doors(done_with, False)
        opened = [door for door in opened if door in needed]
    return tuple(steps)


def _moving(intent: Intent, state: Surroundings) -> list[PlainTask]:
    """Returns the picking up and the placing of a wish, without its doors."""
    steps = []
    start = state.support(intent.target)
    if start is not None and start.object_id != GRIPPER:
        steps.append(PlainTask(IntentKind.PICK, intent.target, start=start))
    if intent.relation is not None and intent.destination is not None:
        steps.append(PlainTask(IntentKind.PLACE, intent.target, end=Support(intent.relation, intent.destination)))
    return steps


def _needed(later: Sequence[Intent], state: Surroundings, opened: Sequence[str]) -> tuple[str, ...]:
    """Returns which of the doors that were opened on the way the next wish needs open, or speaks of itself."""
    closed = state.with_doors(opened, False)
    for intent in later:
        if intent.kind.is_about_a_door and intent.target in opened:
            return (intent.target,)
        if not state.fulfils(intent):
            return closed.doors_in_the_way(intent)
    return ()


def goal_of(request: Request, around: Surroundings) -> bddl.Formula:
    """Returns the task goal G: where things shall be, and how doors shall be.

    A later wish about the same object's place, or the same door, takes the place of an earlier one. A door that a
    placing needs open and that no wish opened is closed again. After picking something up at the end the hand is not
    free to close a door, so the goal does not ask for it. What was open is left as it was found.
    """
    places: dict[str, bddl.Formula] = {}
    doors: dict[str, bddl.Formula] = {}
    state = around
    for intent in request.intents:
        if intent.kind.is_about_a_door:
            doors[intent.target] = intent.wish
        else:
            places.pop(intent.target, None)
            places[intent.target] = intent.wish
            for door in () if state.fulfils(intent) else state.doors_in_the_way(intent):
                doors.pop(door, None)
                if intent.kind is IntentKind.PLACE:
                    doors[door] = bddl.Not(bddl.Atom("open", (door,)))
        state = state.after(intent)
    wanted = (*places.values(), *doors.values())
    return wanted[0] if len(wanted) == 1 else bddl.And(wanted)


def problem(name: str, init: bddl.Formula, goal: bddl.Formula, scene: Scene) -> bddl.Problem:
    """Returns the BDDL problem of a simple task: the objects that its formulas name, with their scene categories.

    Args:
        name: The subtask's activity name.
        init: Its initial state.
        goal: Its goal.
        scene: The scene that has the objects; names that it lacks (the gripper) need no declaration.
    """
    # Sorted: the order of a set of atoms depends on hashes.
    atoms = (atom for part in (init, goal) for atom in sorted(bddl.atoms(part), key=bddl.format))
    named = dict.fromkeys(key for atom in atoms for key in atom.args if key in scene.objects)
    objects = tuple(bddl.TypedObject(key, scene.objects[key].category) for key in named)
    return bddl.Problem(name, DOMAIN, objects, bddl.conjuncts(init), goal)


def scale_factors(targets: Iterable[str], scene: Scene, sizing: Sizing) -> dict[str, float]:
    """Returns the factor of each target (ids may recur), in the order in which they first occur."""
    gripper = Gripper.of(scene.robot)
    return {target: sizing.factor(scene[target], gripper) for target in targets}


def check_sizes(targets: Iterable[str], scene: Scene, sizing: Sizing, query: str, understood: str) -> None:
    """Refuses to handle what fits the gripper at no size that it may be scaled to.

    Args:
        targets: Target of each subtask.
        scene: The scene that has them.
        sizing: What becomes of sizes.
        query: The query as it was given.
        understood: What was understood of it.

    Raises:
        QueryError: Code "too-large"; it says what would fit.
    """
    gripper = Gripper.of(scene.robot)
    for target in dict.fromkeys(targets):
        unfit = sizing.unfit(scene[target], gripper)
        if unfit is not None:
            width_m = min(scene[target].extent_m[:2])
            why = f"{target} is {width_m:.3f} m wide, the gripper takes at most {gripper.widest_m:.3f} m: it {unfit}"
            if not sizing.keep:
                why += f". Things up to {gripper.widest_scaled_m:.3f} m wide can be scaled to fit"
            fit = fitting(scene, sizing)
            why += f"; here {enumeration(fit[:_MOST_NAMED])} fit" if fit else "; nothing here fits"
            raise QueryError("too-large", query, why, understood=understood)
