"""What a search for ways to make a goal true has still to do, and how it can go on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from heapq import nsmallest
from typing import NamedTuple, TypeAlias

from bddl.goals.assignment import INFINITE
from bddl.goals.costs import Lines, exact_cost, pairing_cost, pairs_stand, uncovered_cost
from bddl.goals.normal import AtLeast, Either, Every, Exact, Lit, NoPairing, NormalForm, Pairing


class Counted(NamedTuple):
    """So many of the parts of an `AtLeast` or `Exact` that are not decided yet."""

    position: int
    needed: int
    left: tuple[int, ...]


class Paired(NamedTuple):
    """So many cells of the rows and columns of a `Pairing` that are not used yet."""

    position: int
    needed: int
    rows: tuple[int, ...]
    columns: tuple[int, ...]


class Uncovered(NamedTuple):
    """The cells of a `NoPairing` outside of so many rows and columns, which are still to be chosen, made false.

    By Kőnig's theorem no `needed` cells can be chosen exactly when fewer lines than that hold all that are not false.

    Attributes:
        position: The node's.
        spare: How many lines can still be chosen.
        bare: Lines that are not chosen; where two of them cross, the cell is pledged.
        left: Lines that may be chosen.
    """

    position: int
    spare: int
    bare: Lines
    left: Lines


# A node to be made true, by its position, or what is left of one.
Pledge: TypeAlias = int | Counted | Paired | Uncovered


class Branch(NamedTuple):
    """One way to go on with a pledge.

    Attributes:
        pledges: What takes the pledge's place.
        cost: No more than what they cost together.
        never_true: Atoms that are not made true on this branch, since another branch has all ways that do.
        never_false: Atoms that are not made false.
    """

    pledges: tuple[Pledge, ...]
    cost: int
    never_true: int = 0
    never_false: int = 0


class Settling:
    """Pledges under the costs that the literals chosen so far leave: kept ones are dropped, forced steps are taken.

    Args:
        form: The normal form that the pledges speak of.
        values: What each node costs now.
        pledges: What has to be made true.
    """

    __slots__ = ("_form", "_pledged", "_todo", "_values", "false", "open", "true")

    def __init__(self, form: NormalForm, values: Sequence[int], pledges: Iterable[Pledge]) -> None:
        self._form = form
        self._values = values
        self._todo: list[Pledge] = list(pledges)
        self._pledged = {pledge for pledge in self._todo if isinstance(pledge, int)}
        # Literals that turned out to be forced, and the pledges that remain, with what they cost at least.
        self.true = 0
        self.false = 0
        self.open: dict[Pledge, int] = {}

    def run(self) -> bool:
        """Settles everything; False when a pledge cannot be kept."""
        while self._todo:
            pledge = self._todo.pop()
            if isinstance(pledge, int):
                possible = self._settle_node(pledge)
            elif isinstance(pledge, Uncovered):
                possible = self._settle_uncovered(pledge)
            else:
                possible = self._settle_count(pledge) if isinstance(pledge, Counted) else self._settle_pairs(pledge)
            if not possible:
                return False
        return True

    def branches(self, pledge: Pledge) -> list[Branch]:
        """Returns ways to go on with an open pledge; every smallest way to keep all pledges lies on one of them."""
        if isinstance(pledge, Counted):
            return self._count_branches(pledge)
        if isinstance(pledge, Paired):
            return self._pair_branches(pledge)
        if isinstance(pledge, Uncovered):
            return self._line_branches(pledge)
        node = self._form.nodes[pledge]
        return list(self._choices(node.parts)) if isinstance(node, Either) else []

    def branching(self, pledge: Pledge) -> int:
        """Returns roughly how many branches an open pledge has."""
        if isinstance(pledge, Counted):
            return 2
        if isinstance(pledge, Paired):
            return len(pledge.columns) + 1
        if isinstance(pledge, Uncovered):
            return 2
        node = self._form.nodes[pledge]
        return len(node.parts) if isinstance(node, Either) else 1

    def _pledge(self, *positions: int) -> None:
        self._todo.extend(positions)
        self._pledged.update(positions)

    def _settle_node(self, position: int) -> bool:
        cost = self._values[position]
        if not 0 < cost < INFINITE:
            return not cost
        match self._form.nodes[position]:
            case Lit(atom=atom, value=True):
                self.true |= 1 << atom
            case Lit(atom=atom):
                self.false |= 1 << atom
            case Every(parts=parts):
                self._pledge(*parts)
            case Either(parts=parts):
                possible = [part for part in parts if self._values[part] < INFINITE]
                if len(possible) == 1:
                    self._pledge(*possible)
                else:
                    self.open[position] = cost
            case AtLeast(needed=count, parts=parts) | Exact(needed=count, wanted=parts):
                return self._settle_count(Counted(position, count, tuple(range(len(parts)))))
            case Pairing(needed=count, cells=cells):
                self.open[Paired(position, count, tuple(range(len(cells))), tuple(range(len(cells[0]))))] = cost
            case NoPairing(needed=count, cells=cells):
                left = Lines(tuple(range(len(cells))), tuple(range(len(cells[0]))))
                return self._settle_uncovered(Uncovered(position, count - 1, Lines((), ()), left))
        return True

    def _settle_count(self, pledge: Counted) -> bool:
        wanted, unwanted = self._counted_parts(pledge)
        count, left = pledge.needed, list[int]()
        for index in pledge.left:
            if self._granted(wanted[index]):
                count -= 1
            elif unwanted and self._granted(unwanted[index]):
                continue
            elif self._values[wanted[index]] >= INFINITE:
                self._pledge(*unwanted[index : index + 1])
            elif unwanted and self._values[unwanted[index]] >= INFINITE:
                self._pledge(wanted[index])
                count -= 1
            else:
                left.append(index)
        if count <= 0 and not unwanted:
            return True
        if not 0 <= count <= len(left):
            return False
        if count in (0, len(left)):
            self._pledge(*((wanted if count else unwanted)[index] for index in left))
        else:
            rest = Counted(pledge.position, count, tuple(left))
            self.open[rest] = self._count_cost(rest)
        return True

    def _settle_pairs(self, pledge: Paired) -> bool:
        cost = pairing_cost(pledge.needed, self._pair_costs(pledge))
        if 0 < cost < INFINITE:
            self.open[pledge] = cost
        return cost < INFINITE

    def _settle_uncovered(self, pledge: Uncovered) -> bool:
        position, spare, bare, left = pledge
        node = self._form.nodes[position]
        costs = self._uncovered_costs(position)
        if not isinstance(node, NoPairing) or not self._values[position] or not pairs_stand(node.needed, costs):
            return True
        if not spare:
            rows, columns = bare.rows + left.rows, bare.columns + left.columns
            self._pledge(*(cell for row in rows for column in columns if (cell := node.cells[row][column]) is not None))
            return True
        cost = uncovered_cost(spare, costs, bare, left)
        if cost < INFINITE:
            self.open[pledge] = cost
        return cost < INFINITE

    def _uncovered_costs(self, position: int) -> list[list[int]]:
        """Returns what it costs to make each cell of a `NoPairing` false, nothing where that is pledged already."""
        node = self._form.nodes[position]
        cells = node.cells if isinstance(node, NoPairing) else ()
        return [[0 if cell is None or self._granted(cell) else self._values[cell] for cell in row] for row in cells]

    def _line_branches(self, pledge: Uncovered) -> list[Branch]:
        """Returns the two ways to go on with a line: it is chosen, or its cells at the bare lines are made false."""
        position, spare, bare, (rows, columns) = pledge
        costs = self._uncovered_costs(position)
        if rows:
            line, left = rows[0], Lines(rows[1:], columns)
            places = [(line, column) for column in bare.columns]
            more = Lines((*bare.rows, line), bare.columns)
        else:
            line, left = columns[0], Lines(rows, columns[1:])
            places = [(row, line) for row in bare.rows]
            more = Lines(bare.rows, (*bare.columns, line))
        node = self._form.nodes[position]
        table = node.cells if isinstance(node, NoPairing) else ()
        paid = {cell: costs[row][column] for row, column in places if (cell := table[row][column]) is not None}
        chosen, unchosen = Uncovered(position, spare - 1, bare, left), Uncovered(position, spare, more, left)
        return [
            Branch((chosen,), uncovered_cost(spare - 1, costs, bare, left)),
            Branch((*paid, unchosen), sum(paid.values()) + uncovered_cost(spare, costs, more, left)),
        ]

    def _granted(self, position: int) -> bool:
        """Whether a node is true by what was chosen, or will be since it is pledged."""
        return not self._values[position] or position in self._pledged

    def _counted_parts(self, pledge: Counted) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Returns what makes each part true and what makes it false; nothing for the latter where it may be both."""
        node = self._form.nodes[pledge.position]
        if isinstance(node, Exact):
            return node.wanted, node.unwanted
        return (node.parts if isinstance(node, AtLeast) else ()), ()

    def _count_cost(self, pledge: Counted) -> int:
        wanted, unwanted = self._counted_parts(pledge)
        costs = [self._values[wanted[index]] for index in pledge.left]
        if unwanted:
            return exact_cost(pledge.needed, costs, [self._values[unwanted[index]] for index in pledge.left])
        return sum(nsmallest(pledge.needed, costs))

    def _count_branches(self, pledge: Counted) -> list[Branch]:
        wanted, unwanted = self._counted_parts(pledge)
        index, rest = pledge.left[0], pledge.left[1:]
        fewer = Counted(pledge.position, pledge.needed - 1, rest)
        same = Counted(pledge.position, pledge.needed, rest)
        with_it = Branch((wanted[index], fewer), self._values[wanted[index]] + self._count_cost(fewer))
        if unwanted:
            cost = self._values[unwanted[index]] + self._count_cost(same)
            return [with_it, Branch((unwanted[index], same), cost)]
        return [with_it, Branch((same,), self._count_cost(same), *self._as_bits(wanted[index]))]

    def _pair_branches(self, pledge: Paired) -> list[Branch]:
        position, count, (row, *others), columns = pledge
        rest = tuple(others)
        cost = self.open[pledge]
        found: list[Branch] = []
        for place, cell in enumerate(self._pair_costs(pledge)[0]):
            if cell < INFINITE:
                chosen = self._cell(position, row, columns[place])
                fewer = columns[:place] + columns[place + 1 :]
                found.append(Branch((*chosen, Paired(position, count - 1, rest, fewer)), cost))
        if len(rest) >= count:
            found.append(Branch((Paired(position, count, rest, columns),), cost))
        return found

    def _cell(self, position: int, row: int, column: int) -> tuple[int, ...]:
        """Returns the cell of a pairing as a tuple of one, or of none where it is missing."""
        node = self._form.nodes[position]
        cell = node.cells[row][column] if isinstance(node, Pairing) else None
        return () if cell is None else (cell,)

    def _pair_costs(self, pledge: Paired) -> list[list[int]]:
        return [
            [
                self._values[cell[0]] if (cell := self._cell(pledge.position, row, column)) else INFINITE
                for column in pledge.columns
            ]
            for row in pledge.rows
        ]

    def _choices(self, parts: Sequence[int]) -> Iterator[Branch]:
        """Yields a branch for each part, literals first; each leaves out the literals of those before it."""
        never_true, never_false = 0, 0
        possible = [part for part in parts if self._values[part] < INFINITE]
        for part in sorted(possible, key=lambda part: not isinstance(self._form.nodes[part], Lit)):
            yield Branch((part,), self._values[part], never_true, never_false)
            true, false = self._as_bits(part)
            never_true, never_false = never_true | true, never_false | false

    def _as_bits(self, position: int) -> tuple[int, int]:
        """Returns a literal's atom among those to be made true or among those to be made false; nothing for others."""
        node = self._form.nodes[position]
        if not isinstance(node, Lit):
            return 0, 0
        return (1 << node.atom, 0) if node.value else (0, 1 << node.atom)
