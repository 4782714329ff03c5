"""Ground noun phrases in a scene: objects by id, kind, part, place and side."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Self

from llm.offline.intents import Refusal, Support, Surroundings, alternatives, enumeration
from llm.offline.lexicon import Lexicon
from llm.offline.names import Named, Names, singulars
from llm.offline.reader import REFERENCE_DIRECTIONS, Location, NounPhrase
from llm.offline.viewpoint import (
    ASIDE,
    COLORS,
    LEVELS,
    SIZES,
    by_measured_color,
    by_size,
    measured_colors,
    on_side,
    placed,
    referenced,
    stated_colors,
)
from oag import Scene
from oag.model.symbols import has_boards
from oag.model.where import Where
from oag.sizes import TO_THE_AIM, Sizing

_WHERE = {"FROM": "on or in", "OUTOF": "in"}
_FROM_A_VIEWPOINT = ("LEFTOF", "RIGHTOF", "BEHIND", "INFRONT")
_RELATION = {"IN": "inside", "INTO": "inside", "ON": "ontop", "ONTO": "ontop"}


@dataclass(frozen=True, slots=True)
class Grounded:
    """An object that a phrase names; `hollow` if the naming part holds things itself, such as a drawer.

    `moves`: it is not where the phrase says, and shall be put there.
    """

    object_id: str
    by_surface: bool = False
    by_door: bool = False
    notes: tuple[str, ...] = ()
    hollow: bool = False
    part: Where | None = None
    moves: bool = False


# Objects, with the assumptions made to find them.
_Noted = tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Grounding:
    """Ground phrases in one scene.

    `trusts`: where no reading is a plan otherwise, a piece of furniture may be described by a landmark that the scene
    lacks, or by a side that depends on the viewpoint, if its name fits nothing else, even less well.
    """

    around: Surroundings
    names: Names
    trusts: bool = False

    @classmethod
    def of(cls, scene: Scene, lexicon: Lexicon, sizing: Sizing = TO_THE_AIM) -> Self:
        """Return the grounding for a scene at its start."""
        entries = {thing.category: lexicon.category_of(thing.category) for thing in scene.objects.values()}
        listed = {category: entry.affordances for category, entry in entries.items() if entry is not None}
        around = replace(Surroundings.of(scene, listed), sizing=sizing)
        return cls(around, Names.of(around, lexicon, entries))

    def one(
        self,
        phrase: NounPhrase,
        source: Location | None = None,
        avoided: Sequence[str] = (),
        taken: Collection[str] = (),
        fits: Callable[[str], bool] | None = None,
        able: Callable[[str], bool] | None = None,
    ) -> Grounded:
        """Return the one object that a phrase names.

        Args:
            phrase: The phrase; of several objects that "a glass" names, the first will do.
            source: Where it is taken from.
            avoided: What "a glass" should rather not name, and where it should rather not stand already.
            taken: What "a glass" cannot name, since an earlier "a glass" did.
            fits: What is asked for can be done with an object; of several that are called so, the only one is meant.
            able: It can be done with an object at all, whatever its state: of things with and without drawers that are
                called "the desk", those with drawers are opened, even if others are called so rather.
        """
        if phrase.several:
            raise Refusal("several-objects", f'"{phrase}" means several objects where one is needed')
        phrase = self._of_one_name(phrase)
        named = self._able(self._bearers(phrase), able)
        if named.plural and not phrase.whichever:
            raise Refusal("several-objects", f'"{phrase}" means several objects where one is needed')
        ids, notes = self._narrowed(named, phrase, source)
        ids, more = (ids, ()) if named.part is not None and len(ids) == 1 else self._on_side(ids, phrase)
        if phrase.whichever:
            ids = _left(ids, phrase, taken)
        if len(ids) > 1 and fits is not None and any(map(fits, ids)):
            left = tuple(filter(fits, ids))
            if len(left) == 1:
                more = (*more, f'"{phrase}" is {left[0]}, the only one of {enumeration(ids)} that serves')
            ids = left if len(left) == 1 or phrase.whichever else ids
        if len(ids) > 1 and phrase.whichever:
            ids, more = self._chosen(ids, 1, phrase, avoided)
        if len(ids) > 1:
            problem = f'"{phrase}" can mean {alternatives(ids)}; say which one by its id'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, ids)), among=ids)
        return self._grounded(ids[0], named, phrase, (*more, *notes))

    def every(
        self,
        phrase: NounPhrase,
        source: Location | None = None,
        avoided: Sequence[str] = (),
        taken: Collection[str] = (),
        fits: Callable[[str], bool] | None = None,
        able: Callable[[str], bool] | None = None,
    ) -> tuple[Grounded, ...]:
        """Return all objects that a phrase names: one for "the glass", each for "all glasses" and "the glasses"."""
        phrase = self._of_one_name(phrase)
        named = self._able(self._bearers(phrase), able)
        if not phrase.several and (not named.plural or phrase.whichever):
            return (self.one(phrase, source, avoided, taken, fits, able),)
        ids, notes = self._narrowed(named, phrase, source)
        wanted = phrase.count
        if phrase.whichever:
            ids = _left(ids, phrase, taken)
        if wanted is not None and len(ids) > wanted and phrase.whichever:
            ids, more = self._chosen(ids, wanted, phrase, avoided)
            notes = (*more, *notes)
        if wanted is not None and len(ids) > wanted:
            problem = f'"{phrase}" can mean any {wanted} of {alternatives(ids, ", ")}; say which ones by their ids'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, ids)), among=ids)
        if len(ids) < (wanted or (1 if phrase.several else 2)):
            problem = f'"{phrase}" speaks of {wanted or "several"} objects, and the scene has {len(ids)} of them'
            raise Refusal("several-objects", f"{problem}: {alternatives(ids, ', ')}")
        return tuple(self._grounded(key, named, phrase, notes) for key in ids)

    def _able(self, named: Named, able: Callable[[str], bool] | None) -> Named:
        """Return those of a longer name where they are able to what is asked for, and those of the name are not.

        A desk with drawers is a desk, and a carton is no other box.
        """
        objects, word = self.around.scene.objects, named.name.split(" ")[-1]
        longer = tuple(key for key in named.passed_over if word in objects[key].category.split("_"))
        if able is None or any(map(able, named.ids)) or not (better := tuple(filter(able, longer))):
            return named
        note = f'"{named.name}" is {alternatives(better)} here: {alternatives(named.ids)} does not serve'
        return replace(named, ids=better, passed_over=(), notes=(*named.notes, note))

    def other(self, phrase: NounPhrase, spoken: Collection[str], hosts: Collection[str] = ()) -> NounPhrase:
        """Return the phrase of the only object that is not known yet for "the other mug"; other phrases unchanged.

        Known is what was spoken of, and else what hosts the things that are moved; where these differ, neither is.
        """
        words = tuple(word for word in phrase.words if word != "other")
        if words == phrase.words or not words or phrase.several:
            return phrase
        named = self.names.described(words)
        ids = self._as_described(named.descriptions, named.ids, phrase)
        known, here = ({key for key in ids if key in some} for some in (spoken, hosts))
        left = tuple(key for key in ids if key not in (known or here))
        if len(left) != 1 or len(ids) == 1 or (known and here and known != here):
            return phrase
        return replace(phrase, words=(*named.descriptions, *left))

    def are_alike(self, phrase: NounPhrase) -> bool:
        """Decide whether a name fits exactly two things that the scene describes alike."""
        ids = self.names.described(phrase.words).ids
        things = [self.around.scene.objects[key] for key in ids]
        return len(ids) == 2 and len({(t.category, t.model, t.extent_m, stated_colors(t)) for t in things}) == 1

    def nowhere(self, phrase: NounPhrase) -> bool:
        """Decide whether things are called so, and none is where the phrase says, or holds what it says."""
        try:
            self.every(phrase)
        except Refusal as refusal:
            if refusal.code != "wrong-place":
                return False
        else:
            return False
        plain = replace(phrase, location=None, load=())
        try:
            self.every(plain)
        except Refusal as other:
            return other.code == "ambiguous-object"
        return True

    def _chosen(self, ids: Sequence[str], wanted: int, phrase: NounPhrase, avoided: Sequence[str]) -> _Noted:
        """Return as many objects as wanted of those that will do, with a note.

        Those at other places come first, and of the items those that carry nothing.
        """
        here, around = frozenset(avoided), self.around

        def drawbacks(key: str) -> tuple[bool, bool, bool]:
            carries = around.scene.objects[key].role == "B" and bool(around.cargo(key))
            return key in here, bool(here & {*map(_host, around.supports(key))}), carries

        ordered = sorted(ids, key=drawbacks)
        chosen = tuple(ordered[:wanted])
        others = alternatives(ordered[wanted:], ", ")
        return chosen, (f'any "{phrase}" will do: {enumeration(chosen)} is taken, and not {others}',)

    def items(self, phrase: NounPhrase, source: Location | None, avoided: Sequence[str]) -> tuple[Grounded, ...]:
        """Return the items that "everything" means, without those that stand in or on another item."""
        scene = self.around.scene
        own = {*avoided, *(step.object_id for key in avoided for step in self.around.chain(key))}
        others = [key for key, thing in scene.objects.items() if thing.role == "B" and key not in own]
        ids = tuple(key for key in others if not any(s.object_id in others for s in self.around.supports(key)))
        notes: tuple[str, ...] = ()
        for place in (phrase.location, source):
            if place is not None and ids:
                ids, more = self._held_by(ids, place)
                notes += more
        if not ids:
            place = phrase.location or source
            where = "" if place is None else f" {_WHERE.get(place.direction, place.preposition)} {place.phrase}"
            raise Refusal("already-so", f"there is nothing{where} to move")
        return tuple(Grounded(key, notes=notes) for key in ids)

    def _held_by(self, ids: tuple[str, ...], place: Location) -> _Noted:
        """Return the objects that stand directly at a place, not on something that stands there."""
        if place.direction in REFERENCE_DIRECTIONS:
            return self._found_at(ids, place)
        if place.other is not None:
            both = [self._held_by(ids, replace(place, phrase=p, other=None)) for p in (place.phrase, place.other)]
            found = {key for here, _ in both for key in here}
            return tuple(key for key in ids if key in found), (*both[0][1], *both[1][1])
        named = self.one(place.phrase)
        held = tuple(
            key
            for key in ids
            if any(s.object_id == named.object_id and self._is_at(s, place) for s in self.around.supports(key))
        )
        return held, named.notes

    def _is_at(self, support: Support, place: Location) -> bool:
        """Decide whether a preposition allows a relation: "from" and "in the middle of" allow both."""
        if place.direction == "IN" and place.loose:
            return True
        host = self.around.scene.objects.get(support.object_id)
        if place.direction == "IN" and host is not None and has_boards(host.category):
            return True
        if place.direction == "OUTOF":
            return support.relation == "inside" or not self.around.affordances[support.object_id].interior
        return _RELATION.get(place.direction, support.relation) == support.relation

    def _grounded(self, object_id: str, named: Named, phrase: NounPhrase, more: tuple[str, ...]) -> Grounded:
        notes = [*named.notes, *self._unconfirmed(named, (object_id,)), *more]
        if named.passed_over:
            others = alternatives(named.passed_over, ", ")
            were = "was" if len(named.passed_over) == 1 else "were"
            notes.append(f'"{named.name}" fits {object_id} best; {others} {were} passed over')
        entry = self.names.entries[self.around.scene.objects[object_id].category]
        by_surface = entry is not None and named.name in entry.surface_names
        part = self.names.lexicon.category_of(phrase.words[-1]) if named.by_door else None
        hollow = named.part is not None or (part is not None and part.affordances.interior)
        return Grounded(object_id, by_surface, named.by_door, tuple(notes), hollow, named.part)

    def _of_one_name(self, phrase: NounPhrase) -> NounPhrase:
        """Join "the bottle of medicine" to one name if an object is called so."""
        owner = phrase.owner
        if owner is None or owner.pronoun or owner.owner is not None:
            return phrase
        for words in self.names.joined(phrase.words, owner.words):
            if self.names.described(words).ids:
                # "Bars of soap" are several, "a set of keys" and "the box of tissues" are not.
                units = phrase.words[-1] in self.names.plural_units
                one = phrase.one_of or not units
                joined = replace(phrase, words=words, owner=None, location=owner.location, door=False, one_of=one)
                many = units and not (phrase.several or phrase.one_of)
                return replace(joined, several=True) if many and len(self.names.described(words).ids) > 1 else joined
        if self.names.are_vessels(phrase.words[-1], owner.words):
            plain = replace(phrase, words=(*phrase.words[:-1], *owner.words), owner=None, location=owner.location)
            return replace(plain, door=False)
        return phrase

    def _bearers(self, phrase: NounPhrase, *, named_only: bool = False) -> Named:
        """Return the objects of a phrase; `named_only` where it tells another thing apart and nothing is put there."""
        if phrase.pronoun:
            raise Refusal("not-understood", f'"{phrase}" does not say which object is meant')
        if phrase.owner is not None:
            return self._owned(phrase, phrase.owner)
        named = self.names.described(phrase.words)
        if not named.ids and phrase.front is not None:
            try:
                named = self.names.doors(phrase, phrase.front)
            except Refusal:
                named = self.names.compound(phrase.words)
                if not named.ids or phrase.side is not None:
                    raise
        if named.ids:
            # Two rings of keys are "the keys", and so is one.
            alike = (self.names.described((*phrase.words[:-1], one)).ids for one in singulars(phrase.words[-1]))
            return replace(named, plural=len(named.ids) > 1 and not phrase.one_of and named.ids in alike)
        for singular in singulars(phrase.words[-1]):
            named = self.names.described((*phrase.words[:-1], singular))
            if not named.ids:
                # "The tissues boxes".
                each = ((singulars(word) or (word,))[-1] for word in phrase.words[:-1])
                named = self.names.described((*each, singular))
            if named.ids:
                return replace(named, plural=not phrase.one_of)
        placed = self._placed(phrase, named_only=named_only)
        if placed is not None:
            return placed
        for last in (phrase.words[-1], *singulars(phrase.words[-1])):
            named = self.names.compound((*phrase.words[:-1], last))
            if named.ids and not self.names.which(phrase.words):
                return replace(named, plural=last != phrase.words[-1] and not phrase.one_of)
        raise self.names.unknown(phrase, self.around)

    def _narrowed(self, named: Named, phrase: NounPhrase, source: Location | None) -> _Noted:
        ids = self._in_state(phrase, named.ids)
        notes: tuple[str, ...] = ()
        for place in (phrase.location, source):
            if place is not None:
                ids, more = self._at(ids, place, named)
                notes += more
        for held in phrase.load:
            ids, more = self._holding(ids, held, phrase, named)
            notes += more
        return self._as_described(named.descriptions, ids, phrase), notes

    def _as_described(self, words: Sequence[str], ids: tuple[str, ...], phrase: NounPhrase) -> tuple[str, ...]:
        """Return the objects of the colours and sizes that words name, as far as the scene states them."""
        colours = tuple(word for word in words if word in COLORS)
        stated = {key: stated_colors(self.around.scene.objects[key]) for key in ids}
        measured = {key for key in ids if measured_colors(self.around.scene.objects[key])}
        for word in words:
            if word in COLORS and (clear := by_measured_color(ids, COLORS[word], self.around.scene)):
                ids = clear
            elif word in COLORS:
                fitting = tuple(key for key in ids if COLORS[word] in stated[key])
                unstated = tuple(key for key in ids if not stated[key] and key not in measured)
                if not fitting and measured.issuperset(ids):
                    problem = f'"{phrase}" can mean {alternatives(ids)}: the photograph tells none apart as {word}'
                    raise Refusal("ambiguous-object", f"{problem}; say which one by its id")
                if not fitting and not unstated:
                    others = "; ".join(f"{key} is {enumeration(sorted(have))}" for key, have in stated.items() if have)
                    asked = enumeration(colours) if len(colours) == 1 else f"{enumeration(colours)} at once"
                    more = "" if len(colours) == 1 else "; name each of several things with its colour"
                    raise Refusal("unknown-object", f'no "{phrase}" of the scene is {asked}: {others}{more}')
                ids = fitting or unstated
            elif word in SIZES:
                ids = by_size(ids, word, self.around.scene)
        return ids

    def _unconfirmed(self, named: Named, ids: Sequence[str]) -> tuple[str, ...]:
        """Return the notes on describing words that the scene does not confirm."""
        things = [self.around.scene.objects[key] for key in ids]
        decided = len(named.ids) > len(ids)

        def is_stated(word: str) -> bool:
            if word in SIZES:
                return decided
            return word in COLORS and all(COLORS[word] in stated_colors(thing) for thing in things)

        return _on_trust(tuple(word for word in named.descriptions if not is_stated(word)), ids)

    def _placed(self, phrase: NounPhrase, *, named_only: bool) -> Named | None:
        """Return what "the third drawer", "the top cabinet" or "the front bowl" names by where it stands."""
        which = self.names.which(phrase.words)
        words = tuple(word for word in phrase.words if word not in which)
        if len(which) != 1 or not words:
            return None
        named = self.names.described(words)
        things = [self.around.scene.objects[key] for key in named.ids]
        if not things:
            return None
        if any(thing.role == "B" for thing in things):
            return self._in_front(named, phrase, which[0])
        if len(things) == 1:
            # "The top drawer" of one, like "the left drawer"; of a thing with boards, "top" is one of these.
            if not named_only and has_boards(things[0].category) and phrase.side is None:
                return self.names.door_of(named.ids[0], phrase)
            trusted = which[0] in LEVELS
            return replace(named, descriptions=(*named.descriptions, *which)) if trusted else None
        ids, notes = self._narrowed(named, phrase, None)
        found = placed(ids, which[0], self.around.scene) if phrase.side is None else None
        if found is None:
            return None
        key, counted = found
        note = f'{key} is taken for "{" ".join(phrase.words)}", counted {counted}'
        return replace(named, ids=(key,), notes=(*named.notes, note, *notes))

    def _in_front(self, named: Named, phrase: NounPhrase, word: str) -> Named | None:
        """Return the nearest or farthest of several things, for "the front bowl"; of one it is taken on trust."""
        side = ASIDE.get(word)
        if side is None or phrase.side is not None:
            return None
        if len(named.ids) == 1:
            return replace(named, descriptions=(*named.descriptions, word))
        ids, notes = self._narrowed(named, phrase, None)
        return replace(named, ids=on_side(ids, side, self.around.scene), notes=(*named.notes, *notes))

    def _owned(self, phrase: NounPhrase, owner: NounPhrase) -> Named:
        whole = self.one(owner, fits=lambda key: self.names.may_have(key, phrase))
        words = " ".join(phrase.words)
        if whole.object_id in self.names.by_name(words).ids:
            return Named((whole.object_id,), words, notes=whole.notes)
        own = self.names.drawer_apart(whole.object_id, phrase)
        if own is not None:
            return replace(own, notes=(*whole.notes, *own.notes))
        return replace(self.names.door_of(whole.object_id, phrase), notes=whole.notes)

    def _in_state(self, phrase: NounPhrase, ids: tuple[str, ...]) -> tuple[str, ...]:
        for state in phrase.states:
            fitting = tuple(key for key in ids if self.around.is_open(key) is (state == "open"))
            if not fitting:
                problem = f'no "{phrase}" of the scene is {state}'
                raise Refusal("wrong-place", problem, scene=list(map(self.around.described, ids)), among=ids)
            ids = fitting
        return ids

    def _at(self, ids: tuple[str, ...], place: Location, named: Named) -> _Noted:
        """Return the objects at a place, with the assumptions."""
        try:
            return self._found_at(ids, place)
        except Refusal as refusal:
            if not self._trusted(named, place, refusal):
                raise
            return ids, (f'"{place}" is taken on trust: {refusal.problem}',)

    def _is_only_furniture(self, named: Named) -> bool:
        """Decide whether a name fits one object alone, even less well, and that is a piece of furniture."""
        return len(named.ids) == 1 and not named.passed_over and self.around.scene.objects[named.ids[0]].role == "A"

    def _trusted(self, named: Named, place: Location, refusal: Refusal) -> bool:
        """Decide whether a place that is not confirmed may describe the only piece of furniture of a name."""
        if not self.trusts or not self._is_only_furniture(named):
            return False
        entry = self.names.entries[self.around.scene.objects[named.ids[0]].category]
        if entry is not None and entry.ground:
            return False  # "On the floor between the bed and the desk" is a spot.
        if place.direction == "ON" and not self.around.supports(named.ids[0]):
            # "The safe on the floor": so does everything stand that stands on nothing else.
            return any(entry.ground for entry in self.names.lexicon.owners(" ".join(place.phrase.words)))
        if place.direction == "BETWEEN":
            return all(map(self._is_landmark, (place.phrase, *(() if place.other is None else (place.other,)))))
        if refusal.code == "unknown-object":
            return place.direction in REFERENCE_DIRECTIONS and self._is_landmark(place.phrase)
        # "To the end of the sofa" is where something goes.
        at = place.direction == "TO" and place.preposition.startswith("at ")
        return refusal.code == "wrong-place" and (place.direction in _FROM_A_VIEWPOINT or at)

    def _is_landmark(self, phrase: NounPhrase) -> bool:
        """Decide whether a phrase names what only says where furniture stands, such as "the window"."""
        words = [word for word in phrase.words if word not in self.names.lexicon.descriptions]
        forms = (words[-1], *singulars(words[-1])) if words else ()
        return any(" ".join((*words[:-1], last)) in self.names.lexicon.landmarks for last in forms)

    def _found_at(self, ids: tuple[str, ...], place: Location) -> _Noted:
        if place.direction == "BETWEEN":
            problem = f"the scene does not say that {alternatives(ids)} is {place}"
            raise Refusal("wrong-place", problem, scene=[f"{key} is {self.around.bearing(key)}" for key in ids])
        if place.other is not None:
            return self._found_at_either(ids, place, place.other)
        phrase = self._of_one_name(place.phrase)
        named = self._bearers(phrase, named_only=True)
        repeated: tuple[str, ...] = ()
        if (again := self._repeated(phrase, named)) is not None:
            ids, repeated = self._found_at(ids, again)
            phrase = replace(phrase, location=None)
        supports, notes = self._narrowed(named, phrase, None)
        supports, more = self._on_side(supports, phrase)
        notes = (*repeated, *named.notes, *self._unconfirmed(named, supports), *more, *notes)
        if place.direction in REFERENCE_DIRECTIONS:
            fitting = referenced(ids, place.direction, supports, self.around.scene)
            if fitting:
                return fitting, notes
            problem = f"{alternatives(ids)} is not {place.preposition} {alternatives(supports)}"
            bearings = [f"{key} is {self.around.bearing(key)}" for key in (*ids, *supports)]
            raise Refusal("wrong-place", f"{problem}, as viewed from the robot's start", scene=bearings)
        if fitting := self._at_one_of(ids, supports, place):
            return fitting, notes
        # "The apple in the desk", of two desks without drawers and a desk with drawers, is in the latter.
        less = named.passed_over if supports == named.ids else ()
        if len(fitting := self._at_one_of(ids, less, place)) == 1:
            holder = next(step.object_id for step in self.around.chain(fitting[0]) if step.object_id in less)
            return fitting, (*notes, f'"{named.name}" fits {alternatives(supports)} better, but {holder} has it')
        raise Refusal(
            "wrong-place",
            f"{alternatives(ids)} is not {_WHERE.get(place.direction, place.preposition)} "
            f"{alternatives(supports)}: {self._stands(ids)}",
        )

    def _at_one_of(self, ids: tuple[str, ...], supports: tuple[str, ...], place: Location) -> tuple[str, ...]:
        """Return the objects that are at one of some supports; those within others only where no other is."""
        there = [[s.object_id in supports and self._is_at(s, place) for s in self.around.chain(key)] for key in ids]
        # "The cup on the table" stands on it; one in a box on the table is meant where no other is.
        for depth in (1, None):
            if fitting := tuple(key for key, steps in zip(ids, there, strict=True) if any(steps[:depth])):
                return fitting
        return ()

    def _repeated(self, phrase: NounPhrase, named: Named) -> Location | None:
        """Return where "the bottle in the fridge that is in the fridge" is said to be again, by either name.

        A box can be in a box: where one of the named is at the repeated place, that is meant.
        """
        again = phrase.location
        if again is None or again.other is not None or again.direction not in (*_WHERE, *_RELATION):
            return None
        if {*self._bearers(again.phrase, named_only=True).ids} != {*named.ids}:
            return None
        carried = any(step.object_id in named.ids for key in named.ids for step in self.around.chain(key))
        return None if carried else again

    def _stands(self, ids: Sequence[str]) -> str:
        unstated = "at a place that the scene does not state"
        return alternatives((f"{key} is {self.around.support(key) or unstated}" for key in ids), "; ")

    def _found_at_either(self, ids: tuple[str, ...], place: Location, other: NounPhrase) -> _Noted:
        """Return the several things of which some are on or in each of two pieces of furniture."""
        found: set[str] = set()
        notes: tuple[str, ...] = ()
        for phrase in (place.phrase, other):
            host = self.one(phrase).object_id
            if self.around.scene.objects[host].role != "A":
                raise Refusal("wrong-place", f"{host} is no furniture that {alternatives(ids)} could be taken from")
            try:
                here, more = self._found_at(ids, replace(place, phrase=phrase, other=None))
            except Refusal as refusal:
                if refusal.code != "wrong-place":
                    raise
                nothing = Refusal("wrong-place", f"nothing of it is on or in {host}: {self._stands(ids)}")
                # "From the desk and the bed" takes no bed along.
                nothing.decides = True
                raise nothing from None
            found.update(here)
            notes += more
        if len(found) < 2:
            raise Refusal("wrong-place", f"{alternatives(ids)} are not several things {place}")
        return tuple(key for key in ids if key in found), notes

    def _holding(self, ids: tuple[str, ...], held: NounPhrase, phrase: NounPhrase, whole: Named) -> _Noted:
        """Return the objects that hold what a phrase says they do."""
        held = self._of_one_name(held)
        try:
            named = self._bearers(held, named_only=True)
        except Refusal as refusal:
            trusted = self.trusts and refusal.code == "unknown-object" and self._is_landmark(held)
            if not trusted or not self._is_only_furniture(whole):
                raise
            # "The table with the lamp on it".
            return ids, (f'"with {held}" is taken on trust: {refusal.problem}',)
        things, notes = self._narrowed(named, held, None)
        fixed = all(self.around.scene.objects[key].role == "A" and not self.around.supports(key) for key in things)
        if self.trusts and fixed and self._is_only_furniture(whole):
            return ids, (*named.notes, *notes, f'"with {held}" is taken on trust')
        if not held.whichever and len(things) > 1 and not set(things).isdisjoint(ids):
            problem = f'"{held}" can mean {alternatives(things)}; say which one by its id'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, things)), among=things)
        place = Location(phrase.load_at, phrase, phrase.load_at.lower())
        fitting = tuple(
            key
            for key in ids
            if any(s.object_id == key and self._is_at(s, place) for one in things for s in self.around.supports(one))
        )
        if not fitting:
            stands = alternatives((f"{key} is {self.around.support(key) or 'elsewhere'}" for key in things), "; ")
            fixed = all(self.around.scene.objects[key].role == "A" for key in ids)
            if phrase.load_at == "FROM" and fixed:
                raise Refusal("not-understood", f'it does not say what to do with the "{phrase}"')
            unheld = Refusal("wrong-place", f"{alternatives(ids)} does not hold {alternatives(things)}: {stands}")
            # "The watch on the sofa with the cushion on it" says it of the sofa rather than of the watch.
            unheld.decides = fixed
            raise unheld
        return fitting, (*named.notes, *notes)

    def _on_side(self, ids: tuple[str, ...], phrase: NounPhrase) -> _Noted:
        """Return the object on the side that the phrase names; a single object is assumed to be there."""
        if phrase.side is None:
            return ids, ()
        if len(ids) == 1:
            return ids, _on_trust((phrase.side,), ids)
        return on_side(ids, phrase.side, self.around.scene), ()


def _left(ids: tuple[str, ...], phrase: NounPhrase, taken: Collection[str]) -> tuple[str, ...]:
    left = tuple(key for key in ids if key not in taken)
    if not left:
        problem = f'"{phrase}" speaks of another one than {enumeration(ids)}, and the scene has no other'
        refusal = Refusal("several-objects", problem)
        refusal.decides = True
        raise refusal
    return left


def _host(support: Support) -> str:
    return support.object_id


def _on_trust(words: Sequence[str], ids: Sequence[str]) -> tuple[str, ...]:
    things = alternatives(ids)
    return tuple(f'"{word}" is taken on trust: the scene does not describe {things} so' for word in words)
