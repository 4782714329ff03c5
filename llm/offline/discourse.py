"""The objects that a query has mentioned so far, and what its pronouns ("it", "them", "there") refer to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from llm.offline.grounding import Grounding
from llm.offline.intents import Front, Intent, IntentKind, Refusal, Surroundings, alternatives
from llm.offline.reader import SWITCHINGS, Command, CommandKind, NounPhrase, Reading


@dataclass(frozen=True, slots=True)
class Mention:
    """Objects mentioned by one command.

    `as_one`: one word named several of them, so that "it" can mean them. `plural`: the name of the one is a plural,
    such as "the keys", so that "them" can mean it.
    """

    intents: tuple[Intent, ...]
    source: str | None = None
    as_one: bool = False
    plural: bool = False

    @property
    def themes(self) -> tuple[str, ...]:
        """Objects that are acted on."""
        return tuple(dict.fromkeys(intent.target for intent in self.intents))

    @property
    def places(self) -> tuple[str, ...]:
        """Destinations, what things are put next to, and the source."""
        neighbours = (intent.where.other or None if intent.where else None for intent in self.intents)
        named = (*(intent.destination for intent in self.intents), *neighbours, self.source)
        return tuple(dict.fromkeys(key for key in named if key is not None))


@dataclass(slots=True)
class Discourse:
    """Mentions of a query so far, the latest last."""

    around: Surroundings
    mentions: list[Mention] = field(default_factory=list)

    @property
    def spoken(self) -> frozenset[str]:
        """Objects that any command has acted on, destinations and sources."""
        return frozenset(key for mention in self.mentions for key in (*mention.themes, *mention.places))

    def item(self, phrase: NounPhrase) -> tuple[str, ...]:
        """Resolve a pronoun that names a moved item: what the latest command about items moved."""
        for index in range(len(self.mentions) - 1, -1, -1):
            mention = self.mentions[index]
            themes = tuple(filter(self._is_item, mention.themes))
            if not themes:
                continue
            moved = [i for i in mention.intents if i.kind is IntentKind.PLACE]
            others = tuple(i.destination for i in moved if i.destination and self._is_item(i.destination))
            if phrase.elided and moved and (mention.as_one or not others):
                problem = "it does not say what is put there; nothing was picked up for it"
                raise Refusal("not-understood", problem)
            if phrase.pronoun == "them" and len(themes) == 1 and not mention.as_one:
                vessel = mention.intents[-1].destination
                if vessel is not None and self._is_item(vessel) and phrase.count in (None, 2):
                    # "Put the knife into the pot and move them": the knife moves along with the pot.
                    return (vessel,)
                themes = self._picked_in_a_row(index)
            elif phrase.pronoun == "it" and not mention.as_one:
                # In "put the apple into the bowl and put it ..." either of them can be meant.
                # What is not spoken can be several things, but not these or the ones that they were put into.
                mention = replace(mention, as_one=phrase.elided and not others)
                themes += others
            alone = mention.plural and len(themes) == 1 and phrase.count is None
            return self._agreed(phrase, tuple(dict.fromkeys(themes)), mention.as_one or alone)
        raise self._unclear(phrase)

    def door(self, phrase: NounPhrase, front: Front | None = None) -> tuple[str, ...]:
        """Resolve a pronoun that names something to open or close."""

        def fits(key: str) -> bool:
            can = self.around.affordances[key]
            return can.door if front is None else can.opens_by(front)

        return self.latest(phrase, fits)

    def referent(self, phrase: NounPhrase, kind: CommandKind) -> tuple[str, ...]:
        """Resolve a pronoun that names what a command is about: something to open, to switch, or to move."""
        if kind in SWITCHINGS:
            return self.latest(phrase, lambda key: self.around.control(key) is not None)
        return self.door(phrase) if kind in ("open", "close") else self.item(phrase)

    def latest(self, phrase: NounPhrase, fits: Callable[[str], bool]) -> tuple[str, ...]:
        """Resolve a pronoun to the fitting objects of the last command, or else to those of all before it.

        "Them" refers to the latest command about several objects.
        """
        if phrase.pronoun == "them":
            sets = (tuple(filter(fits, mention.themes)) for mention in reversed(self.mentions))
            return self._agreed(phrase, next((ids for ids in sets if len(ids) > 1), ()))
        spoken = [dict.fromkeys((*mention.themes, *mention.places)) for mention in self.mentions]
        before = {key: None for named in spoken[:-1] for key in named}
        for named in (*spoken[-1:], before):
            fitting = tuple(key for key in named if fits(key))
            if fitting:
                return self._agreed(phrase, fitting)
        raise self._unclear(phrase)

    def _picked_in_a_row(self, last: int) -> tuple[str, ...]:
        """Return the objects of consecutive pick commands up to one of them."""
        first = last
        while first > 0 and all(intent.kind is IntentKind.PICK for intent in self.mentions[first - 1].intents):
            first -= 1
        return tuple(dict.fromkeys(key for mention in self.mentions[first : last + 1] for key in mention.themes))

    def _agreed(self, phrase: NounPhrase, ids: tuple[str, ...], as_one: bool = False) -> tuple[str, ...]:
        if phrase.pronoun == "it" and len(ids) > 1 and not as_one:
            problem = f'"{phrase}" can mean {alternatives(ids)}; say which one by its id'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, ids)), among=ids)
        if phrase.pronoun == "them" and (len(ids) < (1 if as_one else 2) or phrase.count not in (None, len(ids))):
            problem = f'"{phrase}" speaks of {phrase.count or "several"} objects, and the wishes before it of '
            raise Refusal("several-objects", problem + (" and ".join(ids) or "none"))
        return ids

    def _is_item(self, object_id: str) -> bool:
        return self.around.scene.objects[object_id].role == "B"

    def _unclear(self, phrase: NounPhrase) -> Refusal:
        return Refusal("not-understood", f'"{phrase}" does not say which object is meant')


def resolved(reading: Reading, grounding: Grounding) -> Reading:
    """Return a reading whose "it" and "the other" are told by the command before or after, where only these tell."""
    return _paired(_with_loads(reading, grounding), grounding)


def _with_loads(reading: Reading, grounding: Grounding) -> Reading:
    """Return a reading in which "pick up a pan with a spoon in it and put it there" puts there what shall hold it."""
    commands: list[Command] = []
    for command in reading:
        before = commands[-1] if commands else None
        again = command.kind == "place" and len(command.objects) == 1 and command.objects[0].pronoun == "it"
        picked = before is not None and before.kind == "pick" and len(before.objects) == 1 and before.objects[0].load
        if before is not None and picked and again and grounding.nowhere(before.objects[0]):
            commands[-1] = replace(command, objects=before.objects, source=before.source)
        else:
            commands.append(command)
    return tuple(commands)


def _paired(reading: Reading, grounding: Grounding) -> Reading:
    """Return a reading in which either of two is "the apple" that a later command tells from "the other apple".

    Two of which the scene says different things stay ambiguous. "One mug here and the other there" is one mug and the
    other mug.
    """
    commands: list[Command] = []
    for command in reading:
        before = commands[-1].objects if commands else ()
        if before and command.objects and command.objects[0].words == ("other",):
            named = replace(command.objects[0], words=("other", *before[-1].words))
            command = replace(command, objects=(named, *command.objects[1:]))
        commands.append(command)
    named_before = [phrase.words for command in commands for phrase in command.objects]
    for index, command in enumerate(commands):
        if len(command.objects) == 1 and command.objects[0].definite and "other" not in command.objects[0].words:
            phrase = command.objects[0]
            later = named_before[sum(len(one.objects) for one in commands[: index + 1]) :]
            distinguished = ("other", *phrase.words) in later and command.kind == "place"
            if distinguished and grounding.are_alike(phrase):
                commands[index] = replace(command, objects=(replace(phrase, whichever=True),))
    return tuple(commands)
