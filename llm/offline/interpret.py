"""From the readings of a query to the one wish that it expresses in a scene, or to a refusal that says why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from llm.intent import Intent, IntentKind, Relation
from llm.offline.commands import Command, Place, Reading
from llm.offline.feasible import check
from llm.offline.ground import Grounded, Grounding
from llm.offline.refusal import Refusal

_KINDS = {"open": IntentKind.OPEN, "close": IntentKind.CLOSE, "pick": IntentKind.PICK, "place": IntentKind.PLACE}
_RELATIONS: tuple[Relation, ...] = ("inside", "ontop")


@dataclass(frozen=True, slots=True)
class Interpretation:
    """A wish about objects of the scene, with what was taken on trust on the way."""

    intent: Intent
    notes: tuple[str, ...] = ()


def interpret(readings: Sequence[Reading], grounding: Grounding) -> Interpretation:
    """Returns the one wish that the readings allow in the scene.

    Args:
        readings: At least one.
        grounding: Names the scene's objects.

    Raises:
        Refusal: No reading makes sense (the refusal of the one that got furthest), or several different ones do.
    """
    found: dict[Intent, Interpretation] = {}
    refusals: list[Refusal] = []
    for reading in readings:
        try:
            meant = _of_reading(reading, grounding)
        except Refusal as refusal:
            refusal.understood = refusal.understood or "; ".join(str(command) for command in reading)
            refusals.append(refusal)
        else:
            found.setdefault(meant.intent, meant)
    undecided = [refusal for refusal in refusals if refusal.leaves_choice]
    if len(found) == 1 and not undecided:
        return next(iter(found.values()))
    if found and not undecided:
        raise Refusal(
            "ambiguous-reading",
            "it can be read in more than one way",
            instead=tuple(found),
        )
    raise max(undecided or refusals, key=lambda refusal: refusal.progress)


def _of_reading(reading: Reading, grounding: Grounding) -> Interpretation:
    """Returns the wish of one reading."""
    if len(reading) > 1:
        raise Refusal(
            "several-steps",
            f"it asks for {len(reading)} things; the offline planner takes one wish at a time, "
            "and plans the opening and closing on the way by itself",
            understood="; ".join(f"({index}) {command}" for index, command in enumerate(reading, start=1)),
        )
    command = reading[0]
    if len(command.objects) > 1:
        named = " and ".join(str(phrase) for phrase in command.objects)
        raise Refusal("several-objects", f"it names several objects ({named}); a query is about one object at a time")
    return _of_command(command, grounding)


def _of_command(command: Command, grounding: Grounding) -> Interpretation:
    """Returns the wish of one command about one object."""
    # Where to is grounded first: its refusal is the less telling one when both are unclear.
    destination = None if command.destination is None else grounding.one(command.destination.phrase)
    target = _target(command, grounding)
    for grounded in (target, destination):
        if grounded is not None and grounded.by_door and command.kind not in ("open", "close"):
            raise Refusal("affordance", f"the door of {grounded.object_id} can only be opened and closed")
    if command.kind == "bare":
        raise Refusal("not-understood", f"it names {target.object_id}, but not what to do with it")
    if command.kind == "nowhere":
        raise Refusal(
            "missing-place",
            f"it does not say where to put {target.object_id}",
            instead=_places_for(target.object_id, grounding),
        )
    relation = None
    notes = target.notes
    if command.destination is not None and destination is not None:
        relation = _relation(command.destination, target.object_id, destination, grounding)
        notes += destination.notes
    intent = Intent(_KINDS[command.kind], target.object_id, relation, destination.object_id if destination else None)
    check(intent, grounding.around)
    return Interpretation(intent, notes)


def _target(command: Command, grounding: Grounding) -> Grounded:
    """Returns the object that a command is about; a lone word that names none was meant as an action."""
    try:
        return grounding.one(command.objects[0], command.source)
    except Refusal as refusal:
        if command.kind == "bare" and refusal.code == "unknown-object":
            raise no_action() from None
        raise


def no_action(near: Sequence[str] = ()) -> Refusal:
    """Returns the refusal of a query without an action that the library has."""
    meant = f"; did you mean {' or '.join(near)}?" if near else ""
    return Refusal(
        "unknown-action",
        "it names no action of the library, which opens and closes things, picks them up, "
        f"and puts them into or onto others{meant}",
    )


def _relation(place: Place, target: str, destination: Grounded, grounding: Grounding) -> Relation:
    """Decides whether the preposition means inside or on top; "to" means whichever the destination affords."""
    where = destination.object_id
    both = [Intent(IntentKind.PLACE, target, relation, where) for relation in _RELATIONS]
    if place.direction == "BESIDE":
        raise Refusal(
            "unsupported-relation",
            f'the library puts things into and onto others; it cannot put {target} "{place.preposition}" {where}',
        )
    if place.direction in ("INTO", "IN"):
        if destination.by_surface:
            problem = f'"{place.phrase}" names the top of {where}, which has no interior'
            raise Refusal("affordance", problem, instead=both)
        return "inside"
    can = grounding.around.affordances[where]
    if place.direction in ("ONTO", "ON") or (destination.by_surface and can.surface):
        return "ontop"
    if can.interior and can.surface:
        raise Refusal(
            "ambiguous-relation",
            f'"{place.preposition} {where}" can mean inside it or on top of it',
            instead=both,
        )
    if not can.interior and not can.surface:
        raise Refusal("affordance", f"{where} has neither an interior nor a surface to put something at")
    return "inside" if can.interior else "ontop"


def _places_for(target: str, grounding: Grounding) -> list[Intent]:
    """Returns wishes that put the object somewhere it can go."""
    return [
        intent
        for intent in possible(grounding, (target,))
        if intent.kind is IntentKind.PLACE and intent.target == target
    ]


def possible(grounding: Grounding, about: Sequence[str]) -> list[Intent]:
    """Returns the wishes that can be planned in the scene and are about one of the objects, in the scene's order."""
    ids = tuple(grounding.around.scene.objects)
    wishes = [Intent(kind, key) for key in ids for kind in (IntentKind.OPEN, IntentKind.CLOSE, IntentKind.PICK)]
    wishes += [
        Intent(IntentKind.PLACE, key, relation, place) for key in ids for place in ids for relation in _RELATIONS
    ]
    return [wish for wish in wishes if {wish.target, wish.destination} & set(about) and is_possible(wish, grounding)]


def is_possible(wish: Intent, grounding: Grounding) -> bool:
    """Decides whether a wish can be planned in the scene."""
    try:
        check(wish, grounding.around)
    except Refusal:
        return False
    return True
