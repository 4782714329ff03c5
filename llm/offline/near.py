"""Which wishes can be planned in a scene: what a refusal suggests instead."""

from __future__ import annotations

from collections.abc import Sequence

from llm.intent import Intent, IntentKind, Relation
from llm.offline.feasible import check, check_all
from llm.offline.refusal import Refusal
from llm.request import Request
from llm.surroundings import Surroundings
from oag.task.sizes import scale_factor

RELATIONS: tuple[Relation, ...] = ("inside", "ontop")
MOST_NAMED = 12
MOST_OTHERS = 24
# What two fingers need, together, beside the thing that they lower into a vessel.
FINGER_ROOM_M = 0.04


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


def _has_room(wish: Intent, around: Surroundings) -> bool:
    """Decides whether there is room for the fingers, where an item is put into another one."""
    thing, vessel = around.scene.objects[wish.target], around.scene.objects.get(wish.destination or "")
    if vessel is None or wish.relation != "inside" or vessel.role == "A":
        return True
    factor = scale_factor(thing)
    sides = zip(sorted(thing.extent_m[:2]), sorted(vessel.extent_m[:2]), strict=True)
    return all(factor * side + FINGER_ROOM_M < mouth for side, mouth in sides)


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
