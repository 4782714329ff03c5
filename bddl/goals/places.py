"""Where a search for ways to make a goal true can stand, and where it can go from there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from bddl.goals.clusters import Cluster
from bddl.goals.costs import Costs
from bddl.goals.pledges import Pledge, Settling
from bddl.goals.prices import Prices, Shares


class Place(NamedTuple):
    """A point of the search.

    Attributes:
        true: Atoms chosen to be true, as a set of bits.
        false: Atoms chosen to be false.
        never_true: Atoms that will not be made true from here.
        never_false: Atoms that will not be made false from here.
        whole: Atoms that only one of the pledges can still use.
        pledges: What has to be made true.
    """

    true: int
    false: int
    never_true: int
    never_false: int
    whole: int
    pledges: tuple[Pledge, ...]

    @staticmethod
    def start(root: int) -> Place:
        """Returns the place where nothing is chosen and a node is to be made true."""
        return Place(0, 0, 0, 0, 0, (root,))


# A place after all forced steps, and its pledges as they are then.
Settled: TypeAlias = tuple[Place, Settling]


class Search:
    """Ways from one place to the next in one cluster.

    Args:
        cluster: The conjuncts to make true.
        prices: What literals cost.
    """

    def __init__(self, cluster: Cluster, prices: Prices) -> None:
        self._cluster = cluster
        self._form = cluster.form
        self._prices = prices
        self._shares = Shares(cluster)
        self._costs = Costs(
            cluster.form,
            lambda literal: self._shares.share(literal, prices.of_literal(literal)),
            lambda literal: self._shares.scale * prices.of_literal(literal),
        )

    def bound(self, place: Place, settling: Settling) -> int:
        """Returns no more than the least cost of the ways that lie beyond a place, in shares of a price."""
        return self._shares.scale * self._prices.of(place.true, place.false) + sum(settling.open.values())

    def settled(self, place: Place) -> Settled | None:
        """Returns the place after all forced steps, or None when its pledges cannot be kept."""
        true, false, never_true, never_false, whole, pledges = place
        while True:
            values = self._costs.sweep(true, false, false | never_true, true | never_false, whole)
            settling = Settling(self._form, values, pledges)
            if not settling.run() or (settling.true | true) & (settling.false | false):
                return None
            pledges = tuple(settling.open)
            if settling.true | settling.false:
                true, false = true | settling.true, false | settling.false
                continue
            alone = self._used_once(pledges, ~(true | false | whole)) if self._cluster.entangled else 0
            if not alone:
                return Place(true, false, never_true, never_false, whole, pledges), settling
            whole |= alone

    def _used_once(self, pledges: tuple[Pledge, ...], among: int) -> int:
        """Returns those atoms that one pledge uses and no other, of pledges that are not entangled in themselves."""
        once, twice, tangled = 0, 0, 0
        for pledge in pledges:
            position = pledge if isinstance(pledge, int) else pledge.position
            atoms = self._form.atoms[position] & among
            twice |= once & atoms
            once |= atoms
            tangled |= atoms if self._shares.tangled[position] else 0
        return once & ~twice & ~tangled

    def uses(self, pledge: Pledge, among: int) -> int:
        """Returns which of some atoms a pledge speaks of."""
        return self._form.atoms[pledge if isinstance(pledge, int) else pledge.position] & among

    def expanded(self, place: Place, settling: Settling, bound: int) -> Iterator[tuple[int, Place]]:
        """Yields the places that follow a settled one, with what each costs at least.

        Every smallest way that lies beyond the place lies beyond one of these. They differ in how they go on with one
        of the pledges, the one with the most atoms that others may use too: after it there is the least to clash.
        """
        shared = ~place.whole
        pledge = max(settling.open, key=lambda one: (self.uses(one, shared).bit_count(), -settling.branching(one)))
        others = tuple(other for other in place.pledges if other != pledge)
        for branch in settling.branches(pledge):
            below = Place(
                place.true,
                place.false,
                place.never_true | branch.never_true,
                place.never_false | branch.never_false,
                place.whole,
                (*others, *branch.pledges),
            )
            yield max(bound, bound - settling.open[pledge] + branch.cost), below
