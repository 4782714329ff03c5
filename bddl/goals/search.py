"""The ways to make one cluster of a goal true, cheapest first: a best-first search over what is still to be done."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

from bddl.errors import SearchLimit
from bddl.goals.clusters import Cluster
from bddl.goals.places import Place, Search, Settled
from bddl.goals.prices import Prices


class Way(NamedTuple):
    """Literals that make something true, whatever else holds.

    Attributes:
        cost: What they cost together.
        true: Atoms that have to be true, as a set of bits.
        false: Atoms that have to be false.
    """

    cost: int
    true: int
    false: int

    def within(self, other: Way) -> bool:
        """Whether the other way has all the literals of this one."""
        return not (self.true & ~other.true or self.false & ~other.false)


class Budget:
    """Steps that a search may still take.

    Args:
        steps: How many; each takes time in proportion to the size of the cluster.
    """

    __slots__ = ("left", "steps")

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.left = steps

    def spend(self) -> None:
        """Takes one step.

        Raises:
            SearchLimit: There is none left.
        """
        if self.left <= 0:
            raise SearchLimit(self.steps)
        self.left -= 1


def ways(cluster: Cluster, prices: Prices, budget: Budget) -> Iterator[Way]:
    """Yields the ways to make a cluster true, cheapest first; none holds all literals of another.

    Each way makes the cluster true whatever its other atoms are, by Kleene's tables even when they are unknown. Every
    set of literals that does so contains one of the ways, so when none is left, there are no others.

    Args:
        cluster: The conjuncts to make true.
        prices: What literals cost.
        budget: The steps that may be taken.

    Raises:
        SearchLimit: The budget is spent; there may be more ways.

    Source: A* search (Hart, Nilsson and Raphael, 1968); its bound adds up the least costs of what is still to be
        made true. Where several pledges may use a literal, its price is split, so that the bound never exceeds the
        true cost.
    """
    search = Search(cluster, prices)
    found: list[Way] = []
    serial = count()
    # Of equal bounds the latest goes first, so that the search runs straight to a way.
    heap: list[tuple[int, int, Place | Settled]] = [(0, 0, Place.start(cluster.form.root))]
    while heap:
        bound, _, item = heappop(heap)
        if isinstance(item, Place):
            budget.spend()
            settled = search.settled(item)
            if settled is None:
                continue
            bound = max(bound, search.bound(*settled))
            if heap and heap[0][0] < bound:
                heappush(heap, (bound, -next(serial), settled))
                continue
            item = settled
        place, settling = item
        if settling.open:
            for least, below in reversed(list(search.expanded(place, settling, bound))):
                heappush(heap, (least, -next(serial), below))
            continue
        way = Way(prices.of(place.true, place.false), place.true, place.false)
        if not any(other.within(way) for other in found):
            found.append(way)
            yield way
