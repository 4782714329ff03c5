"""Ways to make several independent things true at once, cheapest first, without making all combinations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import count

from bddl.goals.search import Way

# The groups that do not use their cheapest way, by rank and in order, each with the number of the way that it uses.
_Picks = tuple[tuple[int, int], ...]


class _Group:
    """The ways of one group, read as far as they were needed."""

    __slots__ = ("_rest", "ways")

    def __init__(self, ways: Iterable[Way]) -> None:
        self._rest = iter(ways)
        self.ways: list[Way] = []

    def has(self, number: int) -> bool:
        """Whether there are more ways than this."""
        while len(self.ways) <= number:
            way = next(self._rest, None)
            if way is None:
                return False
            self.ways.append(way)
        return True

    def extra(self, number: int) -> int:
        """Returns how much more a way costs than the one before it."""
        return self.ways[number].cost - self.ways[number - 1].cost


def combined(base: Way, groups: Sequence[Iterable[Way]]) -> Iterator[Way]:
    """Yields the ways to make all groups true, cheapest first.

    Args:
        base: Literals that every way has.
        groups: For each group its ways, cheapest first; groups share no atom with each other or with the base.

    Source: lazy enumeration of the k smallest sums. With the groups ordered by what their second way costs more, each
        choice follows from one other choice that costs no more: by a step in the last group that it changed, by a
        change in the next one, or by passing a change of one step on to the next. So a heap needs three entries for
        each combination that was asked for, however many groups there are.
    """
    read = [_Group(group) for group in groups]
    if not all([group.has(0) for group in read]):
        return
    cheapest = _joined([base, *(group.ways[0] for group in read)])
    yield cheapest
    ranked = sorted((group for group in read if group.has(1)), key=lambda group: group.extra(1))
    if not ranked:
        return
    serial = count()
    heap: list[tuple[int, int, _Picks]] = [(cheapest.cost + ranked[0].extra(1), next(serial), ((0, 1),))]
    while heap:
        cost, _, picks = heappop(heap)
        numbers = {id(ranked[rank]): number for rank, number in picks}
        yield _joined([base, *(group.ways[numbers.get(id(group), 0)] for group in read)])
        for more, following in _following(ranked, picks):
            heappush(heap, (cost + more, next(serial), following))


def _following(ranked: Sequence[_Group], picks: _Picks) -> Iterator[tuple[int, _Picks]]:
    """Yields the choices that follow from one, with what each costs more."""
    *before, (rank, number) = picks
    last = ranked[rank]
    if last.has(number + 1):
        yield last.extra(number + 1), (*before, (rank, number + 1))
    if rank + 1 < len(ranked):
        extra = ranked[rank + 1].extra(1)
        yield extra, (*picks, (rank + 1, 1))
        if number == 1:
            yield extra - last.extra(1), (*before, (rank + 1, 1))


def _joined(parts: Sequence[Way]) -> Way:
    true, false = 0, 0
    for way in parts:
        true, false = true | way.true, false | way.false
    return Way(sum(way.cost for way in parts), true, false)
