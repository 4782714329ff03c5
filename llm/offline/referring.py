"""What the phrases of a command mean after the commands before it: the things it is about, and the place it names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

from llm.offline.discourse import Discourse
from llm.offline.grounding import Grounded
from llm.offline.intents import Intent, IntentKind, Refusal, enumeration, no_action
from llm.offline.names import is_again
from llm.offline.placing import SPOTS, Placing
from llm.offline.reader import Command, Location, NounPhrase
from llm.offline.subtasks import check_item

_INTO_OR_ONTO = ("INTO", "IN", "ONTO", "ON")


@dataclass(slots=True)
class Referring(Placing):
    """Things and places of commands, given the intents so far.

    Attributes:
        discourse: What was spoken of.
        intents: What is wished so far.
        taken: What "a glass" meant, and means no more.
        called: What was put somewhere -> its name, and the number of the verb.
        verbs: How many verbs there were.
    """

    discourse: Discourse
    intents: list[Intent] = field(default_factory=list)
    taken: set[str] = field(default_factory=set)
    called: dict[str, tuple[str, int]] = field(default_factory=dict)
    verbs: int = 0

    def _ends(self, command: Command, source: Location | None) -> tuple[tuple[Grounded, ...], Grounded | None]:
        if command.destination is None:
            return self._targets(command, source, ()), None
        goal = command.destination.phrase
        chooses = goal.pronoun or goal.whichever or "other" in goal.words
        if chooses and not any(phrase.everything for phrase in command.objects):
            targets = self._targets(command, source, ())
            return targets, self._destination(command.destination, [grounded.object_id for grounded in targets])
        # The destination is grounded first: its refusal is the less informative one if both fail.
        try:
            place = self._destination(command.destination)
        except Refusal as refusal:
            if refusal.leaves_choice:
                # What is not there needs no choice of where it would go.
                self._targets(command, source, ())
            raise
        try:
            return self._targets(command, source, (place.object_id,)), place
        except Refusal as refusal:
            is_spot = command.destination.direction in SPOTS and self._hosts(place.object_id)
            if refusal.leaves_choice and not is_spot:
                self._check_direction(command.destination, list(map(str, command.objects)), place)
            raise

    def _targets(self, command: Command, source: Location | None, avoided: Sequence[str]) -> tuple[Grounded, ...]:
        found: list[Grounded] = []
        # "A knife and a knife" are two, and so are those of two wishes.
        taken = set(self.taken) if command.kind not in ("open", "close") else set()
        moved = tuple(intent.target for intent in self.intents if intent.kind is IntentKind.PLACE)
        unclear: list[Refusal] = []
        called: dict[str, str] = {}
        for phrase in command.objects:
            try:
                # In "the mug on the table and the other mug on the sofa" a place ends the one command.
                here = () if any(one.location for one in command.objects) else (one.object_id for one in found)
                phrase = self.grounding.other(phrase, self.discourse.spoken.union(here))
                others = tuple(grounded.object_id for grounded in found) if phrase.whichever else ()
                rather_not = (*avoided, *moved, *others) if phrase.whichever else avoided
                before = self.discourse.spoken if phrase.another else ()
                meant = self._target(command, phrase, source, rather_not, {*taken, *others, *before})
                if phrase.whichever and command.kind not in ("open", "close", "pick"):
                    self.taken.update(grounded.object_id for grounded in meant)
                self._check_called(command, phrase, meant, called)
                if command.kind == "open" and phrase.front is not None:
                    self._check_front(phrase, meant)
                found += meant
            except Refusal as refusal:
                if (command.kind == "bare" or command.verbless) and refusal.code == "unknown-object":
                    raise no_action() from None
                if refusal.code != "ambiguous-object":
                    raise
                unclear.append(refusal)
        if unclear:
            # "The urn and the vase" are the two that there are.
            if len(unclear) != len(unclear[0].among) or len({refusal.among for refusal in unclear}) > 1:
                raise unclear[0]
            found += map(Grounded, unclear[0].among)
        return tuple({(grounded.object_id, grounded.part): grounded for grounded in found}.values())

    def _target(
        self,
        command: Command,
        phrase: NounPhrase,
        source: Location | None,
        avoided: Sequence[str],
        taken: Collection[str],
    ) -> tuple[Grounded, ...]:
        is_door = command.kind in ("open", "close")
        if phrase.pronoun:
            return tuple(map(Grounded, self.discourse.referent(phrase, command.kind)))
        if is_door and phrase.is_only_a_door and not phrase.another:
            spoken = self._door_spoken_of(phrase)
            if spoken:
                return spoken
        if is_door and (phrase.everything or phrase.several) and phrase.location is None:
            if phrase.several and not phrase.everything:
                return self.grounding.every(phrase)
            return tuple(Grounded(key) for key, can in self.grounding.around.affordances.items() if can.door)
        if phrase.everything:
            return self.grounding.items(phrase, source, avoided)
        if is_door and not phrase.several:
            can, shut = self.grounding.around.affordances, command.kind == "open"
            is_open = self.grounding.around.is_open

            def opens(key: str) -> bool:
                return can[key].door

            return self.grounding.every(
                phrase, None, (), taken, lambda key: opens(key) and is_open(key) is not shut, opens
            )
        if phrase.load and command.kind == "place" and self.grounding.nowhere(phrase):
            # "Put the bowl with the apple in it on the table": what it shall hold.
            phrase = replace(phrase, load=())
        return self.grounding.every(phrase, source, avoided, taken)

    def _check_called(
        self, command: Command, phrase: NounPhrase, meant: Sequence[Grounded], called: dict[str, str]
    ) -> None:
        """Refuse two names of one thing where each of them is to be moved; a pronoun is no name.

        "The ladle and the spoon" are two things, and "put the pan there and the frying pan here" moves two. With a verb
        of its own, a later command may call the thing otherwise: "put the milk there, then put the carton back".
        """
        if command.kind in ("open", "close") or phrase.pronoun or len(meant) != 1 or phrase.several:
            return
        key, name = meant[0].object_id, str(replace(phrase, location=None, load=()))
        other, of_one_verb = called.setdefault(key, name), True
        if other == name and command.kind in ("place", "toss"):
            other, verb = self.called.get(key, (name, self.verbs))
            of_one_verb = verb == self.verbs
            self.called[key] = (other if of_one_verb else name, self.verbs)
            other = name if is_again(name, other) else other
        if name == other or key in (name, other):
            return
        if of_one_verb:
            problem = f'"{other}" and "{name}" name two things, and the scene has {key} alone for both'
            raise Refusal("several-objects", problem)
        self.notes.append(f'"{name}" is taken for {key}, which is "{other}" before')

    def _check_front(self, phrase: NounPhrase, meant: Sequence[Grounded]) -> None:
        """Note that opening an object opens one door or drawer of it, or raise the refusal of opening all."""
        if not all(grounded.by_door for grounded in meant):
            return
        key = meant[0].object_id
        if phrase.several and len(meant) == 1:
            problem = f'"{phrase}" speaks of all there are, and a plan that opens {key} opens one'
            raise Refusal("several-objects", problem, instead=(Intent(IntentKind.OPEN, key),))
        if len(meant) > 1 or phrase.words[-1].endswith("s"):
            self.notes.append(f"opening a thing opens one {phrase.front} of it, whichever serves")

    def _door_spoken_of(self, phrase: NounPhrase) -> tuple[Grounded, ...]:
        """Return the owner of "the door": the object that "it" would mean; none if that is not one object."""
        try:
            ids = self.discourse.door(NounPhrase(("it",), pronoun="it"), phrase.front)
            return tuple(Grounded(key, by_door=True) for key in ids)
        except Refusal:
            return ()

    def _source(self, command: Command) -> Location | None:
        source = command.source
        if source is None or not source.phrase.pronoun:
            return source
        return replace(source, phrase=NounPhrase((self._holder_spoken_of(source.phrase),)))

    def _origin(self, source: Location | None) -> str | None:
        try:
            return None if source is None else self.grounding.one(source.phrase).object_id
        except Refusal:
            return None

    def _spoken_of(self, phrase: NounPhrase, fits: Callable[[str], bool]) -> str:
        ids = self.discourse.latest(phrase, fits)
        if len(ids) > 1:
            raise Refusal("several-objects", f'"{phrase}" means {enumeration(ids)} where one place is needed')
        return ids[0]

    def _holder_spoken_of(self, phrase: NounPhrase) -> str:
        return self._spoken_of(phrase, lambda key: bool(self.grounding.around.cargo(key)))

    def _destination(self, place: Location, targets: Sequence[str] = ()) -> Grounded:
        """Return the object of a place; a pronoun means none of the targets, and "a table" rather another one."""
        if not place.phrase.pronoun:
            hosts = tuple(step.object_id for key in targets for step in self.grounding.around.supports(key))
            phrase = self.grounding.other(place.phrase, self.discourse.spoken.union(targets), hosts)
            there, taken = phrase.location, (*hosts, *self.discourse.spoken) if phrase.another else ()
            # "A bowl on the table", and "egg into bowl on table", which leaves out every article.
            any_one = phrase.whichever or (self.grounding.trusts and not phrase.definite)
            moves = there is not None and {place.direction, there.direction} <= {*_INTO_OR_ONTO, "TO"}
            if any_one and moves and self.grounding.nowhere(phrase):
                grounded = self.grounding.one(replace(phrase, location=None), avoided=(*targets, *hosts), taken=taken)
                if self._is_item(grounded.object_id):
                    return replace(grounded, moves=True)
            takes = self._takes(place)
            return self.grounding.one(phrase, None, (*targets, *hosts), taken, takes, takes)
        affordances = self.grounding.around.affordances

        def fits(key: str) -> bool:
            can = affordances[key]
            carries = can.surface or can.top
            wanted = {"INTO": can.interior, "IN": can.interior, "ONTO": carries, "ON": carries}
            if place.direction == "IN" and place.loose:
                wanted = {}
            return key not in targets and wanted.get(place.direction, can.interior or can.surface)

        if not self.discourse.mentions and place.phrase.words == ("there",):
            raise Refusal("missing-place", "it does not say where to")

        def may_have_neighbours(key: str) -> bool:
            return key not in targets and bool(self._hosts(key))

        if place.direction in SPOTS and any(map(may_have_neighbours, self.discourse.spoken)):
            # Nothing can be put next to what stands on nothing else.
            return Grounded(self._spoken_of(place.phrase, may_have_neighbours))
        return Grounded(self._spoken_of(place.phrase, fits))

    def _ids(self, command: Command, source: Location | None = None) -> list[str]:
        """Return the objects that a command is about, and keep the notes on which they are."""
        targets = self._targets(command, source, ())
        self.notes += [note for grounded in targets for note in grounded.notes]
        return [grounded.object_id for grounded in targets]

    def _things(self, command: Command, source: Location | None = None) -> list[str]:
        """Return the items that a command is about."""
        ids = self._ids(command, source)
        for key in ids:
            check_item(key, self.grounding.around)
        return ids
