"""Feasibility of intents in a scene, and their decomposition into simple tasks with formulas, scales and flows.

An intent is feasible if the objects afford it, one hand can do it, and it is not fulfilled yet. Feasible intents
are also what a refusal suggests instead. Modules 2 to 5 without a model, and the task goal G, follow.

Source: the paper's Subtask Decomposition and BDDL Generation, with the table of initial and goal states for T1
to T4. The task goal G is a departure (docs/semantics.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import bddl
from llm.errors import QueryError
from llm.offline.intents import RELATIONS, Intent, IntentKind, Refusal, Request, Support, Surroundings, enumeration
from oag import Action, Primitive, Scene, flows
from oag.model.actions import ActionFlow
from oag.model.scene import UPRIGHT_DEG
from oag.model.symbols import GRIPPER, Kind
from oag.model.where import Where
from oag.sizes import LEAST_ACROSS, LEAST_TOP_M, Gripper, Sizing, graspable_items, has_finger_room


def check_all(request: Request, around: Surroundings) -> tuple[Intent, ...]:
    """Check the intents in their order; return those that are fulfilled already, for which nothing is done.

    Closing a door that an earlier intent opens on its way is not among them: it states what happens anyway.

    Raises:
        Refusal: One of the intents is infeasible in its turn, or all are fulfilled already.
    """
    for intent in request.intents:
        if intent.kind.moves_an_item:
            check_item(intent.target, around)
    state = around
    idle: list[Intent] = []
    needless: list[Refusal] = []
    _check_parts(request)
    on_the_way: set[str] = set()
    for intent in request.intents:
        try:
            check(intent, state)
        except Refusal as refusal:
            if refusal.code != "already-so":
                raise _of_size(request, around) or refusal if refusal.code == "affordance" else refusal from None
            needless.append(refusal)
            if intent.target not in on_the_way:
                idle.append(intent)
        else:
            doors = state.doors_in_the_way(intent)
            on_the_way.update(doors)
            if intent.kind is IntentKind.PICK:
                # The hand that holds the thing cannot close them again.
                state = state.with_doors(doors, True)
        state = state.after(intent)
    if len(needless) == len(request.intents):
        raise needless[0]
    return tuple(idle)


def _check_parts(request: Request) -> None:
    """Refuse two parts of one thing, of which only the first would be opened; once it is closed, another may be."""
    parts: dict[str, Where] = {}
    for intent in request.intents:
        thing, part = intent.destination or intent.target, intent.where
        if part is not None and part.part in ("door", "drawer") and (first := parts.setdefault(thing, part)) != part:
            problem = f"the {first} and the {part} of {thing}: a plan opens one part of a thing; ask for one at a time"
            raise Refusal("unsupported-relation", problem)
        if intent.kind is IntentKind.CLOSE:
            parts.pop(thing, None)


def check(intent: Intent, around: Surroundings) -> None:
    """Raise the Refusal of an intent that no plan of the library can fulfil, or that is fulfilled."""
    target = intent.target
    if intent.kind.is_a_switching:
        _check_control(intent, around)
        return
    if intent.kind.moves_an_item:
        check_item(target, around)
        _check_standing(target, around)
        if intent.kind is IntentKind.PLACE:
            _check_destination(intent, around)
        if intent.kind is IntentKind.PUSH:
            _check_pushed(intent, around)
        if intent.kind is IntentKind.STAND:
            _check_lying(intent, around)
        _check_reachable(intent, around)
        return
    if not around.affordances[target].door:
        raise _lacks(target, "no door to open or close", around)
    if around.is_open(target) is (intent.kind is IntentKind.OPEN):
        raise _so_already(intent)
    _check_free_hand(around, f"to {intent.kind.value} {target}")


def _check_control(intent: Intent, around: Surroundings) -> None:
    if around.control(intent.target) is None:
        raise _lacks(intent.target, "neither a button nor a knob", around)
    if around.is_on(intent.target) is (intent.kind is IntentKind.SWITCH_ON):
        raise _so_already(intent)
    _check_free_hand(around, f"to {intent.kind.value} {intent.target}")


def _check_lying(intent: Intent, around: Surroundings) -> None:
    """Raise the Refusal of standing up what has no upright side, stands already, or is in the hand."""
    target = intent.target
    if not around.can_stand(target):
        raise _lacks(target, "no side on which alone it stands, so that there is nothing to stand up", around)
    upright = around.is_upright(target)
    if upright is None:
        raise Refusal("affordance", f"the scene does not say whether {target} stands or lies")
    if upright:
        raise _so_already(intent)
    if target in around.held():
        raise Refusal("hand-full", f"{target} is in the hand; say where to put it")


def check_item(target: str, around: Surroundings) -> None:
    """Raise the Refusal of lifting an object that is no item."""
    objects = around.scene.objects
    if objects[target].role == "A":
        items = [around.described(key) for key, thing in objects.items() if thing.role == "B"]
        raise Refusal("affordance", f"{target} is a fixture (type A); the robot lifts items only", scene=items)


def _check_standing(target: str, around: Surroundings) -> None:
    support = around.support(target)
    if support is None:
        problem = f"the scene does not state what {target} stands on; add a fact such as (ontop {target} table_0)"
        raise Refusal("unknown-place", problem)
    if support.object_id != GRIPPER and support.object_id not in around.scene.objects:
        raise Refusal("unknown-place", f"{target} is {support}, which is no object of the scene to plan with")


def _check_destination(intent: Intent, around: Surroundings) -> None:
    target, destination, relation = intent.target, intent.destination, intent.relation
    if destination is None or relation is None:
        raise ValueError(f"a wish to place {target} needs a destination and a relation")
    if destination == target:
        raise Refusal("affordance", f"{target} cannot be put {'into' if relation == 'inside' else 'onto'} itself")
    if any(step.object_id == target for step in around.chain(destination)):
        raise Refusal("affordance", f"{destination} stands in or on {target}, so {target} cannot be put there")
    if destination in around.held():
        raise Refusal("hand-full", f"{destination} is in the hand, so nothing can be put there")
    can = around.affordances[destination]
    if relation == "inside" and not can.interior:
        other = Intent(IntentKind.PLACE, target, "ontop", destination)
        raise _lacks(
            destination, "no interior to put something into", around, (other,) if can.surface or can.top else ()
        )
    if relation == "ontop" and not (can.surface or can.top):
        _check_crown(target, destination, around)
    if relation == "inside" and not _goes_in(target, destination, around):
        raise Refusal("affordance", f"{target}, as small as the gripper needs it, is too wide for {destination}")
    there = any(step.relation == relation and step.object_id == destination for step in around.supports(target))
    if there and intent.where is None:
        raise _so_already(intent)
    if intent.where is not None and intent.where.other == target:
        raise Refusal("affordance", f"{target} cannot be put {intent.where}")


def _check_crown(target: str, destination: str, around: Surroundings) -> None:
    """Raise the Refusal of putting a thing onto one without a surface, unless that bears it on its top or its rim.

    Only sizes are compared: whether the thing stays there is asked of physics before anything moves.
    """
    thing, bearer, can = (
        around.scene.objects[target],
        around.scene.objects[destination],
        around.affordances[destination],
    )
    into = (Intent(IntentKind.PLACE, target, "inside", destination),) if can.interior else ()
    stands = thing.has_box and bearer.has_box and bearer.lean_deg <= UPRIGHT_DEG
    if can.crown is None or not stands:
        raise _lacks(destination, "no surface to put something onto", around, into)
    width_m = min(bearer.extent_m[:2])
    if can.crown == "flat":
        if width_m < LEAST_TOP_M:
            problem = (
                f"the top of {destination} is {100 * width_m:.1f} cm wide; "
                f"things stand on one of {100 * LEAST_TOP_M:.0f} cm and more"
            )
            raise Refusal("affordance", problem)
        return
    factor = around.sizing.factor(thing, Gripper.of(around.scene.robot))
    narrow_m, wide_m = sorted(factor * side for side in thing.extent_m[:2])
    if wide_m < width_m or narrow_m < LEAST_ACROSS * width_m:
        size = f"{100 * wide_m:.1f} x {100 * narrow_m:.1f} cm"
        problem = (
            f"{target} is {size} from above, and {destination} {100 * width_m:.1f} cm wide: on its rim rests what is "
            f"as wide as that, and half as wide across"
        )
        raise Refusal("affordance", problem, instead=into)


def _check_pushed(intent: Intent, around: Surroundings) -> None:
    target, where = intent.target, intent.where
    if where is None or where.other == target:
        raise Refusal("affordance", f"{target} cannot be pushed {where or 'nowhere'}")
    if target in around.held():
        raise Refusal("hand-full", f"{target} is in the hand; what is pushed stands on something")
    if cargo := around.cargo(target):
        raise Refusal("unsupported-relation", f"{target} carries {enumeration(cargo)}, and is not pushed with it")
    along = Support("ontop", str(intent.destination))
    start = along if along in around.supports(target) else around.support(target)
    if start is None:
        raise ValueError(f"a wish to push {target} needs what it stands on")
    if start.relation == "inside":
        problem = f"{target} is {start}; only what stands on top of something is pushed"
    elif around.scene.objects[start.object_id].kind is Kind.ITEM:
        problem = f"{target} is {start}, which is loose and would go along with what is pushed on it"
    elif start != along:
        problem = f"{target} is {start}, and {where.other} is not; a thing is pushed along what both stand on"
    else:
        return
    raise Refusal("unsupported-relation", problem, scene=list(map(around.described, (target, str(where.other)))))


def _goes_in(item: str, container: str, around: Surroundings) -> bool:
    """Decide whether an item, after scaling, fits through another item's mouth in any orientation."""
    thing, vessel = around.scene.objects[item], around.scene.objects[container]
    factor = around.sizing.factor(thing, Gripper.of(around.scene.robot))
    narrow, wide, _ = (factor * side for side in sorted(thing.extent_m))
    mouth_m = sorted(vessel.extent_m[:2])
    return vessel.role == "A" or not (thing.has_box and vessel.has_box) or (narrow < mouth_m[0] and wide < mouth_m[1])


def _check_reachable(intent: Intent, around: Surroundings) -> None:
    pushed = intent.kind is IntentKind.PUSH
    if pushed or around.held() != (intent.target,):
        _check_free_hand(around, f"to {'push' if pushed else 'pick up'} {intent.target}")
        return
    if intent.kind is IntentKind.PICK:
        raise _so_already(intent)
    shut = around.doors_in_the_way(intent)
    if shut:
        _check_free_hand(around, f"to open {' and '.join(shut)}")


def _check_free_hand(around: Surroundings, purpose: str) -> None:
    held = around.held()
    if held:
        raise Refusal("hand-full", f"the hand holds {' and '.join(held)}, and has to be free {purpose}")


def _so_already(intent: Intent) -> Refusal:
    return Refusal("already-so", f"{intent.outcome} already; there is nothing to do")


def _lacks(object_id: str, what: str, around: Surroundings, instead: tuple[Intent, ...] = ()) -> Refusal:
    category = around.scene.objects[object_id].category
    return Refusal("affordance", f"{object_id} ({category}) has {what}", instead=instead)


def is_possible(wish: Intent | Request, around: Surroundings) -> bool:
    """Decide whether an intent, or each intent of a request in its turn, is feasible and not fulfilled.

    It is stricter than `check`, which accepts what is requested: a suggestion has to leave room for the fingers.
    """
    if not all(_has_room(intent, around) for intent in Request.of(wish).intents):
        return False
    try:
        if isinstance(wish, Intent):
            check(wish, around)
            return True
        return not check_all(wish, around)
    except Refusal:
        return False


def _has_room(wish: Intent, around: Surroundings) -> bool:
    """Decide whether there is room for the fingers when an item is put into another one."""
    thing, vessel = around.scene.objects[wish.target], around.scene.objects.get(wish.destination or "")
    if vessel is None or wish.relation != "inside" or vessel.role == "A":
        return True
    if not (thing.has_box and vessel.has_box):
        return True
    factor = around.sizing.factor(thing, Gripper.of(around.scene.robot))
    return has_finger_room(thing, vessel, factor)


def with_a_free_hand(request: Request, around: Surroundings) -> list[Request]:
    """Return requests that one hand can fulfil instead: pick things up last, or put them down."""
    picks = [intent for intent in request.intents if intent.kind is IntentKind.PICK]
    others = tuple(intent for intent in request.intents if intent.kind is not IntentKind.PICK)
    found = [Request((*others, pick)) for pick in picks]
    for pick in picks[:1]:
        for place in places_for((pick.target,), around):
            found.append(Request(tuple(place.intents[0] if intent == pick else intent for intent in request.intents)))
    return [wish for wish in found if is_possible(wish, around)]


def places_for(targets: Sequence[str], around: Surroundings, avoided: Sequence[str] = ()) -> list[Request]:
    """Return requests that put all objects at one fixture of the scene, each a different fixture."""
    requests = [
        Request(tuple(Intent(IntentKind.PLACE, target, relation, place) for target in targets))
        for place, thing in around.scene.objects.items()
        for relation in RELATIONS
        if thing.role == "A" and place not in avoided
    ]
    return [request for request in requests if is_possible(request, around)]


# Domain of ids and categories of the scene, and the gripper. It is not `omnigibson`, for example, whose categories are
# synsets.
DOMAIN = "scene2demo"
_MOST_NAMED = 6  # Most alternatives in a refusal.
TEMPLATES: Mapping[str, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN.value: flows.OPEN,
        IntentKind.CLOSE.value: flows.CLOSE,
        IntentKind.PICK.value: flows.PICK,
        f"{IntentKind.PICK.value}, out of what it is inside": flows.TAKE_OUT,
        IntentKind.PLACE.value: flows.PLACE,
    }
)
"""Usual flows of simple tasks, by their kind."""


@dataclass(frozen=True, slots=True)
class PlainTask:
    """A simple task before it has formulas: action, target, source, destination.

    Attributes:
        kind: One of the kinds of simple tasks.
        target: Id of the object it acts on (o_t).
        start: For PICK and PUSH, where the target stands (o_s1 and its relation).
        end: For PLACE, PUSH and STAND, where the target shall stand (o_s2 and its relation).
        where: The part or spot that is meant.
    """

    kind: IntentKind
    target: str
    start: Support | None = None
    end: Support | None = None
    where: Where | None = None

    def states(self) -> tuple[bddl.Formula, bddl.Formula]:
        """Return the initial state and the goal."""
        is_open = bddl.Atom("open", (self.target,))
        if self.kind is IntentKind.OPEN:
            return bddl.Not(is_open), is_open
        if self.kind is IntentKind.CLOSE:
            return is_open, bddl.Not(is_open)
        if self.kind.is_a_switching:
            is_on = bddl.Atom("toggled_on", (self.target,))
            return (bddl.Not(is_on), is_on) if self.kind is IntentKind.SWITCH_ON else (is_on, bddl.Not(is_on))
        place = self.start if self.kind is IntentKind.PICK else self.end
        if place is None:
            raise ValueError(f"a simple task that moves {self.target} needs the place it starts from or ends at")
        there = bddl.Atom(place.relation, (self.target, place.object_id))
        if self.kind is IntentKind.PICK:
            return there, bddl.Not(there)
        if self.kind is IntentKind.PUSH:
            return there, there  # The spot is no matter of symbols.
        upright = bddl.Atom("upright", (self.target,))
        goal = bddl.And((there, upright)) if self.kind is IntentKind.STAND else there
        return bddl.Atom("inside", (self.target, GRIPPER)), goal

    def flow(self, scene: Scene) -> ActionFlow:
        """Return the flow in a scene with open numbers, which the executor's geometric planner fills in."""
        if self.kind is IntentKind.PUSH:
            return tuple(map(Action, flows.PUSH))
        flow = TEMPLATES[self.kind.value]
        if self.kind is IntentKind.PICK and self.start is not None:
            carrier = scene.objects.get(self.start.object_id)
            flow = flows.taking(self.start.relation, "" if carrier is None else carrier.category)
        return tuple(Action(primitive) for primitive in flow)


def decompose(request: Request, around: Surroundings) -> tuple[PlainTask, ...]:
    """Return the simple tasks of a request, in order.

    Doors in the way are opened first, while the hand is free. They stay open as long as the next intent needs them,
    and are closed again in reverse order. A door that is open already is neither opened nor closed, and a fulfilled
    intent is not repeated. A door that an intent opens is left to the intents. After a pick no door is closed: the
    hand is not free.
    """
    steps: list[PlainTask] = []
    state = around
    # Doors opened on the way, not by an intent, that are still open.
    opened: list[str] = []
    for index, intent in enumerate(request.intents):
        if intent.kind.is_about_a_door and intent.target in opened:
            opened.remove(intent.target)
        if state.fulfils(intent):
            continue
        if not intent.kind.moves_an_item:
            steps.append(PlainTask(intent.kind, intent.target, where=intent.where))
        else:
            doors = state.doors_in_the_way(intent)
            part = intent.where if intent.where is not None and intent.where.part in ("door", "drawer") else None
            steps += [
                PlainTask(IntentKind.OPEN, door, where=part if door == intent.destination else None) for door in doors
            ]
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
    steps = []
    start = state.support(intent.target)
    if intent.kind is IntentKind.PUSH:
        return [PlainTask(intent.kind, intent.target, start, start, intent.where)]
    if start is not None and start.object_id != GRIPPER:
        steps.append(PlainTask(IntentKind.PICK, intent.target, start=start))
    if intent.kind is IntentKind.STAND:
        steps.append(PlainTask(intent.kind, intent.target, end=start))
    if intent.relation is not None and intent.destination is not None:
        end = Support(intent.relation, intent.destination)
        steps.append(PlainTask(IntentKind.PLACE, intent.target, end=end, where=intent.where))
    return steps


def _needed(later: Sequence[Intent], state: Surroundings, opened: Sequence[str]) -> tuple[str, ...]:
    """Return the doors opened on the way that the next intent needs open, or is about."""
    closed = state.with_doors(opened, False)
    for intent in later:
        if intent.kind.is_about_a_door and intent.target in opened:
            return (intent.target,)
        if not state.fulfils(intent):
            return closed.doors_in_the_way(intent)
    return ()


def goal_of(request: Request, around: Surroundings) -> bddl.Formula:
    """Return the task goal G: final places of objects, what stands, states of doors, and what is switched on or off.

    A later intent about the same object's place, or the same door, replaces an earlier one. A door that a placing
    needs open and that no intent opened is closed again. After a final pick the hand is not free to close a door, so
    the goal does not demand it. A door that was open stays open.
    """
    places: dict[str, bddl.Formula] = {}
    doors: dict[str, bddl.Formula] = {}
    switches: dict[str, bddl.Formula] = {}
    stood: dict[str, bddl.Formula] = {}
    state = around
    for intent in request.intents:
        if intent.kind.is_about_a_door:
            doors[intent.target] = intent.wish
        elif intent.kind.is_a_switching:
            switches[intent.target] = intent.wish
        else:
            there = state.support(intent.target)
            places.pop(intent.target, None)
            places[intent.target] = intent.wish
            if intent.kind is IntentKind.STAND and there is not None:
                # It is put down again where it lay.
                places[intent.target] = bddl.Atom(there.relation, (intent.target, there.object_id))
                stood[intent.target] = intent.wish
            for door in () if state.fulfils(intent) else state.doors_in_the_way(intent):
                doors.pop(door, None)
                if intent.kind.puts_down:
                    doors[door] = bddl.Not(bddl.Atom("open", (door,)))
        state = state.after(intent)
    wanted = (*places.values(), *stood.values(), *doors.values(), *switches.values())
    return wanted[0] if len(wanted) == 1 else bddl.And(wanted)


def problem(name: str, init: bddl.Formula, goal: bddl.Formula, scene: Scene) -> bddl.Problem:
    """Return the BDDL problem of a simple task: the objects that its formulas name, with their scene categories."""
    # Sorted: the order of a set of atoms depends on hashes.
    atoms = (atom for part in (init, goal) for atom in sorted(bddl.atoms(part), key=bddl.format))
    named = dict.fromkeys(key for atom in atoms for key in atom.args if key in scene.objects)
    objects = tuple(bddl.TypedObject(key, scene.objects[key].category) for key in named)
    return bddl.Problem(name, DOMAIN, objects, bddl.conjuncts(init), goal)


def scale_factors(targets: Iterable[str], scene: Scene, sizing: Sizing) -> dict[str, float]:
    """Return the factor of each target (ids may recur), in the order of first occurrence."""
    gripper = Gripper.of(scene.robot)
    return {target: sizing.factor(scene[target], gripper) for target in targets}


def check_sizes(
    targets: Iterable[str],
    scene: Scene,
    sizing: Sizing,
    query: str,
    understood: str,
    instead: Sequence[str] = (),
) -> None:
    """Refuse targets that fit the gripper at no permitted scale.

    Args:
        targets: Target of each subtask.
        scene: The scene that has them.
        sizing: Rule for sizes.
        query: The query as given.
        understood: The understood request.
        instead: Wishes that can be fulfilled instead.

    Raises:
        QueryError: Code "too-large"; the message states what would fit.
    """
    for target in dict.fromkeys(targets):
        if (why := why_unfit(target, scene, sizing)) is not None:
            raise QueryError("too-large", query, why, understood=understood, suggestions=instead)


def _of_size(request: Request, around: Surroundings) -> Refusal | None:
    """Return the refusal of the first thing that no hand here can take, so that no other place is of use for it."""
    kinds = (IntentKind.PICK, IntentKind.PLACE)
    lifted = (intent.target for intent in request.intents if intent.kind in kinds)
    unfit = (why_unfit(target, around.scene, around.sizing) for target in lifted)
    return next((Refusal("too-large", why) for why in unfit if why is not None), None)


def why_unfit(target: str, scene: Scene, sizing: Sizing) -> str | None:
    """Return why an object fits the gripper at no permitted scale, and what would fit; None where it does."""
    gripper = Gripper.of(scene.robot)
    unfit = sizing.unfit(scene[target], gripper)
    if unfit is None:
        return None
    width_m = min(scene[target].extent_m[:2])
    why = f"{target} is {width_m:.3f} m wide, the gripper takes at most {gripper.widest_m:.3f} m: it {unfit}"
    if not sizing.keep:
        why += f". Things up to {gripper.widest_scaled_m:.3f} m wide can be scaled to fit"
    fit = graspable_items(scene, sizing)
    return why + (f"; here {enumeration(fit[:_MOST_NAMED])} fit" if fit else "; nothing here fits")
