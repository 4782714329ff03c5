"""Whether wishes make sense in the scene: the objects afford them, one hand can do them, and they are not so yet.

Also which wishes could be planned instead: what a refusal suggests.
"""

from __future__ import annotations

from collections.abc import Sequence

from llm.offline.surroundings import Surroundings
from llm.offline.wish import RELATIONS, Intent, IntentKind, Refusal, Request
from oag.model.facts import GRIPPER
from oag.task.sizes import Gripper

MOST_NAMED = 12
MOST_OTHERS = 24
# What two fingers need, together, beside the thing that they lower into a vessel.
FINGER_ROOM_M = 0.04


def check_all(request: Request, around: Surroundings) -> tuple[Intent, ...]:
    """Returns which wishes are fulfilled already when their turn comes, so that nothing is done for them.

    A closing of what an earlier wish has opened on its way is none of them: it says what happens anyway.

    Raises:
        Refusal: One of the wishes cannot be fulfilled in its turn, or all are fulfilled already.
    """
    for intent in request.intents:
        if not intent.kind.is_about_a_door:
            check_item(intent.target, around)
    state = around
    idle: list[Intent] = []
    needless: list[Refusal] = []
    on_the_way: set[str] = set()
    for intent in request.intents:
        try:
            check(intent, state)
        except Refusal as refusal:
            if refusal.code != "already-so":
                raise
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


def check(intent: Intent, around: Surroundings) -> None:
    """Raises the Refusal of a wish that no plan of the library can or need fulfil."""
    target = intent.target
    if not intent.kind.is_about_a_door:
        check_item(target, around)
        _check_standing(target, around)
        if intent.kind is IntentKind.PLACE:
            _check_destination(intent, around)
        _check_reachable(intent, around)
        return
    if not around.affordances[target].door:
        raise _lacks(target, "no door to open or close", around)
    if around.is_open(target) is (intent.kind is IntentKind.OPEN):
        raise _so_already(intent)
    _check_free_hand(around, f"to {intent.kind.value} {target}")


def check_item(target: str, around: Surroundings) -> None:
    """Raises the Refusal of lifting what is no item."""
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
    """Placing needs a destination that can take the item and does not hold it yet."""
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
        raise _lacks(destination, "no interior to put something into", around, (other,) if can.surface else ())
    if relation == "ontop" and not can.surface:
        other = Intent(IntentKind.PLACE, target, "inside", destination)
        raise _lacks(destination, "no surface to put something onto", around, (other,) if can.interior else ())
    if relation == "inside" and not _goes_in(target, destination, around):
        raise Refusal("affordance", f"{target}, as small as the gripper needs it, is too wide for {destination}")
    if any(step.relation == relation and step.object_id == destination for step in around.supports(target)):
        raise _so_already(intent)


def _goes_in(item: str, container: str, around: Surroundings) -> bool:
    """Decides whether an item, at the size that it will have, fits through another item's mouth, however turned."""
    thing, vessel = around.scene.objects[item], around.scene.objects[container]
    factor = around.sizing.factor(thing, Gripper.of(around.scene.robot))
    narrow, wide, _ = (factor * side for side in sorted(thing.extent_m))
    mouth_m = sorted(vessel.extent_m[:2])
    return vessel.role == "A" or (narrow < mouth_m[0] and wide < mouth_m[1])


def _check_reachable(intent: Intent, around: Surroundings) -> None:
    """A hand that holds something can neither open a door nor lift another thing."""
    if around.held() != (intent.target,):
        _check_free_hand(around, f"to pick up {intent.target}")
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


def possible(around: Surroundings, about: Sequence[str]) -> list[Intent]:
    """Returns wishes that can be planned in the scene and are about one of the objects, in the scene's order.

    Args:
        around: The scene and its facts.
        about: The objects; of many the first `MOST_NAMED` count, each with the first `MOST_OTHERS` of the others, so
            that a scene of hundreds costs no more than one of dozens.
    """
    named = set(about[:MOST_NAMED])
    can = around.affordances
    objects = around.scene.objects
    others = [key for key in objects if key not in named]
    items = {*named, *[key for key in others if objects[key].role == "B"][:MOST_OTHERS]}
    places = {*named, *[key for key in others if can[key].interior or can[key].surface][:MOST_OTHERS]}
    alone = (IntentKind.OPEN, IntentKind.CLOSE, IntentKind.PICK)
    wishes = [Intent(kind, key) for key in objects if key in named for kind in alone]
    wishes += [
        Intent(IntentKind.PLACE, key, relation, place)
        for key in filter(items.__contains__, objects)
        for place in filter(places.__contains__, objects)
        if key in named or place in named
        for relation in RELATIONS
    ]
    return [wish for wish in wishes if is_possible(wish, around)]


def is_possible(wish: Intent | Request, around: Surroundings) -> bool:
    """Decides whether a wish, or each wish of a request in its turn, can be planned in the scene and needs to be.

    It is stricter than `check`, which takes what is asked for: what is offered has to leave room for the fingers.
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
    """Decides whether there is room for the fingers, where an item is put into another one."""
    thing, vessel = around.scene.objects[wish.target], around.scene.objects.get(wish.destination or "")
    if vessel is None or wish.relation != "inside" or vessel.role == "A":
        return True
    factor = around.sizing.factor(thing, Gripper.of(around.scene.robot))
    sides = zip(sorted(thing.extent_m[:2]), sorted(vessel.extent_m[:2]), strict=True)
    return all(factor * side + FINGER_ROOM_M < mouth for side, mouth in sides)


def with_a_free_hand(request: Request, around: Surroundings) -> list[Request]:
    """Returns what one hand can do instead of what it was asked: pick things up last, or put them down."""
    picks = [intent for intent in request.intents if intent.kind is IntentKind.PICK]
    others = tuple(intent for intent in request.intents if intent.kind is not IntentKind.PICK)
    found = [Request((*others, pick)) for pick in picks]
    for pick in picks[:1]:
        for place in places_for((pick.target,), around):
            found.append(Request(tuple(place.intents[0] if intent == pick else intent for intent in request.intents)))
    return [wish for wish in found if is_possible(wish, around)]


def places_for(targets: Sequence[str], around: Surroundings, besides: Sequence[str] = ()) -> list[Request]:
    """Returns requests that put all of the objects at one fixture of the scene, each a different place.

    Args:
        targets: What has to go somewhere.
        around: The scene.
        besides: Fixtures that are not meant.
    """
    requests = [
        Request(tuple(Intent(IntentKind.PLACE, target, relation, place) for target in targets))
        for place, thing in around.scene.objects.items()
        for relation in RELATIONS
        if thing.role == "A" and place not in besides
    ]
    return [request for request in requests if is_possible(request, around)]
