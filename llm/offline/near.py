"""Which wishes can be planned in a scene: what a refusal suggests instead."""

from __future__ import annotations

from collections.abc import Sequence

from llm.intent import Intent, IntentKind, Relation
from llm.offline.feasible import check, check_all
from llm.offline.refusal import Refusal
from llm.request import Request
from llm.surroundings import Surroundings

RELATIONS: tuple[Relation, ...] = ("inside", "ontop")


def possible(around: Surroundings, about: Sequence[str]) -> list[Intent]:
    """Returns the wishes that can be planned in the scene and are about one of the objects, in the scene's order."""
    ids = tuple(around.scene.objects)
    wishes = [Intent(kind, key) for key in ids for kind in (IntentKind.OPEN, IntentKind.CLOSE, IntentKind.PICK)]
    wishes += [Intent(IntentKind.PLACE, key, relation, place) for key in ids for place in ids for relation in RELATIONS]
    return [wish for wish in wishes if {wish.target, wish.destination} & set(about) and is_possible(wish, around)]


def is_possible(wish: Intent | Request, around: Surroundings) -> bool:
    """Decides whether a wish, or each wish of a request in its turn, can be planned in the scene and needs to be."""
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
