"""Vocabulary of BDDL: predicates with their meanings, synonyms, nouns, sizes of things, and near names.

The usual size of a kind of thing tells which of two arguments comes first. `near_names` finds the legal names that a
misspelt or foreign name may mean.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

# The parameter name that stands for a room; rooms are names of their own and no objects of the scene.
ROOM = "room"


@dataclass(frozen=True, slots=True)
class PredicateSpec:
    """One predicate.

    Attributes:
        name: The name in BDDL text.
        parameters: What each argument stands for, in order; `room` marks the name of a room.
        meaning: When it holds, in words.
        synonyms: Other words for it; they are illegal in BDDL and serve the hints.
        section: The one section that may use it where a profile is strict about that; empty for both.
        kinematic: True for a relation of positions; a start can be set up with it, but not with its denial.
    """

    name: str
    parameters: tuple[str, ...]
    meaning: str
    synonyms: tuple[str, ...] = ()
    section: str = ""
    kinematic: bool = False

    @property
    def arity(self) -> int:
        """How many arguments it takes."""
        return len(self.parameters)

    @property
    def shape(self) -> str:
        """The predicate with its parameters, as shown in messages."""
        return f"({' '.join((self.name, *self.parameters))})"


# What can be set up at the start, but not denied there.
_KINEMATIC = frozenset({"ontop", "inside", "under", "nextto", "touching", "overlaid", "draped", "attached"})
_SECTION_OF = {"inroom": ":init", "future": ":init", "real": ":goal"}


def predicate_table(rows: Iterable[tuple[str, str, str]]) -> Mapping[str, PredicateSpec]:
    """Return predicates by name, from rows of their shapes, their meanings and their synonyms."""
    return MappingProxyType(
        {
            name: PredicateSpec(
                name, tuple(names), meaning, tuple(synonyms.split()), _SECTION_OF.get(name, ""), name in _KINEMATIC
            )
            for shape, meaning, synonyms in rows
            for name, *names in [shape.split()]
        }
    )


# In the order in which messages list them.
PREDICATES = predicate_table((
    ("ontop item support", "the item rests on the support", "on on_top on_top_of onto atop upon above placed_on"),
    ("inside item container", "the item is within the container", "in into within placed_in contained_in stored_in"),
    ("under item cover", "the item is below the cover", "below beneath underneath"),
    ("nextto item neighbour", "the two stand beside each other",
     "next_to beside near adjacent adjacent_to close_to by"),
    ("touching item other", "the two are in contact", "touches in_contact contact"),
    (f"inroom item {ROOM}", "the item is in the room", "in_room inside_room located_in room"),
    ("open fixture", "some relevant joint of the fixture is past its opening threshold", "opened is_open isopen ajar"),
    ("toggled_on device", "the device is switched on", "turned_on switched_on powered_on turnon turn_on activated"),
    ("cooked item", "the item has been cooked", "baked fried boiled"),
    ("frozen item", "the item is frozen", "iced"),
    ("hot item", "the item is hot", "heated warm warmed"),
    ("on_fire item", "the item burns", "burning lit aflame"),
    ("broken item", "the item is broken", "shattered smashed"),
    ("folded item", "the item is folded", ""),
    ("unfolded item", "the item is spread out", ""),
    ("covered item substance", "the substance covers the item", "covered_with covered_by"),
    ("filled container substance", "the substance fills the container", "filled_with full_of"),
    ("contains container substance", "the container holds some of the substance", "has holds"),
    ("saturated item substance", "the item is soaked with the substance", "soaked soaked_with"),
    ("overlaid cover item", "the cover lies over the item", "laid_over"),
    ("draped cover item", "the cover hangs over the item", "draped_over hung_on"),
    ("attached part base", "the part is fixed to the base", "attached_to fixed_to mounted_on"),
))  # fmt: skip

# Words that stand for a whole formula, as a template over the arguments.
REWRITES: Mapping[str, tuple[int, str]] = MappingProxyType(
    {
        **dict.fromkeys(("closed", "shut", "is_closed", "isclosed", "close"), (1, "(not (open {0}))")),
        **dict.fromkeys(
            ("held", "holding", "grasped", "gripped", "in_hand", "in_gripper", "inhand", "picked_up", "grasping"),
            (1, "(inside {0} gripper)"),
        ),
        **dict.fromkeys(("toggled_off", "turned_off", "switched_off", "turnoff", "off"), (1, "(not (toggled_on {0}))")),
        **dict.fromkeys(("unbroken", "intact"), (1, "(not (broken {0}))")),
        **dict.fromkeys(("cold",), (1, "(not (hot {0}))")),
        **dict.fromkeys(("outside", "not_inside", "not_in"), (2, "(not (inside {0} {1}))")),
        **dict.fromkeys(("not_on", "off_of", "not_ontop"), (2, "(not (ontop {0} {1}))")),
    }
)

# Connectives that BDDL lacks, and how it expresses them; the words that they resemble mean something else.
ABSENT_CONNECTIVES: Mapping[str, str] = MappingProxyType(
    {
        "nand": "(not (and FORMULA FORMULA))",
        "nor": "(not (or FORMULA FORMULA))",
        "xor": "(and (or FORMULA FORMULA) (not (and FORMULA FORMULA)))",
        "iff": "(and (imply FORMULA FORMULA) (imply FORMULA FORMULA))",
        "unless": "(imply (not FORMULA) FORMULA)",
    }
)

# Words that name no one predicate, with those that they may stand for.
VAGUE_PREDICATES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    dict.fromkeys(("at", "located_at", "placed", "located", "positioned"), ("ontop", "inside", "nextto", "on", "in"))
)

# Other words for the quantifiers that count; what stands behind them differs, so they are no synonyms.
COUNTING_WORDS = frozenset(
    {"atleast", "at_least", "at-least", "exactly", "at_most", "atmost", "at-most", "count", "forsome", "exists_n"}
)

# Other words for the connectives and quantifiers.
FORM_SYNONYMS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("&", "&&", "all_of", "conjunction"), "and"),
        **dict.fromkeys(("|", "||", "any_of", "either", "disjunction"), "or"),
        **dict.fromkeys(("!", "~", "no", "negate", "isnt"), "not"),
        **dict.fromkeys(("implies", "=>", "->", "if", "when", "then"), "imply"),
        **dict.fromkeys(("for_all", "for-all", "all", "every", "each", "foreach"), "forall"),
        **dict.fromkeys(("exist", "there_exists", "any", "some"), "exists"),
    }
)

# Words for the same kind of thing: a hint may lead from one to another.
NOUN_GROUPS: tuple[frozenset[str], ...] = (
    frozenset({"refrigerator", "fridge", "icebox", "freezer"}),
    frozenset({"glass", "cup", "mug", "tumbler", "water_glass", "beaker", "coffee_cup"}),
    frozenset({"table", "desk", "counter", "countertop", "breakfast_table", "coffee_table"}),
    frozenset({"cabinet", "cupboard", "closet", "wardrobe", "bottom_cabinet", "top_cabinet"}),
    frozenset({"bowl", "dish", "plate", "basin"}),
    frozenset({"stove", "oven", "cooker", "burner"}),
    frozenset({"bin", "trash_can", "garbage_can", "ashcan", "wastebasket"}),
    frozenset({"sofa", "couch", "settee"}),
    frozenset({"shelf", "bookcase", "rack", "bookshelf"}),
    frozenset({"gripper", "hand", "eef", "end_effector", "panda_hand"}),
    frozenset({"robot", "agent", "panda", "franka"}),
)

_SIMULATOR_PREDICATES = predicate_table((
    ("future item", "the item does not exist yet", ""),
    ("real item", "the item exists", ""),
    ("insource source substance", "the source gives off the substance", ""),
    ("grasped agent item", "the agent holds the item", ""),
    ("burnt item", "the item is burnt", ""),
    ("dusty item", "dust lies on the item", ""),
    ("perished item", "the item has gone bad", ""),
    ("screwed item", "the item is screwed tight", ""),
    ("sliced item", "the item has been cut into slices", ""),
    ("stained item", "stains are on the item", ""),
    ("timeset device", "the timer of the device is set", ""),
))  # fmt: skip
# Every predicate of any domain that is known here.
KNOWN_SPECS: Mapping[str, PredicateSpec] = MappingProxyType({**PREDICATES, **_SIMULATOR_PREDICATES})


def _table(names: str) -> Mapping[str, PredicateSpec]:
    return MappingProxyType({name: KNOWN_SPECS[name] for name in names.split()})


OMNIGIBSON = _table(
    "cooked frozen open folded unfolded toggled_on hot on_fire future real broken saturated covered filled contains "
    "ontop nextto under touching inside overlaid attached draped insource inroom grasped"
)
# The domain file of iGibson lacks `inroom`, which its problems use all the same.
IGIBSON = _table(
    "inside nextto ontop under broken burnt cooked dusty frozen open perished screwed stained sliced saturated timeset "
    "toggled_on inroom"
)

# The newer names are those of the benchmarks that the simulators serve.
DOMAINS: Mapping[str, Mapping[str, PredicateSpec]] = MappingProxyType(
    {"omnigibson": OMNIGIBSON, "behavior-1k": OMNIGIBSON, "igibson": IGIBSON, "behavior-100": IGIBSON}
)

_ROOM_NAMES = (
    "bar bathroom bedroom break_room childs_room classroom closet computer_lab corridor dining_room empty_room "
    "entryway garage garden grocery_store kitchen living_room lobby meeting_room playroom private_office sauna "
    "shared_office spa staircase storage_room television_room utility_room"
)
ROOMS = frozenset(_ROOM_NAMES.split())

# A category is a synset of WordNet, or one that BEHAVIOR made up in the same form.
SYNSET = re.compile(r"[a-z_\-]+\.n\.[0-9]+")
SYNSET_RULE = "a category looks like apple.n.01"

_SYNSET_TAIL = re.compile(r"\.[a-z]\.\d+.*\Z")
_INDEX = re.compile(r"_\d+\Z")


class Size(Enum):
    """Size class of a kind of thing."""

    FIXTURE = "stands in a room"
    ITEM = "fits into a hand"
    SUBSTANCE = "fills or covers other things"


_NOUNS_IN_WORDS = {
    Size.FIXTURE: (
        "table desk counter countertop shelf bookcase bench island sofa couch bed sink floor refrigerator fridge "
        "cabinet cupboard wardrobe microwave oven dishwasher freezer washer dryer stove dresser bathtub fireplace "
        "driveway lawn toilet"
    ),
    Size.ITEM: (
        "cup glass apple bottle bowl knife mug plate can jar fork spoon pan pot banana orange lemon peach pear tomato "
        "potato onion carrot egg book sponge teapot pitcher jug pen pencil fruit vegetable sandwich wineglass "
        "phone remote candle toy napkin sock teaspoon"
    ),
    Size.SUBSTANCE: (
        "water dust stain dirt mud milk juice oil sauce wine beer coffee tea soup salt pepper sugar flour rust grease "
        "vinegar detergent soap sand snow"
    ),
}
_NOUNS = {size: frozenset(nouns.split()) for size, nouns in _NOUNS_IN_WORDS.items()}


def size_of(category: str) -> Size | None:
    """Return the size class of a category, or None for an unknown word.

    Args:
        category: Such as `water_glass`, `refrigerator.n.01` or the name of an object, `glass_0`. The last word of a
            compound decides.

    Example:
        >>> size_of("breakfast_table.n.01"), size_of("water_glass"), size_of("thing")
        (<Size.FIXTURE: 'stands in a room'>, <Size.ITEM: 'fits into a hand'>, None)
    """
    stem = _INDEX.sub("", _SYNSET_TAIL.sub("", category.casefold()))
    last = stem.replace("-", "_").rsplit("_", 1)[-1]
    return next((size for size, nouns in _NOUNS.items() if last in nouns), None)


# Predicates whose first argument is the smaller thing, and those whose second one is a substance.
ITEM_FIRST = frozenset({"ontop", "inside"})
_SUBSTANCE_LAST = frozenset({"covered", "filled", "contains", "saturated", "insource"})
_HANDS = frozenset({"gripper", "robot"})


def swap_reason(predicate: str, first: str, second: str) -> str:
    """Return why the sizes of two things suggest that they are swapped, or "" when they do not.

    Args:
        predicate: A predicate of two arguments.
        first: Category of the first thing, or its name.
        second: Category of the second thing, or its name.

    Example:
        >>> swap_reason("ontop", "table", "glass")
        '`table` is larger than `glass`'
    """
    sizes = size_of(first), size_of(second)
    if predicate in _SUBSTANCE_LAST and sizes[0] is Size.SUBSTANCE and sizes[1] not in (Size.SUBSTANCE, None):
        return f"a substance such as `{first}` comes last"
    if predicate in ITEM_FIRST and first in _HANDS and second not in _HANDS and sizes[1] is Size.ITEM:
        return "what is held comes first, the gripper last"
    if predicate in ITEM_FIRST and sizes == (Size.FIXTURE, Size.ITEM):
        return f"`{first}` is larger than `{second}`"
    return ""


_NUMBER = re.compile(r"(?:_|-|\.)?\d+$")
_DENIAL = re.compile(r"(?:is_?not|isn_?t|not|non|no)[_\-](?P<word>.+)")
_MOST = 3
# The word of the language that another word means.
SYNONYM_OF = {synonym: spec.name for spec in PREDICATES.values() for synonym in spec.synonyms} | dict(FORM_SYNONYMS)


def near_names(name: str, legal: Iterable[str]) -> tuple[str, ...]:
    """Return up to three legal names that the given one may have meant, the likeliest first.

    A synonym comes before the same noun with another number, that before another noun for the same kind of thing,
    that before a spelling slip of one or two letters (one in a short name). Letter case is ignored.

    Args:
        name: The name that was not found.
        legal: The names that would have been legal.

    Returns:
        The near names, likeliest first; empty when none is near.

    Example:
        >>> near_names("on", PREDICATES)
        ('ontop',)
        >>> near_names("fridge_0", ["table_0", "refrigerator_0"])
        ('refrigerator_0',)
    """
    wanted = name.casefold()
    ranked = []
    denied = denied_word(wanted)
    for option in dict.fromkeys(legal):
        rank = _rank(wanted, option.casefold())
        # A word that says the contrary is not near, however alike the letters are.
        contrary = wanted in ABSENT_CONNECTIVES or denied_word(option.casefold()) != denied
        if rank is not None and option != name and (rank[0] < 2 or not contrary):
            ranked.append((rank, option))
    ranked.sort()
    return tuple(option for _, option in ranked[:_MOST])


def denied_word(name: str) -> str:
    """Return the word that a name such as `not_open` denies, or "" when it denies none.

    Example:
        >>> denied_word("not_open"), denied_word("notebook")
        ('open', '')
    """
    found = _DENIAL.fullmatch(name)
    return found["word"] if found is not None else ""


def _rank(wanted: str, option: str) -> tuple[int, int] | None:
    """Return how far the option is from the wanted name (smaller is nearer), or None when it is not near."""
    if wanted == option or SYNONYM_OF.get(wanted) == option:
        return (0, 0)
    wanted_stem, option_stem = _NUMBER.sub("", wanted), _NUMBER.sub("", option)
    same_index = 0 if wanted.removeprefix(wanted_stem) == option.removeprefix(option_stem) else 1
    if wanted_stem and _squeeze(wanted_stem) == _squeeze(option_stem):
        return (1, same_index)
    if any(wanted_stem in group and option_stem in group for group in NOUN_GROUPS):
        return (2, same_index)
    longest = max(len(wanted_stem), len(option_stem))
    allowed = 0 if longest < 3 else 1 if longest < 6 else 2
    slips = edit_distance(wanted_stem, option_stem, at_most=allowed)
    if slips is not None and slips > 0:
        return (2 + slips, same_index)
    parts = set(wanted_stem.split("_")) & set(option_stem.split("_"))
    if any(len(part) > 2 for part in parts):
        return (5, same_index)
    if min(len(wanted_stem), len(option_stem)) >= 4 and (wanted_stem in option_stem or option_stem in wanted_stem):
        return (6, same_index)
    return None


def _squeeze(stem: str) -> str:
    return stem.replace("_", "").replace("-", "")


def edit_distance(left: str, right: str, at_most: int) -> int | None:
    """Return how many letters to insert, delete, replace or swap with a neighbour, or None when more than allowed."""
    if abs(len(left) - len(right)) > at_most:
        return None
    before: list[int] = []
    above = list(range(len(right) + 1))
    for row, letter in enumerate(left, start=1):
        current = [row]
        for column, other in enumerate(right, start=1):
            cost = min(above[column] + 1, current[-1] + 1, above[column - 1] + (letter != other))
            if row > 1 and column > 1 and letter == right[column - 2] and left[row - 2] == other:
                cost = min(cost, before[column - 2] + 1)
            current.append(cost)
        if min(current) > at_most:
            return None
        before, above = above, current
    return above[-1] if above[-1] <= at_most else None
