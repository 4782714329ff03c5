"""Single-edit mutants of activities: each is invalid in one known way, at known lines.

The generator works on words and parentheses alone and shares no code with the parser that it serves to test.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from benchmarks.conformance.cutting import Definition, Form, cut, listed

_LETTERS = "abcdefghijklmnopqrstuvwxyz"
KINEMATIC = frozenset(listed("attached draped inside nextto ontop overlaid touching under"))
CONNECTIVES = frozenset(listed("and or not imply forall exists forn forpairs fornpairs"))


@dataclass(frozen=True, slots=True)
class Mutant:
    """An activity with one mistake.

    Attributes:
        kind: The kind of mistake.
        activity: Name of the activity.
        text: The text with the mistake.
        lines: The lines of the text that the edit touched; where words were only taken away, the line they stood in.
    """

    kind: str
    activity: str
    text: str
    lines: tuple[int, ...]


# An edit puts a text in place of a range of offsets.
_Edits = list[tuple[int, int, str]]
_Maker = Callable[[Definition, random.Random], _Edits | None]


def mutants(activity: str, text: str, seed: int) -> Iterator[Mutant]:
    """Yield one mutant of each kind that the activity allows.

    Args:
        activity: Name of the activity.
        text: Its definition, which must be valid.
        seed: Decides where the edits are made.
    """
    definition = cut(text)
    for kind, make in KINDS.items():
        edits = make(definition, random.Random(f"{seed}/{kind}/{activity}"))
        if edits:
            mutated, lines = _applied(text, edits)
            yield Mutant(kind, activity, mutated, lines)


def _applied(text: str, edits: _Edits) -> tuple[str, tuple[int, ...]]:
    """Return the edited text and the lines that the edits touched, in its own count."""
    pieces: list[str] = []
    position = length = 0
    places: list[tuple[int, int]] = []
    for start, end, put in sorted(edits):
        pieces += [text[position:start], put]
        length += start - position
        places.append((length, length + len(put)))
        length += len(put)
        position = end
    mutated = "".join(pieces) + text[position:]
    lines: set[int] = set()
    for start, end in places:
        # Line breaks at the rim of what was put in belong to its neighbours.
        put = mutated[start:end]
        first = start + len(put) - len(put.lstrip("\n"))
        last = max(first, end - (len(put) - len(put.rstrip("\n"))))
        lines |= set(range(mutated.count("\n", 0, first) + 1, mutated.count("\n", 0, last) + 2))
    return mutated, tuple(sorted(lines))


def _misspelt(word: str, legal: frozenset[str], rng: random.Random) -> str:
    """Return the word with one slip that makes it no legal word."""
    while True:
        spot = rng.randrange(1, len(word))
        slip = rng.choice(("drop", "double", "change", "swap"))
        if slip == "drop":
            found = word[:spot] + word[spot + 1 :]
        elif slip == "double":
            found = word[:spot] + word[spot] + word[spot:]
        elif slip == "change":
            found = word[:spot] + rng.choice(_LETTERS) + word[spot + 1 :]
        else:
            found = word[: spot - 1] + word[spot] + word[spot - 1] + word[spot + 1 :]
        if found not in legal and len(found) > 1 and found[0] == word[0]:
            return found


def _delete_parenthesis(definition: Definition, rng: random.Random) -> _Edits | None:
    place = rng.choice([token.start for token in definition.tokens if token.text in "()"])
    return [(place, place + 1, "")]


def _insert_parenthesis(definition: Definition, rng: random.Random) -> _Edits | None:
    token = rng.choice(definition.tokens)
    place = rng.choice((token.start, token.end))
    return [(place, place, rng.choice("()"))]


def _unknown_predicate(section: str) -> _Maker:
    def make(definition: Definition, rng: random.Random) -> _Edits | None:
        head = rng.choice(definition.atoms(section)).items[0]
        return [(head.start, head.end, _misspelt(head.text, PREDICATES | CONNECTIVES, rng))]

    return make


def _checked_atoms(definition: Definition, section: str) -> list[Form]:
    """Return the atoms of a section without those about rooms, which the reference never looks at."""
    return [atom for atom in definition.atoms(section) if atom.head != "inroom"]


def _drop_argument(section: str) -> _Maker:
    def make(definition: Definition, rng: random.Random) -> _Edits | None:
        atom = rng.choice(_checked_atoms(definition, section))
        spot = rng.randrange(1, len(atom.items))
        return [(atom.items[spot - 1].end, atom.items[spot].end, "")]

    return make


def _add_argument(section: str) -> _Maker:
    def make(definition: Definition, rng: random.Random) -> _Edits | None:
        atom = rng.choice(_checked_atoms(definition, section))
        last = atom.items[-1]
        return [(last.end, last.end, f" {rng.choice(definition.objects)}")]

    return make


def _undeclared_object(section: str) -> _Maker:
    def make(definition: Definition, rng: random.Random) -> _Edits | None:
        atoms = _checked_atoms(definition, section)
        names = [item for atom in atoms for item in atom.items[1:] if item.text.strip("?") in definition.objects]
        return _renumbered(rng.choice(names), rng) if names else None

    return make


def _undeclared_in_room(definition: Definition, rng: random.Random) -> _Edits | None:
    atoms = [atom for atom in definition.atoms(":init") if atom.items[0].text == "inroom"]
    return _renumbered(rng.choice(atoms).items[1], rng) if atoms else None


def _renumbered(name: Form, rng: random.Random) -> _Edits:
    stem = name.text.rpartition("_")[0]
    return [(name.start, name.end, f"{stem}_{rng.randrange(40, 99)}")]


def _unknown_room(definition: Definition, rng: random.Random) -> _Edits | None:
    atoms = [atom for atom in definition.atoms(":init") if atom.items[0].text == "inroom"]
    if not atoms:
        return None
    room = rng.choice(atoms).items[2]
    return [(room.start, room.end, rng.choice((_misspelt(room.text, frozenset(), rng) + "x", "attic", "cellar")))]


def _unbound_variable(definition: Definition, rng: random.Random) -> _Edits | None:
    bound = {binder.items[0].text for binder in definition.binders()}
    uses = [item for atom in definition.atoms(":goal") for item in atom.items[1:] if item.text in bound]
    if not uses:
        return None
    use = rng.choice(uses)
    return [(use.start, use.end, rng.choice(("?thing", "?nothing.n.01", use.text + "x")))]


def _undeclared_category(definition: Definition, rng: random.Random) -> _Edits | None:
    binders = definition.binders()
    if not binders:
        return None
    category = rng.choice(binders).items[2]
    return [(category.start, category.end, rng.choice(("unicorn.n.01", "phoenix.n.02", category.text + "7")))]


def _missing_hyphen(definition: Definition, rng: random.Random) -> _Edits | None:
    binders = definition.binders()
    if not binders:
        return None
    hyphen = rng.choice(binders).items[1]
    return [(hyphen.start, hyphen.end, "")]


def _misspelt_section(name: str) -> _Maker:
    def make(definition: Definition, rng: random.Random) -> _Edits | None:
        head = definition.sections[name].items[0]
        return [(head.start + 1, head.end, _misspelt(head.text[1:], frozenset({name[1:]}), rng))]

    return make


def _second_goal(definition: Definition, rng: random.Random) -> _Edits | None:
    whole = definition.sections[":goal"].items[1]
    if whole.head != "and" or len(whole.items) < 3:
        return None
    moved = whole.items[-1]
    # The conjunction ends before its last conjunct instead of behind it.
    before = whole.items[-2].end
    # What stands outside now counts as touched, although its words stay.
    return [(before, before, ")"), (moved.start, moved.end, definition.source(moved)), (moved.end, whole.end, "")]


def _second_operand_of_not(definition: Definition, rng: random.Random) -> _Edits | None:
    negations = [form for form in definition.walk(":goal") if form.head == "not"]
    if not negations:
        return None
    inner = rng.choice(negations).items[1]
    atom = rng.choice(definition.atoms(":goal"))
    names = [item for item in atom.items[1:] if item.text.strip("?") in definition.objects]
    if len(names) < len(atom.items) - 1:
        name = rng.choice(definition.objects)
        return [(inner.end, inner.end, f" (ontop {name} {name})")]
    return [(inner.end, inner.end, f" {definition.source(atom)}")]


def _repeated_category(definition: Definition, rng: random.Random) -> _Edits | None:
    lines = [line for line in definition.object_lines() if len(line.names) > 1]
    if not lines:
        return None
    line = rng.choice(lines)
    spot = line.names[rng.randrange(1, len(line.names))]
    return [(spot.start, spot.start, f"- {line.category.text}\n        ")]


def _dropped_object_line(definition: Definition, rng: random.Random) -> _Edits | None:
    line = rng.choice(definition.object_lines())
    start = definition.text.rfind("\n", 0, line.names[0].start)
    end = definition.text.find("\n", line.category.end)
    return [(start, end, "")] if 0 <= start < end else None


def _dropped_last_type(definition: Definition, rng: random.Random) -> _Edits | None:
    line = definition.object_lines()[-1]
    return [(line.names[-1].end, line.category.end, "")]


def _wrong_type(definition: Definition, rng: random.Random) -> _Edits | None:
    category = rng.choice(definition.object_lines()).category
    return [(category.start, category.end, rng.choice(("unicorn.n.01", "phoenix.n.02", category.text[:-1] + "9")))]


def _contradictory_init(definition: Definition, rng: random.Random) -> _Edits | None:
    section = definition.sections[":init"]
    literals = [form for form in section.items[1:] if form.head not in (*KINEMATIC, "inroom", "not")]
    if not literals:
        return None
    literal = rng.choice(literals)
    place = rng.choice((literal.end, section.items[-1].end, section.items[0].end))
    return [(place, place, f"\n        (not {definition.source(literal)})")]


def _negated_kinematics(definition: Definition, rng: random.Random) -> _Edits | None:
    literals = [form for form in definition.sections[":init"].items[1:] if form.head in KINEMATIC]
    if not literals:
        return None
    literal = rng.choice(literals)
    return [(literal.start, literal.start, "(not "), (literal.end, literal.end, ")")]


def _future_without_real(definition: Definition, rng: random.Random) -> _Edits | None:
    future = {form.items[1].text for form in definition.sections[":init"].items[1:] if form.head == "future"}
    whole = definition.sections[":goal"].items[1]
    if whole.head != "and" or any(name.startswith("water.n.06") for name in future):
        return None
    named = [form.items[1].text.strip("?") for form in definition.walk(":goal") if form.head == "real"]
    only = [
        form
        for form in whole.items[1:]
        if form.head == "real" and form.items[1].text.strip("?") in future and named.count(form.items[1].text[1:]) == 1
    ]
    if not only or len(whole.items) < 3:
        return None
    dropped = rng.choice(only)
    return [(dropped.start, dropped.end, "")]


def _junk_word(definition: Definition, rng: random.Random) -> _Edits | None:
    section = rng.choice(list(definition.sections.values()))
    return [(section.end, section.end, rng.choice((" junk", "\\", " x", " and", "\n    42")))]


def _second_init(definition: Definition, rng: random.Random) -> _Edits | None:
    section = definition.sections[":init"]
    name = rng.choice(definition.objects)
    return [(section.end, section.end, f"\n    (:init (ontop {name} {name}))")]


PREDICATES = frozenset(
    listed(
        "cooked frozen open folded unfolded toggled_on hot on_fire future real broken saturated covered filled "
        "contains ontop nextto under touching inside overlaid attached draped insource inroom grasped"
    )
)

# Kinds that leave nothing behind where they took something away: what is missing shows where it is used.
OMISSIONS = frozenset({"dropped object line", "future without real"})

KINDS: Mapping[str, _Maker] = {
    "delete a parenthesis": _delete_parenthesis,
    "insert a parenthesis": _insert_parenthesis,
    "unknown predicate in the goal": _unknown_predicate(":goal"),
    "unknown predicate in init": _unknown_predicate(":init"),
    "argument dropped in the goal": _drop_argument(":goal"),
    "argument dropped in init": _drop_argument(":init"),
    "argument added in the goal": _add_argument(":goal"),
    "argument added in init": _add_argument(":init"),
    "undeclared object in the goal": _undeclared_object(":goal"),
    "undeclared object in init": _undeclared_object(":init"),
    "undeclared object in inroom": _undeclared_in_room,
    "unknown room": _unknown_room,
    "unbound variable": _unbound_variable,
    "undeclared category": _undeclared_category,
    "missing hyphen": _missing_hyphen,
    "misspelt :goal": _misspelt_section(":goal"),
    "misspelt :init": _misspelt_section(":init"),
    "misspelt :objects": _misspelt_section(":objects"),
    "misspelt :domain": _misspelt_section(":domain"),
    "second goal expression": _second_goal,
    "second operand of not": _second_operand_of_not,
    "repeated category line": _repeated_category,
    "dropped object line": _dropped_object_line,
    "dropped last type": _dropped_last_type,
    "wrong type of an instance": _wrong_type,
    "contradictory init": _contradictory_init,
    "negated kinematics in init": _negated_kinematics,
    "future without real": _future_without_real,
    "junk between sections": _junk_word,
    "second :init section": _second_init,
}
