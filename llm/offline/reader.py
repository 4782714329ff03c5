"""Parse a query's tagged words to every reading that the grammar allows; generate paraphrases.

Paraphrases are other sentences for one wish, for data sets that teach language. The grammar reads each of them
as it reads the original sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from llm.offline.intents import CONTROLS, Front
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.words import PREPOSITIONS, Direction, TaggedWord, read_words
from oag.phrasing import rephrasings

CommandKind = Literal[
    "open", "close", "pick", "place", "clear", "goto", "nowhere", "bare", "swap", "stack", "nest", "unstack", "bring",
    "liked", "tidy", "toss", "find", "away", "push", "switch_on", "switch_off", "operate", "stand",
]  # fmt: skip
SWITCHINGS: tuple[CommandKind, ...] = ("switch_on", "switch_off", "operate")
REFERENCE_DIRECTIONS: frozenset[Direction] = frozenset(
    {"NEXT", "CLOSEST", "LEFTOF", "RIGHTOF", "BETWEEN", "UNDER", "ABOVE", "BEHIND", "INFRONT", "AGAINST"}
)
# Selects one of several similar objects, from the robot's viewpoint at its start.
Side = Literal["left", "right", "nearest", "farthest"]

# An ambiguous grammar has exponentially many readings of n prepositions; real requests have fewer than these.
MAX_PREPOSITIONS = 12
MAX_PREPOSITIONS_IN_A_ROW = 6
MAX_JOINS = 16
MAX_WORDS = 90
TOO_LONG = f"at most {MAX_WORDS} words, {MAX_JOINS} joins, {MAX_PREPOSITIONS} prepositions"
_COUNTS = {"BOTH": 2, "TWO": 2, "THREE": 3, "FOUR": 4}
_INDEFINITE = frozenset({"TWO", "THREE", "FOUR"})
_SIDES: dict[str, Side] = {
    "LEFT": "left",
    "ONLEFT": "left",
    "TOLEFT": "left",
    "RIGHT": "right",
    "ONRIGHT": "right",
    "TORIGHT": "right",
    "NEAREST": "nearest",
    "FARTHEST": "farthest",
    "ONFRONT": "nearest",
    "ONBACK": "farthest",
}
_TOWARDS = frozenset({"TOLEFT", "TORIGHT"})
_JOINS = frozenset({"AND", "THEN", "COMMA", "STOP"})


@dataclass(frozen=True, slots=True)
class Location:
    """A preposition with its noun phrase: a destination, a source, or a place.

    `loose`: it names a part, such as "the edge of", at which nothing can be put exactly.
    `other`: the second landmark of "between the sink and the stove", or place of "from the desk and the shelf".
    """

    direction: Direction
    phrase: NounPhrase
    preposition: str
    loose: bool = False
    other: NounPhrase | None = None

    def __str__(self) -> str:
        return f"{self.preposition} {self.phrase}" + ("" if self.other is None else f" and {self.other}")


@dataclass(frozen=True, slots=True)
class NounPhrase:
    """Words that name an object.

    Attributes:
        words: The words without determiner, such as ("water", "glass").
        states: "open" or "closed" before the name.
        location: Place of the object.
        owner: For "the door of the refrigerator", the refrigerator.
        door: Whether the words end in the name of a door.
        several: Whether all objects of the name are meant ("all glasses").
        count: Required number, if given ("both glasses").
        one_of: Whether one of several is meant ("one of the glasses").
        whichever: Whether any of them will do ("a glass", "two of the glasses"), unlike "some glass" and "the glass".
        another: Whether it is none of those spoken of before ("another glass").
        everything: Whether all items are meant, whatever they are called ("everything on the table").
        pronoun: For "it" and "them", whether one or several of the objects mentioned before are meant.
        side: Which of several is meant ("the left glass").
        towards: Whether the side may be where it shall go ("the glass to the left").
        load: What it holds, or shall hold ("the bowl with the apple in it").
        load_apart: Whether that follows a place, whose load it may be ("put the cup on the desk with the keys on it").
        load_at: "IN" or "ON" it, "OUTOF" where it contains it, or "FROM" where "with" alone does not say so.
        definite: Whether it begins as "the bowl" does.
        elided: Whether it is not spoken ("pick up the mug and put in the sink").
    """

    words: tuple[str, ...]
    states: tuple[Literal["open", "closed"], ...] = ()
    location: Location | None = None
    owner: NounPhrase | None = None
    door: bool = False
    several: bool = False
    count: int | None = None
    one_of: bool = False
    whichever: bool = False
    another: bool = False
    everything: bool = False
    pronoun: Literal["it", "them"] | None = None
    side: Side | None = None
    towards: bool = False
    load: tuple[NounPhrase, ...] = ()
    load_apart: bool = False
    load_at: Direction = "FROM"
    definite: bool = False
    elided: bool = False

    @property
    def front(self) -> Front | None:
        """For words that end in the name of a door, whether that is a door or a drawer."""
        if not self.door:
            return None
        return "drawer" if self.words[-1].startswith("drawer") else "door"

    @property
    def is_only_a_door(self) -> bool:
        """Whether it is "the door" or "the drawer", without naming its owner."""
        plain = self.owner is None and self.location is None and self.side is None and not self.states
        return self.door and len(self.words) == 1 and plain

    def __str__(self) -> str:
        text = " ".join(self.words if self.side is None else (self.side, *self.words))
        if self.owner is not None:
            text += f" of {self.owner}"
        if self.load:
            text += f" with {' and '.join(map(str, self.load))}"
        return text if self.location is None else f"{text} {self.location}"


@dataclass(frozen=True, slots=True)
class Command:
    """One command of a query.

    Attributes:
        kind: The action; "nowhere" lacks its place, "away" means the usual ones of all that is there, "bare" lacks its
            verb, "clear" is about the contents of a place, and "tidy" about all that lies about.
        objects: Objects of the action; for "clear" and "goto", the place; none for "tidy".
        source: Where the object is to be taken from.
        destination: Where it shall go.
        verbless: Whether it has only a noun and a place, as in "apple in the bowl".
        stays: Whether its objects stay as they are, as in "but leave the mug on the table".
        carried: Whether it has the verb of the command before it, as in "put the mug here and the cup there".
        part: "button", "dial" and the like, where the sentence says what is pressed or turned.
    """

    kind: CommandKind
    objects: tuple[NounPhrase, ...]
    source: Location | None = None
    destination: Location | None = None
    verbless: bool = False
    stays: bool = False
    carried: bool = False
    part: str = ""

    def __str__(self) -> str:
        verbs = {
            "pick": "pick up ",
            "place": "put ",
            "nowhere": "put ",
            "away": "put away ",
            "goto": "go to ",
            "bare": "",
            "liked": "",
            "tidy": "tidy up",
            "toss": "throw ",
            "find": "find ",
            "nest": "put into each other ",
            "stand": "stand up ",
            "switch_on": "switch on ",
            "switch_off": "switch off ",
            "operate": f"operate the {self.part} of " if self.part else "operate ",
        }
        verb = verbs.get(self.kind, f"{self.kind} ")
        verb = "" if self.verbless else verb
        text = verb + " and ".join(str(phrase) for phrase in self.objects)
        if self.source is not None:
            text += f" from {self.source.phrase}"
            text += "" if self.source.other is None else f" and {self.source.other}"
        return text if self.destination is None else f"{text} {self.destination}"


Reading = tuple[Command, ...]
"""Commands of a query in one of its readings."""


def is_too_long(tokens: Sequence[TaggedWord]) -> bool:
    """Decide whether a query exceeds the limits of `read`."""
    # Between two joins, such as commas.
    rows = [0]
    for token in tokens:
        if token.terminal in _JOINS:
            rows.append(0)
        elif token.terminal in PREPOSITIONS:
            rows[-1] += 1
    return (
        max(rows) > MAX_PREPOSITIONS_IN_A_ROW
        or sum(rows) > MAX_PREPOSITIONS
        or len(rows) - 1 > MAX_JOINS
        or len(tokens) > MAX_WORDS
    )


def read(tokens: Sequence[TaggedWord]) -> tuple[Reading, ...]:
    """Return the distinct readings of a query, in the order of the grammar; none when it has another form."""
    from lark.exceptions import UnexpectedInput
    from lark.visitors import CollapseAmbiguities

    if not tokens:
        return ()
    try:
        tree = _parser()(tokens)
    except UnexpectedInput:
        return ()
    readings = (_reading(alternative) for alternative in CollapseAmbiguities().transform(tree))
    return tuple(dict.fromkeys(readings))


@cache
def _parser() -> Callable[[Sequence[TaggedWord]], Any]:
    """Return the parser; lark is loaded with the first query, so that importing the package stays cheap."""
    from lark import Lark, Token
    from lark.lexer import Lexer

    class WordLexer(Lexer):
        """Hands over tokens that were made by `read_words`."""

        def __init__(self, lexer_conf: object) -> None:
            pass

        def lex(self, lexer_state: Any, parser_state: Any = None) -> Any:
            """Yield the words as tokens of their class."""
            return (Token(word.terminal, word.text) for word in lexer_state)

    grammar = files("llm.offline").joinpath("grammar.lark").read_text(encoding="utf-8")
    lark: Any = Lark(grammar, parser="earley", lexer=WordLexer, ambiguity="explicit")
    parse: Callable[[Sequence[TaggedWord]], Any] = lark.parse
    return parse


def _reading(tree: Any) -> Reading:
    commands: list[Command] = []
    stays = False
    for child in tree.children:
        if not _is_tree(child):
            stays = child.type == "STAY"
            continue
        command = replace(_command(child), stays=stays)
        stays = False
        if child.data == "also" and commands:
            # "... then the banana": where the thing before it went.
            command = replace(command, destination=commands[-1].destination)
        commands.append(command)
    return tuple(commands)


def _command(tree: Any) -> Command:
    kind = str(tree.data)
    parts = _subtrees(tree)
    if kind == "fill":
        return Command("place", _phrases(parts[1]), destination=Location("IN", _phrase(parts[0]), "in"))
    if kind == "put_in":
        return Command(
            "place", _phrases(parts[0]), destination=Location("IN", NounPhrase(("there",), pronoun="it"), "in")
        )
    source = destination = None
    objects: tuple[NounPhrase, ...] = ()
    for child in parts:
        rule = str(child.data)
        if rule == "source":
            source = _place(child)
        elif rule in ("destination", "there"):
            destination = _place(child)
        elif rule == "load":
            objects = (replace(objects[0], **_load(child), load_apart=True),)
        elif rule == "location":
            objects = (NounPhrase(("everything",), location=_place(child), several=True, everything=True),)
        elif rule == "things":
            objects = (*objects, *_phrases(child))
        else:
            objects = (*objects, _phrase(child))
    if kind == "place" and not objects:
        objects = (NounPhrase(("it",), pronoun="it", elided=True),)
    if kind in ("nowhere", "place") and _are_all(objects[0]) and _puts_away(tree, destination):
        # "Put away everything on the table" and "all the fruit on the table" are about what is there.
        there = objects[0].location or destination
        kind, objects, destination = "away", (replace(objects[0], location=there),), None
    spoken = {child.type for child in tree.children if not _is_tree(child)}
    if kind in SWITCHINGS:
        part = next((str(child) for child in tree.children if str(child) in CONTROLS), "")
        return Command(kind, objects, part=part)
    if kind == "clear" and "EMPTY" in spoken and not objects[0].everything:
        objects = (_contents(objects[0]),)
    if kind == "toss" and destination is None and not _only_from(objects):
        # "Throw the can on the sofa" may say where to.
        return Command("bare" if spoken.isdisjoint(("DISCARD", "AWAY", "UP")) else "toss", objects)
    if kind == "hold":
        where = objects[0].location
        if where is None or where.direction not in REFERENCE_DIRECTIONS:
            return Command("pick", objects)
        # To hold it there is no placing, and nothing else brings it there.
        there = replace(where, direction="AGAINST")
        return Command("place", tuple(replace(phrase, location=None) for phrase in objects), destination=there)
    if kind == "liked":
        # "I want the mug on the table" says where it shall be, or which one it is, and "from the table" says that.
        return Command("bring" if _only_from(objects) else "liked", objects)
    if kind in ("also", "lying", "carried"):
        return Command(
            "place", objects, source, destination, verbless=kind == "lying", carried=kind in ("also", "carried")
        )
    return Command(kind, objects, source, destination)  # type: ignore[arg-type]


def _only_from(phrases: Sequence[NounPhrase]) -> bool:
    """Decide whether no place of things may be where they shall go."""
    return all(phrase.location is None or phrase.location.direction in ("FROM", "OUTOF") for phrase in phrases)


def _are_all(phrase: NounPhrase) -> bool:
    """Decide whether all things are meant, or all of a name."""
    return phrase.everything or (phrase.several and phrase.count is None)


def _puts_away(tree: Any, destination: Location | None) -> bool:
    """Decide whether "away" is where things go; in "put everything away into the fridge" it is not."""
    before = next((child for child in tree.children if _is_tree(child) or str(child) == "away"), None)
    if not any(str(child) == "away" for child in tree.children if not _is_tree(child)):
        return False
    return destination is None or (destination.direction in ("ON", "IN") and not _is_tree(before))


def _place(tree: Any) -> Location:
    sides = [child.type for child in tree.children if not _is_tree(child) and child.type in _SIDES]
    if sides:
        # "On the left table".
        words, states, door = _noun(_subtrees(tree)[-1])
        return Location("ON", NounPhrase(words, states, door=door, side=_SIDES[sides[0]]), "on")
    prepositions = [child for child in tree.children if not _is_tree(child) and child.type in PREPOSITIONS]
    if tree.data == "there":
        # "Put it inside", "put it in there": into an object mentioned before.
        direction: Direction = prepositions[0].type if prepositions else "TO"
        return Location(direction, NounPhrase(("there",), pronoun="it"), " ".join(map(str, prepositions)) or "to")
    parts = [str(child) for child in tree.children if not _is_tree(child) and child.type == "PARTOF"]
    spoken = " ".join((*map(str, prepositions), *parts))
    named = _phrases(tree)
    if prepositions[-1].type in ("BETWEEN", "FROM") and len(named) == 2:
        return Location(prepositions[-1].type, named[0], spoken, other=named[1])
    return Location(prepositions[-1].type, named[-1], spoken, loose=bool(parts))


def _load(tree: Any) -> dict[str, Any]:
    """Return what a thing holds, and whether in or on it."""
    parts = _subtrees(tree)
    contains = any(child.type == "CONTAINING" for child in tree.children if not _is_tree(child))
    at = {"within": "IN", "upon": "ON"}.get(str(parts[-1].data), "OUTOF" if contains else "FROM")
    held = (part for part in parts if part.data not in ("within", "upon"))
    return {"load": tuple(map(_phrase, held)), "load_at": at}


def _phrases(tree: Any) -> tuple[NounPhrase, ...]:
    return tuple(_phrase(part) for part in _subtrees(tree))


def _phrase(tree: Any) -> NounPhrase:
    rule = str(tree.data)
    types = [child.type for child in tree.children if not _is_tree(child)]
    texts = tuple(str(child) for child in tree.children if not _is_tree(child))
    parts = _subtrees(tree)
    location = next((_place(part) for part in parts if part.data == "location"), None)
    if rule in ("pronoun", "them"):
        return NounPhrase(texts, pronoun="it" if rule == "pronoun" else "them", count=_COUNTS.get(types[-1]))
    if rule == "everything":
        return NounPhrase(texts, location=location, several=True, everything=True)
    if rule == "contents":
        return _contents(_phrase(parts[-1]))
    noun = next(part for part in parts if part.data == "noun")
    words, states, door = _noun(noun)
    # "The lower left cabinet".
    words = (*(str(child) for child in tree.children if not _is_tree(child) and child.type == "WORD"), *words)
    load = next((_load(part) for part in parts if part.data == "load"), {})
    count = next((_COUNTS[name] for name in types if name in _COUNTS), None)
    # "Two glasses" and "two of the glasses", but not "the two glasses" or "both glasses".
    some_number = bool(_INDEFINITE & set(types)) and "DETERMINER" not in types
    whichever = "A" in types or some_number or "ONE" in types
    another = not {"another", "a different"}.isdisjoint(texts)
    definite = "DETERMINER" in types
    if rule == "several":
        of_all = NounPhrase(words, states, location, door=door, several=True, count=count, definite=definite)
        return replace(of_all, whichever=whichever, another=another)
    owners = (_phrase(part) for part in parts if rule == "part_of" and part.data not in ("noun", "location", "load"))
    side = next((_SIDES[name] for name in types if name in _SIDES), None)
    several = count is not None or "ALL" in types
    owner = next(owners, None)
    return NounPhrase(
        words,
        states,
        location,
        owner,
        door,
        several,
        count,
        one_of=rule == "one_of",
        whichever=whichever,
        another=another,
        side=side,
        towards=bool(_TOWARDS & set(types)),
        definite=definite,
        **load,
    )


def _contents(place: NounPhrase) -> NounPhrase:
    return NounPhrase(("everything",), (), Location("OUTOF", place, "in"), several=True, everything=True)


def _noun(tree: Any) -> tuple[tuple[str, ...], tuple[Literal["open", "closed"], ...], bool]:
    """Return the words of a name, the states before it, and whether it ends in the name of a door."""
    children = tree.children
    states = {"OPEN": "open", "CLOSE": "closed"}
    adjectives = tuple(states[word.type] for word in children if word.type in states)
    words = tuple(str(word) for word in children if word.type not in states)
    return words, adjectives, children[-1].type == "DOOR"  # type: ignore[return-value]


def _subtrees(tree: Any) -> list[Any]:
    return [child for child in tree.children if _is_tree(child)]


def _is_tree(node: Any) -> bool:
    return hasattr(node, "children")


@cache
def paraphrases(query: str, most: int = 8) -> tuple[str, ...]:
    """Return paraphrases of a query, in an order that depends on the query alone.

    Args:
        query: One request that begins with its verb, such as "put the glass into the refrigerator"; others only get
            courteous forms.
        most: Most paraphrases; they are spread over all that are found.
    """
    lexicon = built_in()
    wanted = _readings(query, lexicon)
    if not wanted:
        return ()
    found = [text for text in rephrasings(query) if _readings(text, lexicon) == wanted]
    step = max(len(found) / most, 1.0)
    return tuple(found[int(place * step)] for place in range(min(most, len(found))))


def _readings(text: str, lexicon: Lexicon) -> frozenset[Reading]:
    return frozenset(read(read_words(text, lexicon)[0]))
