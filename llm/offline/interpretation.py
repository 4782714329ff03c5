"""Interpret a reading: resolve pronouns ("it", "them", "there") and turn its commands into intents, in order.

A pronoun refers to objects that earlier commands of the same query mention. Each command is interpreted in the
state after those before it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from llm.offline import arranging
from llm.offline.discourse import Discourse, Mention, resolved
from llm.offline.grounding import Grounded, Grounding
from llm.offline.intents import (
    Intent,
    IntentKind,
    Refusal,
    Relation,
    Request,
    Support,
    Surroundings,
    carries_past_doors,
    enumeration,
    merge_repeated,
    no_action,
    order_for_one_hand,
)
from llm.offline.names import singulars
from llm.offline.placing import SPOTS, placings
from llm.offline.reader import SWITCHINGS, Command, Location, NounPhrase, Reading
from llm.offline.referring import Referring
from llm.offline.subtasks import check_all, check_item, is_possible, places_for, why_unfit, with_a_free_hand
from llm.offline.switching import switchings
from llm.offline.words import Direction
from oag.model.symbols import Kind
from oag.model.where import Where

_IN_OR_ON: Mapping[Relation, str] = {"inside": "in", "ontop": "on"}
_KINDS = {"open": IntentKind.OPEN, "close": IntentKind.CLOSE, "pick": IntentKind.PICK, "place": IntentKind.PLACE}


def interpret_reading(reading: Reading, grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Return the request of one reading, in an order for one hand, and the assumptions."""
    wishes = _IntentBuilder(grounding, Discourse(grounding.around))
    commands = resolved(reading, grounding)
    for command, following in zip(commands, (*commands[1:], None), strict=True):
        wishes.add(command, following)
    if not wishes.intents:
        raise Refusal("not-understood", "it does not say what to do there")
    asked = merge_repeated(wishes.intents)
    request = order_for_one_hand(asked)
    try:
        idle = check_all(request, grounding.around)
    except Refusal as refusal:
        if refusal.code == "hand-full":
            refusal.instead = (*refusal.instead, *with_a_free_hand(request, grounding.around))
        raise
    notes = [*wishes.notes, *(f"{intent.outcome} already; nothing is done for it" for intent in idle)]
    if carries_past_doors(asked):
        notes.append("the hand has to be free for a handle, so nothing is carried while a door is opened or closed")
    return request, tuple(dict.fromkeys(notes))


@dataclass(slots=True)
class _IntentBuilder(Referring):
    """Intents so far; the state after them determines the meaning of the next words."""

    reached: str | None = None
    start: Surroundings = field(init=False)

    def __post_init__(self) -> None:
        self.start = self.grounding.around

    def add(self, command: Command, following: Command | None) -> None:
        """Append the intents of the next command; the one after it may state where things go."""
        self.verbs += not command.carried
        if command.kind == "goto":
            reached = self.grounding.one(command.objects[0])
            self.notes += reached.notes
            self.reached = reached.object_id
            mention = Mention((), self.reached)
            if following is None or following.kind == "goto":
                raise self._only_gone()
        elif command.kind == "clear":
            # "Clear the table and put everything into the fridge" says where to.
            placed = following is not None and any(phrase.everything or phrase.pronoun for phrase in following.objects)
            mention = self._clear(command, guess=not placed)
        elif command.kind == "find":
            mention = self._found(command, following)
        elif command.kind in _ARRANGING:
            mention = Mention(_ARRANGING[command.kind](self, command))
        else:
            placed = following is not None and any(phrase.pronoun for phrase in following.objects)
            if placed and (command.kind, following and following.kind) == ("nowhere", "place"):
                # "Move the can from the table and put it in the bin".
                command = replace(command, kind="pick")
            mention = self._wished(command, placed)
        mention = self._along(mention)
        if command.kind not in ("goto", "find") and self.reached is not None:
            if not any(self._is_there(intent, self.reached) for intent in mention.intents):
                raise self._only_gone()
            self.reached = None
        kept = {intent.target: intent for intent in mention.intents if command.stays and self._stays(intent)}
        self.intents = [intent for intent in self.intents if intent.target not in kept]
        if kept and not self.intents:
            raise Refusal("already-so", f"{enumeration(kept)} stays where it is; there is nothing else to do")
        self.notes += [
            f"{key} stays {'in' if i.relation == 'inside' else 'on'} {i.destination}" for key, i in kept.items()
        ]
        if command.kind != "find":
            self.intents += [intent for intent in mention.intents if intent.target not in kept]
        self.discourse.mentions.append(mention)
        state = self.start
        for intent in self.intents:
            state = state.after(intent)
        self.grounding = replace(self.grounding, around=state)

    def _along(self, mention: Mention) -> Mention:
        """Return a mention without what moves along: the fork put into the pan, in "put both on the table"."""
        held = {i.target: i.destination for i in self.intents if i.kind.moves_an_item}
        goals = {i.target: (i.destination, i.relation) for i in mention.intents if i.kind is IntentKind.PLACE}
        along = {key for key, goal in goals.items() if goal == goals.get(held.get(key) or "")}
        self.notes += [f"{key} moves along with {held[key]}" for key in goals if key in along]
        return replace(mention, intents=tuple(intent for intent in mention.intents if intent.target not in along))

    def _found(self, command: Command, following: Command | None) -> Mention:
        """Return the mention of things that are to be found, which is a part of what is done with them next."""
        places = () if following is None else (following.source, following.destination)
        spoken = () if following is None else following.objects
        spoken += tuple(place.phrase for place in places if place is not None)
        again = {phrase.words[-1] for phrase in spoken} >= {phrase.words[-1] for phrase in command.objects}
        if not again and not any(phrase.pronoun for phrase in spoken):
            raise no_action()
        ids = self._ids(command)
        fixtures = [key for key in ids if not self._is_item(key)]
        # "It" is none of several pieces of furniture.
        place = fixtures[0] if len(fixtures) == 1 else None
        intents = tuple(Intent(IntentKind.PICK, key) for key in ids if self._is_item(key))
        return Mention(intents, place, plural=self._is_plural(command.objects))

    def _stays(self, intent: Intent) -> bool:
        """Decide whether "but leave it there" takes a thing out of the wishes before it.

        Raises:
            Refusal: It contradicts them.
        """
        earlier = [
            i for i in self.intents if i.target == intent.target and i.kind in (IntentKind.PICK, IntentKind.PLACE)
        ]
        if intent.kind is not IntentKind.PLACE or not earlier or earlier[-1] == intent:
            return False
        if self.start.fulfils(intent):
            return True
        if all(i.kind is IntentKind.PICK for i in earlier):
            return False
        problem = f"the wishes before it move {intent.target}, and it cannot stay where it is not: {intent}"
        raise Refusal("wrong-place", problem, scene=[self.start.described(intent.target)])

    def _is_there(self, intent: Intent, place: str) -> bool:
        """Decide whether an intent is fulfilled at a place: about it, or about an object there."""
        stands = (step.object_id for step in self.grounding.around.chain(intent.target))
        return place in (intent.target, intent.destination, *stands)

    def _only_gone(self) -> Refusal:
        problem = f"it does not say what to do at {self.reached}"
        return Refusal("not-understood", f"{problem}; going somewhere is planned as a part of what is done there")

    def _wished(self, command: Command, placed: bool) -> Mention:
        """Return the intents of a command; `placed` is whether the next command places its objects."""
        spoken = (*command.objects, *(() if command.destination is None else (command.destination.phrase,)))
        sided = next((phrase for phrase in spoken if phrase.towards), None)
        if sided is not None and command.kind in ("place", "nowhere", "away", "toss"):
            named = " ".join(command.objects[0].words)
            problem = f'"to the {sided.side}" says where to put "{named}", and a plan tells places apart, but no spots'
            raise Refusal("unsupported-relation", f'{problem}; "on the {sided.side}" says which one is meant')
        if command.kind == "push" and (command.destination is None or command.destination.direction not in SPOTS):
            raise _pushed_nowhere(command)
        source = self._source(command)
        if command.kind == "place":
            command = replace(command, objects=tuple(map(self._as_load, command.objects)))
        if command.destination is not None:
            command = replace(command, destination=self._with_spot(command.destination))
        if command.kind == "toss" and command.destination is None:
            command = replace(command, destination=self._waste_place())
        targets, place = self._ends(command, source)
        if command.kind == "toss" and place is not None and not self._is_waste(place.object_id):
            refusal = no_action()
            refusal.problem = f"{place.object_id} is no place for waste, and {refusal.problem}"
            refusal.decides = True
            raise refusal
        if place is not None and command.destination is not None:
            command = replace(command, destination=self._on_its_side(command.destination, place))
        for grounded in (*targets, *(() if place is None else (place,))):
            if grounded.by_door and command.kind not in ("open", "close") and not self._goes_in(command, grounded):
                raise Refusal("affordance", f"the door of {grounded.object_id} can only be opened and closed")
            if grounded.by_surface and command.kind in ("open", "close"):
                raise Refusal("affordance", f"the top of {grounded.object_id} has no door to open or close")
        ids = [grounded.object_id for grounded in targets]
        if command.kind == "bare":
            raise Refusal("not-understood", f"it names {enumeration(ids)}, but not what to do with it")
        if command.kind in ("nowhere", "away"):
            return self._put_somewhere(command, ids)
        self.notes += [note for grounded in targets for note in grounded.notes]
        as_one = any(phrase.everything for phrase in command.objects)
        origin = self._origin(source)
        held_at = source or command.objects[0].location
        if command.kind == "pick" and as_one and held_at is not None and not placed:
            return Mention(self._anywhere(ids, self.grounding.one(held_at.phrase)), origin, True)
        if command.destination is None or place is None:
            intents = tuple(Intent(_KINDS[command.kind], t.object_id, where=t.part) for t in targets)
            return Mention(intents, origin, as_one, self._is_plural(command.objects))
        as_one = as_one or any(phrase.load for phrase in command.objects)
        return Mention(self._placed(command, targets, place), origin, as_one, self._is_plural(command.objects))

    def _is_plural(self, phrases: Sequence[NounPhrase]) -> bool:
        """Decide whether the one name is a plural that names a single thing, such as "the keys"."""
        words, names = phrases[0].words, self.grounding.names
        ones = [names.by_name(one).ids for one in singulars(words[-1])]
        return len(phrases) == 1 and bool(ids := names.by_name(words[-1]).ids) and ids in ones

    def _put_somewhere(self, command: Command, ids: Sequence[str]) -> Mention:
        """Return the intents that put things where they usually are, or where the robot has been sent."""
        there = command.objects[0].location
        if command.kind == "away" and there is not None:
            return Mention(self._anywhere(ids, self.grounding.one(there.phrase)))
        usual = {key: self._usual_place(key) for key in ids}
        if command.kind == "away" and all(usual.values()):
            return Mention(self._put_away(usual))
        if command.kind == "nowhere" and self._set_down(command, ids):
            return self._put_at_reached(ids)
        for key in ids:
            check_item(key, self.grounding.around)
        places = places_for(ids, self.grounding.around)
        raise Refusal("missing-place", f"it does not say where to put {enumeration(ids)}", instead=places)

    def _placed(self, command: Command, targets: Sequence[Grounded], place: Grounded) -> tuple[Intent, ...]:
        """Return the intents that put things at a place, with what they shall hold."""
        if command.destination is None:
            raise ValueError(f"{command} has no destination")
        ids = [grounded.object_id for grounded in targets]
        self.notes += place.notes
        self.notes += (
            f'"{at.preposition} {at.phrase}" says which {phrase.words[-1]} is meant, and not where anything is put'
            for phrase in (*command.objects, command.destination.phrase)
            if (at := phrase.location) is not None and at.direction in SPOTS
        )
        there, place = self._below(command.destination, place)
        command = replace(command, destination=there)
        loads = self._loads(command, targets, place)
        if (spot := self._spot(command, place)) is not None:
            return (*loads, *self._put_next_to(command, ids, spot))
        if command.kind == "push":
            raise _pushed_nowhere(command)
        relation = self._relation(there, ids, place)
        carried = self._carried(place, there)
        return (*loads, *placings(ids, relation, place.object_id, place.part), *carried)

    def _put_next_to(self, command: Command, ids: Sequence[str], spot: Where) -> tuple[Intent, ...]:
        """Return the intents that put things beside another one; what the hand cannot take there is pushed."""
        around, host = self.grounding.around, self._hosts(spot.other)[0]
        intents = []
        for intent in placings(ids, host.relation, host.object_id, spot):
            pushed = command.kind == "push"
            if not pushed and self._is_firm(host) and host in around.supports(intent.target):
                pushed = why_unfit(intent.target, around.scene, around.sizing) is not None
                if pushed:
                    self.notes.append(f"{intent.target} is too wide for the hand, and is pushed there")
            intents.append(replace(intent, kind=IntentKind.PUSH) if pushed else intent)
        return tuple(intents)

    def _is_firm(self, host: Support) -> bool:
        """Decide whether something can be pushed along where things are: on top of what is not loose itself."""
        return host.relation == "ontop" and self.grounding.around.scene.objects[host.object_id].kind is not Kind.ITEM

    def _as_load(self, phrase: NounPhrase) -> NounPhrase:
        """Return the bowl that shall hold an apple for "an apple in a bowl" that is nowhere."""
        at = phrase.location
        if at is None or not (phrase.whichever and at.phrase.whichever and at.direction in ("IN", "ON")):
            return phrase
        if not self.grounding.nowhere(phrase) or not self._is_item(self.grounding.one(at.phrase).object_id):
            return phrase
        return replace(at.phrase, load=(replace(phrase, location=None),), load_at=at.direction)

    def _loads(self, command: Command, targets: Sequence[Grounded], place: Grounded) -> tuple[Intent, ...]:
        """Return the intents that put into or onto moved things what the sentence says they hold, and they do not."""
        if not any(phrase.load for phrase in command.objects):
            return ()
        if len(targets) != 1:
            raise Refusal("several-objects", f'"{command}" loads several things; ask for one at a time')
        vessel, around = targets[0].object_id, self.grounding.around
        spoken = [(one, p) for p in command.objects[0].load for one in self.grounding.every(p, taken=(vessel,))]
        held = [one for one, _ in spoken]
        self.notes += [note for grounded in held for note in grounded.notes]
        for grounded in held:
            check_item(grounded.object_id, around)
        lacking = {
            one.object_id: phrase
            for one, phrase in spoken
            if all(step.object_id != vessel for step in around.supports(one.object_id))
        }
        can, at = around.affordances[vessel], command.objects[0].load_at
        relation: Relation = "ontop" if at == "ON" or (at != "IN" and not can.interior) else "inside"
        only: Relation | None = None if can.interior is can.surface else "inside" if can.interior else "ontop"
        holders = [key for key in lacking if around.affordances[key].interior or around.affordances[key].surface]
        if only not in (None, relation) and lacking and not holders and not command.objects[0].load_apart:
            # "A cup with a spoon on it" has it inside, and "a plate with a fork in it" on top.
            self.notes.append(f'"{command.objects[0]}" has it {_IN_OR_ON[only]} {vessel}: there is no other way')
            relation = only
        loads = placings(tuple(lacking), relation, vessel)
        if lacking and at == "FROM":
            check_item(vessel, around)
            if any(self._goes_along(key, phrase, vessel) for key, phrase in lacking.items()):
                raise self._with(command, loads, place)
            where = f"{_IN_OR_ON[relation]} {vessel}"
            elsewhere = f"since {'it is' if len(lacking) == 1 else 'they are'} elsewhere"
            self.notes.append(f'"{command.objects[0]}" is taken for {enumeration(lacking)} {where}, {elsewhere}')
        return loads

    def _goes_along(self, key: str, phrase: NounPhrase, vessel: str) -> bool:
        """Decide whether "with the salt" may mean together with it: a certain thing, one that holds things itself."""
        affordances = self.grounding.around.affordances
        certain = phrase.definite or phrase.words == (key,) or (phrase.several and not phrase.whichever)
        holders = [affordances[one].interior or affordances[one].surface for one in (key, vessel)]
        return certain or holders != [False, True]

    def _with(self, command: Command, loads: Sequence[Intent], place: Grounded) -> Refusal:
        """Return the refusal of "the mug with the salt": the salt in the mug, or both of them."""
        items, vessel = [intent.target for intent in loads], str(loads[0].destination)
        instead: list[Request] = []
        if command.destination is not None and self._spot(command, place) is None:
            relation = self._relation(command.destination, [vessel], place)
            moved = placings((vessel, *items), relation, place.object_id, place.part)
            instead = [Request(moved), Request((*loads, moved[0]))]
        together = f"{enumeration((vessel, *items))}, or {vessel} holding {enumeration(items)}"
        problem = f'"{command.objects[0]}" can mean {together}, as the scene does not state it'
        around = self.grounding.around
        return Refusal("ambiguous-reading", problem, instead=[wish for wish in instead if is_possible(wish, around)])

    def _carried(self, place: Grounded, spoken: Location) -> tuple[Intent, ...]:
        """Return the intent that puts a vessel where "a bowl on the table" says it shall be, if it is elsewhere."""
        there = spoken.phrase.location
        if there is None or not place.moves:
            return ()
        goal = self._destination(there, [place.object_id])
        self.notes += [f'"{spoken.phrase}" is nowhere, so that {place.object_id} is put there', *goal.notes]
        return placings((place.object_id,), self._relation(there, [place.object_id], goal), goal.object_id, goal.part)

    def _set_down(self, command: Command, ids: Sequence[str]) -> bool:
        """Decide whether "put it down" means where the robot has been sent, or where the thing has just been put."""
        if not any(phrase.pronoun for phrase in command.objects) or command.source is not None:
            return False
        last = self.discourse.mentions[-1]
        placed = all(intent.kind is IntentKind.PLACE for intent in last.intents) and set(ids) <= set(last.themes)
        return self.reached is not None or placed

    def _put_at_reached(self, ids: Sequence[str]) -> Mention:
        if self.reached is None:
            return self.discourse.mentions[-1]
        place = Location("TO", NounPhrase((self.reached,)), "to")
        return Mention(placings(ids, self._relation(place, ids, Grounded(self.reached)), self.reached))

    def _clear(self, command: Command, *, guess: bool) -> Mention:
        phrase = command.objects[0]
        direction: Direction = "FROM"
        held_at = phrase.location if phrase.everything else None
        if held_at is not None:
            phrase, direction = held_at.phrase, held_at.direction
        cleared = Grounded(self._holder_spoken_of(phrase)) if phrase.pronoun else self.grounding.one(phrase)
        can = self.grounding.around.affordances[cleared.object_id]
        if not can.interior and not can.surface:
            raise Refusal("affordance", f"{cleared.object_id} has neither an interior nor a surface to clear")
        if command.destination is not None:
            command = replace(command, destination=self._with_spot(command.destination))
        place = None if command.destination is None else self._destination(command.destination)
        direction = "ON" if cleared.by_surface else direction
        source = Location(direction, NounPhrase((cleared.object_id,)), direction.lower())
        held = self.grounding.items(NounPhrase(("everything",)), source, () if place is None else (place.object_id,))
        ids = [grounded.object_id for grounded in held]
        self.notes += cleared.notes
        if command.destination is None or place is None:
            return Mention(self._anywhere(ids, cleared, guess=guess), cleared.object_id, True)
        self.notes += place.notes
        if (spot := self._spot(command, place)) is not None:
            host = self._hosts(place.object_id)[0]
            return Mention(placings(ids, host.relation, host.object_id, spot), cleared.object_id, True)
        relation = self._relation(command.destination, ids, place)
        return Mention(placings(ids, relation, place.object_id), cleared.object_id, True)

    def _swapped(self, command: Command) -> tuple[Intent, ...]:
        return arranging.swapped(self._things(command), self.grounding.around)

    def _nested(self, command: Command) -> tuple[Intent, ...]:
        return arranging.nested(self._things(command), self.grounding.around)

    def _stacked(self, command: Command) -> tuple[Intent, ...]:
        if command.destination is None:
            return arranging.stacked(self._things(command), self.grounding.around)
        targets, place = self._ends(command, None)
        self.notes += [note for one in (*targets, *((place,) if place else ())) for note in one.notes]
        ids = arranging.by_footprint([grounded.object_id for grounded in targets], self.grounding.around)
        if place is None:
            return arranging.stacked(ids, self.grounding.around)
        lowest = Intent(IntentKind.PLACE, ids[0], self._relation(command.destination, ids[:1], place), place.object_id)
        return arranging.stacked(ids, self.grounding.around, lowest)

    def _unstacked(self, command: Command) -> tuple[Intent, ...]:
        return arranging.unstacked(self._things(command), self.grounding.around)

    def _switched(self, command: Command) -> tuple[Intent, ...]:
        """Return the intents of switching things on or off, or to what they are not, where the sentence leaves it."""
        return switchings(self._ids(command), command.kind, command.part, self.grounding.around)

    def _stood(self, command: Command) -> tuple[Intent, ...]:
        ids, around = self._things(command), self.grounding.around
        if any(phrase.everything for phrase in command.objects):
            ids = [key for key in ids if around.can_stand(key) and around.is_upright(key) is False] or ids
        return tuple(Intent(IntentKind.STAND, key) for key in ids)

    def _brought(self, command: Command) -> tuple[Intent, ...]:
        ids = self._things(command, self._source(command))
        intents, note = arranging.brought(ids, self.grounding)
        self.notes.append(note)
        return intents


def _pushed_nowhere(command: Command) -> Refusal:
    problem = f'"{command}" names no spot beside a thing; a thing is pushed along what it stands on, beside another one'
    return Refusal("unsupported-relation", problem)


_ARRANGING: Mapping[str, Callable[[_IntentBuilder, Command], tuple[Intent, ...]]] = {
    "swap": _IntentBuilder._swapped,
    "stack": _IntentBuilder._stacked,
    "nest": _IntentBuilder._nested,
    "unstack": _IntentBuilder._unstacked,
    "bring": _IntentBuilder._brought,
    "liked": _IntentBuilder._brought,
    "stand": _IntentBuilder._stood,
    "tidy": _IntentBuilder._tidied,
    **dict.fromkeys(SWITCHINGS, _IntentBuilder._switched),
}
