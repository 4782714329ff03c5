"""What BEHAVIOR's activities are made of: the predicates of its two simulators, and the types of rooms.

Source: the domain files and the table of rooms of the reference implementation (PyPI bddl 3.6.0; MIT).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from bddl.vocabulary import PREDICATES, PredicateSpec

_OWN_SPECS = (
    PredicateSpec("future", ("item",), "the item does not exist yet", section=":init"),
    PredicateSpec("real", ("item",), "the item exists", section=":goal"),
    PredicateSpec("insource", ("source", "substance"), "the source gives off the substance"),
    PredicateSpec("grasped", ("agent", "item"), "the agent holds the item"),
    PredicateSpec("burnt", ("item",), "the item is burnt"),
    PredicateSpec("dusty", ("item",), "dust lies on the item"),
    PredicateSpec("perished", ("item",), "the item has gone bad"),
    PredicateSpec("screwed", ("item",), "the item is screwed tight"),
    PredicateSpec("sliced", ("item",), "the item has been cut into slices"),
    PredicateSpec("stained", ("item",), "stains are on the item"),
    PredicateSpec("timeset", ("device",), "the timer of the device is set"),
)
# Every predicate of any domain that is known here.
KNOWN_SPECS: Mapping[str, PredicateSpec] = MappingProxyType({**PREDICATES, **{spec.name: spec for spec in _OWN_SPECS}})


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
