"""What a preposition means at a place: inside it, on top of it, or a spot next to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from llm.offline.grounding import Grounded
from llm.offline.housekeeping import Housekeeping
from llm.offline.intents import RELATIONS, Intent, IntentKind, Refusal, Relation, Request, enumeration
from llm.offline.reader import REFERENCE_DIRECTIONS, Command, Location
from llm.offline.viewpoint import referenced
from llm.offline.words import Direction
from oag.model.where import Where

SPOTS: Mapping[Direction, str] = {
    "NEXT": "next to",
    "LEFTOF": "left of",
    "RIGHTOF": "right of",
    "BEHIND": "behind",
    "INFRONT": "in front of",
}

# Other parts, such as the bottom, the back and the front, are of an interior as well.
_PARTS_OF_A_TOP = frozenset({"middle", "center", "centre", "corner", "edge"})


def placings(ids: Sequence[str], relation: Relation, place: str, where: Where | None = None) -> tuple[Intent, ...]:
    """Return the intents that put things at one place."""
    return tuple(Intent(IntentKind.PLACE, key, relation, place, where) for key in ids)


@dataclass(slots=True)
class Placing(Housekeeping):
    """Relations and spots in the state of a scene."""

    def _on_its_side(self, place: Location, grounded: Grounded) -> Location:
        """Return "on the table" for "on the left side of the table", which is a part of it and no place next to it."""
        can = self.grounding.around.affordances[grounded.object_id]
        next_to = place.direction not in ("LEFTOF", "RIGHTOF") or "side of" not in place.preposition
        if next_to or not can.surface or self._hosts(grounded.object_id):
            return place
        self.notes.append(f'"{place.preposition}" changes nothing in the plan: {grounded.object_id} has no such spot')
        return replace(place, direction="ON", loose=True)

    def _below(self, place: Location, grounded: Grounded) -> tuple[Location, Grounded]:
        """Return the only cupboard under the sink for "under the sink"; other places unchanged."""
        scene, names = self.grounding.around.scene, self.grounding.names
        entry = names.entries[scene.objects[grounded.object_id].category]
        if place.direction != "UNDER" or entry is None or not entry.fitted:
            return place, grounded
        kind = names.lexicon.categories[entry.fitted]
        alike = [key for key, thing in scene.objects.items() if names.entries[thing.category] is kind]
        below = referenced(alike, "UNDER", (grounded.object_id,), scene)
        if len(below) != 1:
            return place, grounded
        self.notes.append(f'"{place}" is taken for into {below[0]}, which stands under {grounded.object_id}')
        return Location("INTO", replace(place.phrase, words=(below[0],), location=None), "into"), Grounded(below[0])

    def _spot(self, command: Command, place: Grounded) -> Where | None:
        """Return the spot that "next to the cup" names, on or in what the cup is on or in; None where it names none."""
        relation = None if command.destination is None else SPOTS.get(command.destination.direction)
        if relation is None or not self._hosts(place.object_id):
            return None
        if relation != "next to":
            self.notes.append(f'"{relation} {place.object_id}" is meant as seen from the robot\'s start')
        return Where(relation, place.object_id)

    def _with_spot(self, place: Location) -> Location:
        """Return "next to the bowl on the table" for "on the table next to the bowl" whose bowl stands there.

        Where it stands elsewhere, the words tell which table is meant.
        """
        at = place.phrase.location
        if at is None or at.direction not in SPOTS or place.direction not in ("ON", "ONTO", "IN", "INTO", "TO"):
            return place
        whole = replace(place.phrase, location=None)
        there = Location("IN" if place.direction in ("IN", "INTO") else "ON", whole, place.preposition)
        try:
            if at.phrase.location is None:
                # Of two tables that is meant on which it stands.
                landmark = replace(at.phrase, location=there)
                stands = bool(self._hosts(self.grounding.one(landmark).object_id))
            else:
                landmark, known = at.phrase, self.grounding.one(whole).object_id
                stands = known in {step.object_id for step in self._hosts(self.grounding.one(landmark).object_id)}
        except Refusal:
            return place
        return replace(at, phrase=landmark) if stands else place

    def _relation(self, place: Location, targets: Sequence[str], destination: Grounded) -> Relation:
        """Decide whether the preposition means inside or on top; "to" means what the destination affords."""
        where = destination.object_id
        both = [Request(placings(targets, relation, where)) for relation in RELATIONS]
        self._check_direction(place, targets, destination)
        can = self.grounding.around.affordances[where]
        if place.direction in ("INTO", "IN"):
            boards = self._is_in_by_on(where)
            if self._is_on_top(place, destination):
                self.notes.append(
                    f'"{place.preposition} {where}" is taken for on top of it; "into" is into a drawer of it'
                )
                return "ontop"
            if (place.loose or boards) and can.surface and not can.interior:
                return "ontop"
            if destination.by_surface:
                problem = f'"{place.phrase}" names the top of {where}, which has no interior'
                raise Refusal("affordance", problem, instead=both)
            return "inside"
        shelf = destination.part is not None and destination.part.part == "shelf"
        if place.direction in ("ONTO", "ON") and shelf and can.interior:
            return "inside"  # A shelf of a refrigerator is in it.
        if place.direction in ("ONTO", "ON") or (destination.by_surface and can.surface):
            return "ontop"
        if destination.hollow and can.interior:
            return "inside"  # "To the top drawer of the cabinet".
        if can.interior and can.surface:
            return self._usual_side(place, targets, destination)
        if not can.interior and not can.surface:
            raise Refusal("affordance", f"{where} has neither an interior nor a surface to put something at")
        return "inside" if can.interior else "ontop"

    def _usual_side(self, place: Location, targets: Sequence[str], destination: Grounded) -> Relation:
        """Return what "to" means of a place with an interior and a top, with a note.

        What opens by drawers alone has a top to put things on, and people name the drawer otherwise. All else keeps
        things: of 700 sentences of ALFRED 7 say "to the cabinet", and in all 7 something is put into it. What is on it
        or in it has no way to it.
        """
        where = destination.object_id
        there = {
            step.relation for key in targets for step in self.grounding.around.supports(key) if step.object_id == where
        }
        if len(there) == 1:
            return there.pop()
        entry = self.grounding.names.entries[self.grounding.around.scene.objects[where].category]
        if entry is not None and entry.affordances.fronts == {"drawer"}:
            self.notes.append(f'"{place.preposition} {where}" is taken for on top of it; "into" is into a drawer of it')
            return "ontop"
        if place.phrase.location is not None and place.phrase.location.direction == "UNDER":
            self.notes.append(f'"{place.preposition} {where}" is taken for into it, since something stands above it')
        else:
            self.notes.append(f'"{place.preposition} {where}" is taken for into it; "onto" is onto its top')
        return "inside"

    def _is_on_top(self, place: Location, destination: Grounded) -> bool:
        """Decide whether "in the middle of" is said of the top of what opens by drawers alone, and of no drawer."""
        where = destination.object_id
        entry = self.grounding.names.entries[self.grounding.around.scene.objects[where].category]
        by_drawers = entry is not None and entry.affordances.fronts == {"drawer"} and entry.affordances.surface
        of_a_top = not _PARTS_OF_A_TOP.isdisjoint(place.preposition.split())
        return of_a_top and by_drawers and not destination.hollow and not place.phrase.door

    def _check_direction(self, place: Location, targets: Sequence[str], destination: Grounded) -> None:
        """Raise the refusal of a preposition that only distinguishes objects."""
        if place.direction in REFERENCE_DIRECTIONS:
            host = next(iter(self._hosts(destination.object_id)), None)
            known = [key for key in targets if key in self.grounding.around.scene.objects]
            near = () if host is None or not known else (Request(placings(known, host.relation, host.object_id)),)
            raise Refusal(
                "unsupported-relation",
                f"the library puts things into and onto others; it cannot put {enumeration(targets)} "
                f'"{place.preposition}" {destination.object_id}'
                + ("" if place.other is None else f" and {place.other}"),
                instead=near,
            )
