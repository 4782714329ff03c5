"""What people expect of the places of a home: where things are usually kept, thrown away, and put in or on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from llm.offline.grounding import Grounded, Grounding
from llm.offline.intents import Intent, IntentKind, Refusal, Support, enumeration, no_action
from llm.offline.reader import Command, Location, NounPhrase
from llm.offline.subtasks import is_possible, places_for
from llm.offline.viewpoint import gap_m
from oag.model.symbols import has_boards


@dataclass(slots=True)
class Housekeeping:
    """Usual places in the state of a scene, and the notes on what was assumed of them."""

    grounding: Grounding
    notes: list[str] = field(default_factory=list, kw_only=True)

    def _is_item(self, key: str) -> bool:
        return self.grounding.around.scene.objects[key].role == "B"

    def _hosts(self, key: str) -> list[Support]:
        around = self.grounding.around
        return [step for step in around.supports(key) if step.object_id in around.scene.objects]

    def _is_waste(self, key: str) -> bool:
        """Decide whether "throw" means putting a thing there."""
        names = self.grounding.names
        entry = names.entries[self.grounding.around.scene.objects[key].category]
        return entry is not None and entry.waste

    def _waste_place(self) -> Location:
        """Return the only place for waste, where "throw it away" puts a thing."""
        around = self.grounding.around
        bins = [key for key, thing in around.scene.objects.items() if thing.role == "A" and self._is_waste(key)]
        if len(bins) != 1:
            raise no_action()
        self.notes.append(f"{bins[0]} is the only place for waste")
        return Location("INTO", NounPhrase((bins[0],)), "into")

    def _takes(self, place: Location) -> Callable[[str], bool]:
        """Return what tells like places apart: whether things go into them, or onto them, as the preposition says."""
        affordances = self.grounding.around.affordances
        if place.direction in ("INTO", "IN"):
            return lambda key: (
                affordances[key].interior or has_boards(self.grounding.around.scene.objects[key].category)
            )
        return lambda key: place.direction not in ("ONTO", "ON") or affordances[key].surface or affordances[key].top

    def _goes_in(self, command: Command, grounded: Grounded) -> bool:
        """Decide whether the destination is a hollow part: a drawer, but not a door."""
        place = command.destination
        if place is None or place.direction not in ("INTO", "IN", "TO") or not grounded.hollow:
            return False
        return self.grounding.around.affordances[grounded.object_id].interior

    def _is_in_by_on(self, key: str) -> bool:
        """Decide whether people say "in" of what is on a thing: on the boards of a shelf, and on a seat."""
        category = self.grounding.around.scene.objects[key].category
        entry = self.grounding.names.entries[category]
        return has_boards(category) or (entry is not None and entry.seat)

    def _anywhere(self, ids: Sequence[str], cleared: Grounded, *, guess: bool = True) -> tuple[Intent, ...]:
        """Return the intents that put objects at the only other place for them, or at their usual places.

        Cleared is what is empty in the end: what has no usual place goes onto the nearest other surface.
        """
        around, here = self.grounding.around, cleared.object_id
        choices = places_for(ids, around, avoided=(here,))
        if len(choices) != 1:
            usual = {key: self._usual_place(key, here) if guess else None for key in ids}
            found = {key: intent or (self._onto_nearest(key, here) if guess else None) for key, intent in usual.items()}
            if all(found.values()):
                return self._put_away(found, [key for key in ids if not usual[key]])
            problem = f"it does not say where to put {enumeration(key for key in ids if not found[key])}"
            problem += ", and several places can take them" if choices else ", and no other place can take them"
            raise Refusal("missing-place", problem, instead=choices)
        intents = choices[0].intents
        self.notes.append(f"{intents[0].destination} is the only other place that can take {enumeration(ids)}")
        return intents

    def _onto_nearest(self, key: str, here: str) -> Intent | None:
        """Return the intent that puts an object onto the surface nearest to where it is.

        Beds and seats come last; nothing is put onto the ground, and nothing where waste goes.
        """
        around, names = self.grounding.around, self.grounding.names
        tops: list[tuple[bool, float, Intent]] = []
        for place, thing in around.scene.objects.items():
            entry, intent = names.entries[thing.category], Intent(IntentKind.PLACE, key, "ontop", place)
            unfit = entry is not None and (entry.ground or entry.waste)
            if thing.role == "A" and place != here and around.affordances[place].surface and not unfit:
                soft = entry is not None and (entry.seat or entry.soft)
                tops += [(soft, gap_m(place, key, around.scene), intent)] if is_possible(intent, around) else []
        return min(tops, key=lambda top: top[:2])[2] if tops else None

    def _usual_place(self, key: str, avoided: str = "") -> Intent | None:
        """Return the intent that puts an object where people usually keep its kind; None without such a place."""
        around, names = self.grounding.around, self.grounding.names
        entry = names.entries[around.scene.objects[key].category]
        for relation, kind in names.lexicon.usual_places(entry):
            for place, thing in around.scene.objects.items():
                intent = Intent(IntentKind.PLACE, key, relation, place)
                if names.entries[thing.category] is kind and place != avoided and is_possible(intent, around):
                    return intent
        return None

    def _put_away(self, places: Mapping[str, Intent | None], unusual: Sequence[str] = ()) -> tuple[Intent, ...]:
        """Return the intents that put objects at their places, those of one place together, usual ones or not."""
        intents = [intent for intent in places.values() if intent is not None]
        order = [intent.destination for intent in intents]
        intents.sort(key=lambda intent: order.index(intent.destination))
        self.notes += [
            f"no usual place of {intent.target} is known; {intent.destination} is the nearest other surface"
            if intent.target in unusual
            else f"{intent.destination} is taken for the usual place of {intent.target}"
            for intent in intents
        ]
        return tuple(intents)

    def _tidied(self, command: Command) -> tuple[Intent, ...]:
        """Return the intents that put everything that lies about where people usually keep it."""
        around = self.grounding.around
        items = [key for key, thing in around.scene.objects.items() if thing.role == "B"]
        loose = [key for key in items if not any(step.object_id in items for step in around.supports(key))]
        usual = {key: self._usual_place(key) for key in loose if not self._is_kept(key)}
        lying = [key for key, intent in usual.items() if intent is None and self._is_on_the_ground(key)]
        usual |= {key: self._onto_nearest(key, around.supports(key)[0].object_id) for key in lying}
        unplaced = [key for key, intent in usual.items() if intent is None]
        if len(unplaced) == len(usual):
            problem = f"no usual place is known for {enumeration(unplaced)}" if unplaced else "everything is tidy"
            raise Refusal("missing-place" if unplaced else "already-so", problem)
        self.notes += [f"no usual place of {key} is known; it stays where it is" for key in unplaced]
        return self._put_away(usual, lying)

    def _is_on_the_ground(self, key: str) -> bool:
        names, objects = self.grounding.names, self.grounding.around.scene.objects
        hosts = (names.entries[objects[host.object_id].category] for host in self._hosts(key))
        return any(entry is not None and entry.ground for entry in hosts)

    def _is_kept(self, key: str) -> bool:
        """Decide whether an object is at one of its usual places."""
        around, names = self.grounding.around, self.grounding.names
        entry = names.entries[around.scene.objects[key].category]
        usual = names.lexicon.usual_places(entry)
        kinds = [(s.relation, names.entries[around.scene.objects[s.object_id].category]) for s in self._hosts(key)]
        return any(relation == where and kind is host for relation, kind in usual for where, host in kinds)
