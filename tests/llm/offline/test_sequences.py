"""Any sequence of wishes: what is planned, a world apart can carry out, in the order asked, and no more."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

import bddl
import llm
import oag
from llm.offline.intents import Intent, IntentKind, Request, order_for_one_hand
from tests.llm.kitchens import SCENES
from tests.llm.naive_world import World

ROOMS = tuple(SCENES[name] for name in ("breakfast", "pantry", "trio", "house", "bedroom", "two_glasses", "stocked"))
SPOTS = {
    "inside": ("refrigerator_0", "cabinet_0", "microwave_0", "wardrobe_0", "bowl_0"),
    "ontop": ("table_0", "cabinet_0", "plate_0", "bed_0", "desk_0", "nightstand_0"),
}
DOORS = ("refrigerator_0", "cabinet_0", "microwave_0", "wardrobe_0")


@st.composite
def requests(draw: st.DrawFn) -> tuple[Request, oag.Scene]:
    """Draw a scene and up to four wishes about its objects, sensible or not."""
    scene = draw(st.sampled_from(ROOMS))
    items = st.sampled_from(tuple(key for key, thing in scene.objects.items() if thing.role == "B"))
    doors = st.sampled_from(tuple(key for key in scene.objects if key in DOORS))
    door = st.builds(Intent, st.sampled_from((IntentKind.OPEN, IntentKind.CLOSE)), doors)
    pick = st.builds(Intent, st.just(IntentKind.PICK), items)
    # Now and then a place that cannot take anything, or itself.
    spots = [(relation, key) for relation, keys in SPOTS.items() for key in keys if key in scene.objects]
    anything = st.tuples(st.sampled_from(("inside", "ontop")), st.sampled_from(tuple(scene.objects)))
    spot = st.one_of(*[st.sampled_from(spots)] * 9, anything)
    place = st.builds(lambda item, at: Intent(IntentKind.PLACE, item, *at), items, spot)
    wishes = draw(st.lists(st.one_of(door, pick, place, place), min_size=1, max_size=4))
    return Request(tuple(wishes)), scene


def placed(intent: Intent) -> tuple[str, str]:
    """Return where a wish to place something wants it."""
    assert intent.relation is not None
    assert intent.destination is not None
    return intent.relation, intent.destination


def holds(intent: Intent, moment: tuple[dict[str, tuple[str, str]], dict[str, bool], str | None]) -> bool:
    """Decide in the world whether a wish is fulfilled at a moment."""
    where, is_open, hand = moment
    if intent.kind.is_about_a_door:
        return is_open.get(intent.target, False) is (intent.kind is IntentKind.OPEN)
    if intent.kind is IntentKind.PICK:
        return hand == intent.target
    return where.get(intent.target) == placed(intent)


@given(requests())
def test_a_plan_does_what_was_asked_and_nothing_else(drawn: tuple[Request, oag.Scene]) -> None:
    request, scene = drawn
    try:
        proposal = llm.propose(str(request), scene)
    except llm.QueryError as error:
        # The sentence is plain and names every object by its id, so only the scene can stand in the way: an apple that
        # the gripper can hold does not go into a glass that it can hold.
        things = [scene.objects[one.destination] for one in request.intents if one.destination in scene.objects]
        sizes = ("unproved",) if any(thing.role == "B" for thing in things) else ()
        assert error.code in ("affordance", "already-so", "hand-full", *sizes)
        return
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    world = World.of(scene)
    for step in proposal.task.subtasks:
        world.do(step)
    first, last = world.moments[0], world.moments[-1]

    # Each wish is fulfilled in its turn; what is picked up to be placed later may be picked up later, or stay.
    moment = 0
    for index, intent in enumerate(request.intents):
        later = request.intents[index + 1 :]
        on_the_way = intent.kind is IntentKind.PICK and any(other.target == intent.target for other in later)
        between = any(
            other.kind is IntentKind.PICK and any(w.target == other.target for w in request.intents[at + 1 :])
            for at, other in enumerate(request.intents)
        )
        if on_the_way or (between and intent.kind.is_about_a_door):
            continue
        moment = next(n for n in range(moment, len(world.moments)) if holds(intent, world.moments[n]))

    # At the end things are where the latest wish about them wants them, or where they were.
    latest = {intent.target: intent for intent in request.intents}
    for key in SCENES[scene.name].objects:
        if key in latest and not latest[key].kind.is_about_a_door:
            assert holds(latest[key], last), key
        elif key in first[0] and key not in latest:
            assert last[0].get(key) == first[0][key], key

    # Doors are as the latest wish about them wants them, or as they were; a full hand may leave one open.
    for door in (key for key in DOORS if key in scene.objects):
        before = first[1].get(door, False)
        about = [n for n, intent in enumerate(request.intents) if intent.target == door]
        wanted = before if not about else request.intents[about[-1]].kind is IntentKind.OPEN
        assert last[1].get(door, False) is wanted or (last[2] is not None and last[1][door])

    # The goal says no less than that.
    stated = {bddl.format(part) for part in bddl.conjuncts(proposal.task.goal)}
    assert {bddl.format(intent.wish) for intent in latest.values() if intent.kind is not IntentKind.CLOSE} <= stated


def test_a_wish_that_is_said_twice_in_a_row_is_one() -> None:
    put = Intent(IntentKind.PLACE, "glass_0", "inside", "refrigerator_0")
    twice = Request((put, Intent(IntentKind.PICK, "glass_0"), put))
    assert order_for_one_hand(twice) == Request((put,))


def test_a_picking_up_that_is_said_twice_is_one() -> None:
    pick, opened = Intent(IntentKind.PICK, "apple_0"), Intent(IntentKind.OPEN, "refrigerator_0")
    put = Intent(IntentKind.PLACE, "apple_0", "inside", "refrigerator_0")
    assert order_for_one_hand(Request((pick, opened, pick, put))) == Request((opened, put))


@given(requests())
def test_the_sentence_of_a_request_is_read_back(drawn: tuple[Request, oag.Scene]) -> None:
    request, scene = drawn
    try:
        name = llm.propose(str(request), scene).expanded.task_name
    except llm.QueryError as error:
        assert error.code in ("affordance", "already-so", "hand-full")
        return
    assert llm.propose(name, scene).expanded.task_name == name
