"""Progress toward a goal, and the options that make it true, cheapest first.

A goal is brought into negation normal form, in which every negation stands at an atom. The negation of a conjunction is
a choice; that of `forn` is a choice between too many and too few; that of a pairing is the lack of one. Every node has
a lower bound on the cost of making it true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush, nsmallest
from itertools import count
from math import inf
from typing import Final, NamedTuple, TypeAlias

from bddl.ast import Formula, Literal
from bddl.errors import SearchLimit
from bddl.evaluation import State, has_matching, known_bits, largest_matching
from bddl.grounding import (
    All,
    AtLeast,
    Exactly,
    Ground,
    GroundNode,
    Leaf,
    Matching,
    Negation,
    PairSemantics,
    Some,
    ground,
)
from bddl.problem import Objects

# Cost of a node that cannot be made true, and any larger cost. Costs are integers, so sums stay exact.
IMPOSSIBLE: Final = 1 << 60


class Lit(NamedTuple):
    """An atom, by its position in `Ground.atoms`, with the value that it is to have."""

    atom: int
    value: bool


class Every(NamedTuple):
    """All parts, by their positions in `NormalForm.nodes`; no two of the `disjoint` ones share an atom."""

    parts: tuple[int, ...]
    disjoint: tuple[int, ...]


class Either(NamedTuple):
    """At least one part; without parts it is false."""

    parts: tuple[int, ...]


class Enough(NamedTuple):
    """At least `needed` of the parts; `disjoint` when no two parts share an atom."""

    needed: int
    parts: tuple[int, ...]
    disjoint: bool


class Exact(NamedTuple):
    """`needed` of the parts true and all others false; `opposites[i]` is what makes part i false."""

    needed: int
    parts: tuple[int, ...]
    opposites: tuple[int, ...]
    disjoint: bool


Cells: TypeAlias = tuple[tuple[int | None, ...], ...]


class Pairing(NamedTuple):
    """`needed` cells of a table, no two in one row or column; None is a cell that cannot be chosen.

    It is `disjoint` when no two rows share an atom.
    """

    needed: int
    cells: Cells
    disjoint: bool


class NoPairing(NamedTuple):
    """Cells made false until no `needed` of the others can be paired off; a cell holds what makes it false."""

    needed: int
    cells: Cells
    disjoint: bool


NormalNode: TypeAlias = Lit | Every | Either | Enough | Exact | Pairing | NoPairing


@dataclass(frozen=True, slots=True)
class NormalForm:
    """A formula as a graph of nodes.

    Attributes:
        nodes: Every node, after its parts.
        atoms: The atoms below each node, as a set of bits.
        root: The position of the node of the whole formula.
    """

    nodes: tuple[NormalNode, ...]
    atoms: tuple[int, ...]
    root: int

    def costs(self, price: Callable[[Lit], int]) -> list[int]:
        """Return what it costs at least to make each node true, given the price of each literal.

        A price is 0 where the literal holds, from 1 up to make it hold, `IMPOSSIBLE` where it cannot. A cost is 0
        exactly where the literals of price 0 make the node true by Kleene's tables. It is never more than that of the
        cheapest literals that make it true.
        """
        costs: list[int] = []
        for node in self.nodes:
            costs.append(price(node) if isinstance(node, Lit) else self.cost(node, costs))
        return costs

    def cost(self, node: NormalNode, costs: list[int]) -> int:
        """Return the cost of a node, which need not be one of `nodes`, from the costs of its parts."""
        match node:
            case Lit():
                raise TypeError("The cost of a literal is its price.")
            case Every(parts=parts, disjoint=disjoint):
                # Where parts share an atom, one literal may serve both.
                return max(sum([costs[part] for part in disjoint]), max([costs[part] for part in parts], default=0))
            case Either(parts=parts):
                return min([costs[part] for part in parts], default=IMPOSSIBLE)
            case Enough(needed=count, parts=parts, disjoint=disjoint):
                return _cheapest(count, [costs[part] for part in parts], disjoint)
            case Exact(needed=count, parts=parts, opposites=opposites, disjoint=disjoint):
                true, false = [costs[part] for part in parts], [costs[part] for part in opposites]
                if not disjoint or not 0 <= count <= len(parts):
                    return max(_cheapest(count, true, disjoint), _cheapest(len(parts) - count, false, disjoint))
                # All are made false at first; then the cheapest are made true.
                return sum(false) + sum(nsmallest(count, [one - other for one, other in zip(true, false, strict=True)]))
            case Pairing(needed=count, cells=cells, disjoint=disjoint):
                if not has_matching(rows_of(cells, lambda cell: costs[cell] < IMPOSSIBLE), count):
                    return IMPOSSIBLE
                missing = count - len(largest_matching(rows_of(cells, lambda cell: not costs[cell])))
                least = [min([costs[cell] for cell in row if cell is not None], default=IMPOSSIBLE) for row in cells]
                return max(_cheapest(count, least, disjoint), missing if disjoint else min(missing, 1))
            case NoPairing(needed=count, cells=cells, disjoint=disjoint):
                if has_matching(rows_of(cells, lambda cell: costs[cell] >= IMPOSSIBLE), count):
                    return IMPOSSIBLE
                surplus = len(largest_matching(rows_of(cells, lambda cell: costs[cell] > 0))) - count + 1
                return max(0, surplus if disjoint else min(surplus, 1))

    def below(self, node: NormalNode) -> int:
        """Return the atoms of a node, which need not be one of `nodes`, as a set of bits."""
        return _atoms_below(node, self.atoms)


def _parts(node: NormalNode) -> Iterable[int]:
    """Return the positions of the direct parts of a node, without the opposites of counted parts."""
    match node:
        case Lit():
            return ()
        case Every(parts=parts) | Either(parts=parts) | Enough(parts=parts) | Exact(parts=parts):
            return parts
        case Pairing(cells=cells) | NoPairing(cells=cells):
            return [cell for row in cells for cell in row if cell is not None]


def _atoms_below(node: NormalNode, known: Sequence[int]) -> int:
    """Return the atoms of a node as a set of bits, from those of its parts."""
    below = 1 << node.atom if isinstance(node, Lit) else 0
    for part in _parts(node):
        below |= known[part]
    return below


def _cheapest(count: int, costs: list[int], disjoint: bool) -> int:
    if count > len(costs):
        return IMPOSSIBLE
    chosen = nsmallest(count, costs)
    return sum(chosen) if disjoint else max(chosen, default=0)


def rows_of(cells: Cells, test: Callable[[int], bool]) -> list[int]:
    """Return for each row the columns whose cells pass a test, as a set of bits."""
    return [sum([1 << column for column, cell in enumerate(row) if cell is not None and test(cell)]) for row in cells]


def normal_form(ground: Ground) -> NormalForm:
    """Return the formula with negations at its atoms only; parts that the ground formula shares stay shared.

    A state that is known in part makes the normal form true exactly when Kleene's tables make the formula true.
    """
    builder = _FormBuilder()
    stack: list[tuple[GroundNode, bool]] = [(ground.root, True)]
    while stack:
        node, value = stack[-1]
        needed = [part for part in _needed(node, value) if (id(part[0]), part[1]) not in builder.made]
        if needed:
            stack.extend(reversed(needed))
            continue
        stack.pop()
        if (id(node), value) not in builder.made:
            builder.made[id(node), value] = builder.convert(node, value)
    return NormalForm(tuple(builder.nodes), tuple(builder.atoms), builder.made[id(ground.root), True])


def _needed(node: GroundNode, value: bool) -> Iterator[tuple[GroundNode, bool]]:
    match node:
        case Negation(body=body):
            yield body, not value
        case All(parts=parts) | Some(parts=parts) | AtLeast(parts=parts):
            yield from ((part, value) for part in parts)
        case Exactly(parts=parts):
            yield from ((part, wanted) for part in parts for wanted in (True, False))
        case Matching(cells=cells):
            yield from ((cell, value) for row in cells for cell in row if cell is not None)


class _FormBuilder:
    """A normal form under construction; ground nodes are known by identity, each with the value it is to have."""

    def __init__(self) -> None:
        self.nodes: list[NormalNode] = []
        self.atoms: list[int] = []
        self.made: dict[tuple[int, bool], int] = {}

    def convert(self, node: GroundNode, value: bool) -> int:
        """Return the position of the node that gives a ground node a value; its parts exist already."""
        match node:
            case Leaf(atom=atom):
                return self._add(Lit(atom, value))
            case Negation(body=body):
                return self.made[id(body), not value]
            case All(parts=parts) | Some(parts=parts):
                inside = self._all(parts, value)
                return self._every(inside) if isinstance(node, All) == value else self._add(Either(inside))
            case Exactly(count=count, parts=parts):
                true, false = self._all(parts, True), self._all(parts, False)
                disjoint = self._are_disjoint(true)
                if value:
                    return self._add(Exact(count, true, false, disjoint))
                too_many = self._add(Enough(count + 1, true, disjoint))
                too_few = self._add(Enough(len(parts) - count + 1, false, disjoint))
                return self._add(Either((too_many, too_few)))
            case Matching(count=count, cells=cells):
                table = tuple(tuple(None if one is None else self.made[id(one), value] for one in row) for row in cells)
                kind = Pairing if value else NoPairing
                columns: Cells = tuple(zip(*table, strict=True))
                if not self._rows_are_disjoint(table) and self._rows_are_disjoint(columns):
                    table = columns
                return self._add(kind(count, table, self._rows_are_disjoint(table)))
            case AtLeast(count=count, parts=parts):
                inside = self._all(parts, value)
                needed = count if value else len(parts) - count + 1
                return self._add(Enough(needed, inside, self._are_disjoint(inside)))

    def _add(self, node: NormalNode) -> int:
        self.nodes.append(node)
        self.atoms.append(_atoms_below(node, self.atoms))
        return len(self.nodes) - 1

    def _all(self, parts: Iterable[GroundNode], value: bool) -> tuple[int, ...]:
        return tuple([self.made[id(part), value] for part in parts])

    def _every(self, parts: tuple[int, ...]) -> int:
        return self._add(Every(parts, self._first_disjoint(parts)))

    def _are_disjoint(self, parts: tuple[int, ...]) -> bool:
        return len(self._first_disjoint(parts)) == len(parts)

    def _rows_are_disjoint(self, cells: Cells) -> bool:
        covered = 0
        for row in cells:
            atoms = 0
            for cell in row:
                atoms |= 0 if cell is None else self.atoms[cell]
            if covered & atoms:
                return False
            covered |= atoms
        return True

    def _first_disjoint(self, parts: tuple[int, ...]) -> tuple[int, ...]:
        covered = 0
        kept: list[int] = []
        for part in parts:
            if not covered & self.atoms[part]:
                covered |= self.atoms[part]
                kept.append(part)
        return tuple(kept)


# A step of a goal of a hundred atoms takes about half a millisecond.
DEFAULT_STEPS: Final = 5_000

# The literals that have to hold.
Option: TypeAlias = tuple[Literal, ...]


def options(
    goal: Formula,
    objects: Objects | None = None,
    state: State | None = None,
    *,
    pairs: PairSemantics = "matching",
    steps: int = DEFAULT_STEPS,
) -> Iterator[Option]:
    """Return the options that make a goal true, cheapest first, each computed on demand.

    An option is a set of literals such that the goal is true when they hold, whatever the other atoms are and even when
    they are unknown. No option contradicts itself, and none contains another; every set of literals that makes the goal
    true by Kleene's tables contains one. A goal that holds anyway has the one option without literals, and one that
    nothing makes true has none.

    Without a state, an option costs the number of its literals. In a state it costs the number of its literals that do
    not hold there (what is unknown does not hold), and of options that cost the same those with fewer literals come
    first. The literals that hold already are part of the option, since they have to stay.

    Args:
        objects: As for `evaluate`.
        state: Where the goal is to be reached from, as for `evaluate`; None to count from nothing.
        pairs: As for `evaluate`.
        steps: Limit of the search, above which the iterator raises SearchLimit. Goals whose parts share many atoms, or
            contradict each other, may take a number that is exponential in their size.

    Source: docs/bddl.md, Progress and options; A* search (Hart, Nilsson and Raphael, 1968).

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(and (or (open box_0) (open box_1)) (not (open lid_0)))")
        >>> for option in bddl.options(goal, state={bddl.Atom("open", ("box_1",)): True}):
        ...     print(*option)
        (open box_1) (not (open lid_0))
        (open box_0) (not (open lid_0))
    """
    grounded = ground(goal, objects, pairs)
    held = _Choice() if state is None else _Choice(*known_bits(grounded.atoms, state))
    # More than all literals together, so that what has to change counts first.
    surcharge = 0 if state is None else len(grounded.atoms) + 1
    search = _Search(normal_form(grounded), held, surcharge)
    return (
        tuple(
            Literal(atom, bool(solution.true >> at & 1))
            for at, atom in enumerate(grounded.atoms)
            if solution.atoms >> at & 1
        )
        for solution in search.solutions(steps)
    )


class _Choice(NamedTuple):
    """Literals, as sets of bits: atoms to be true, and atoms to be false."""

    true: int = 0
    false: int = 0

    @property
    def atoms(self) -> int:
        """All atoms with a chosen literal."""
        return self.true | self.false

    def holds(self, literal: Lit) -> bool:
        """Decide whether a literal is among them."""
        return bool((self.true if literal.value else self.false) >> literal.atom & 1)

    def with_literal(self, literal: Lit) -> _Choice:
        """Return the choice with one more literal."""
        bit = 1 << literal.atom
        return _Choice(self.true | bit, self.false) if literal.value else _Choice(self.true, self.false | bit)

    def within(self, other: _Choice) -> bool:
        """Decide whether the other choice has all literals of this one."""
        return not (self.true & ~other.true or self.false & ~other.false)


# Nodes that are still to be made true.
_Open: TypeAlias = tuple[NormalNode, ...]


class _Search:
    """A best-first search over the literals chosen so far and the nodes still open.

    Args:
        surcharge: Additional cost of a literal that does not hold at the start; any literal costs 1.
    """

    def __init__(self, form: NormalForm, held: _Choice, surcharge: int) -> None:
        self._form = form
        self._held = held
        self._surcharge = surcharge

    def solutions(self, steps: int) -> Iterator[_Choice]:
        """Yield the minimal choices that make the goal true, cheapest first; raise SearchLimit after too many steps."""
        found: list[_Choice] = []
        # States expanded already: several orders of the same steps lead to one state.
        expanded: set[tuple[_Choice, frozenset[NormalNode]]] = set()
        serial = count()
        # Of equal costs the latest goes first, so that the search runs straight to a solution.
        heap: list[tuple[int, int, _Choice, _Open]] = [(0, 0, _Choice(), (self._form.nodes[self._form.root],))]
        for _ in range(steps):
            if not heap:
                return
            least, _, choice, waiting = heappop(heap)
            propagated = self._propagate(choice, waiting)
            if propagated is None:
                continue
            bound, choice, waiting, costs = propagated
            bound = max(least, bound)
            if heap and heap[0][0] < bound:
                heappush(heap, (bound, -next(serial), choice, waiting))
            elif waiting and (choice, frozenset(waiting)) not in expanded:
                expanded.add((choice, frozenset(waiting)))
                first, *others = waiting
                for branch in reversed(self._branches(first, costs)):
                    heappush(heap, (bound, -next(serial), choice, (*branch, *others)))
            elif not waiting and not any(solution.within(choice) for solution in found):
                found.append(choice)
                yield choice
        if heap:
            raise SearchLimit(steps)

    def _propagate(self, choice: _Choice, waiting: _Open) -> tuple[int, _Choice, _Open, list[int]] | None:
        """Apply the forced steps: choose literals without an alternative, and open conjunctions.

        The result is a lower bound on the cost of the solutions from here, the literals chosen then, the open nodes,
        and the cost of each node. It is None when there is no solution from here.
        """
        while True:
            price = self._prices(choice)
            costs = self._form.costs(price)
            todo, still_open, forced = list(waiting), dict[NormalNode, int](), choice
            while todo:
                node = todo.pop()
                cost = price(node) if isinstance(node, Lit) else self._form.cost(node, costs)
                if cost >= IMPOSSIBLE:
                    return None
                if cost and isinstance(node, Lit):
                    forced = forced.with_literal(node)
                elif cost and isinstance(node, Every):
                    todo.extend(self._form.nodes[part] for part in node.parts)
                elif cost and isinstance(node, Either) and len(left := self._branches(node, costs)) == 1:
                    todo.extend(left[0])
                elif cost:
                    still_open[node] = cost
            if forced.true & forced.false:
                return None
            waiting = tuple(still_open)
            if forced == choice:
                return self._cost(choice) + self._least(still_open), choice, waiting, costs
            choice = forced

    def _least(self, still_open: dict[NormalNode, int]) -> int:
        """Return a lower bound on the cost of making all nodes true: a sum over nodes of which no two share an atom."""
        total = covered = 0
        for node, cost in still_open.items():
            atoms = self._form.below(node)
            if not covered & atoms:
                total += cost
                covered |= atoms
        return max(total, max(still_open.values(), default=0))

    def _prices(self, choice: _Choice) -> Callable[[Lit], int]:
        true, false = choice

        def price(literal: Lit) -> int:
            chosen, ruled_out = (true, false) if literal.value else (false, true)
            if chosen >> literal.atom & 1:
                return 0
            if ruled_out >> literal.atom & 1:
                return IMPOSSIBLE
            return 1 if self._held.holds(literal) else 1 + self._surcharge

        return price

    def _cost(self, choice: _Choice) -> int:
        changed = (choice.true & ~self._held.true).bit_count() + (choice.false & ~self._held.false).bit_count()
        return choice.atoms.bit_count() + self._surcharge * changed

    def _branches(self, node: NormalNode, costs: list[int]) -> list[_Open]:
        """Return the alternatives to an open node; every solution is in one of them."""
        nodes = self._form.nodes
        match node:
            case Either(parts=parts):
                return [(nodes[part],) for part in dict.fromkeys(parts) if costs[part] < IMPOSSIBLE]
            case Enough(needed=needed, parts=parts, disjoint=disjoint):
                left = tuple(part for part in parts if costs[part])
                needed -= len(parts) - len(left)
                with_it = (nodes[left[0]], Enough(needed - 1, left[1:], disjoint))
                return [with_it, (Enough(needed, left[1:], disjoint),)]
            case Exact(needed=needed, parts=(part, *parts), opposites=(opposite, *opposites), disjoint=disjoint):
                rest = tuple(parts), tuple(opposites), disjoint
                return [(nodes[part], Exact(needed - 1, *rest)), (nodes[opposite], Exact(needed, *rest))]
            case Pairing(needed=needed, cells=(row, *rows), disjoint=disjoint):
                chosen: list[_Open] = [
                    (nodes[cell], Pairing(needed - 1, tuple((*one[:at], *one[at + 1 :]) for one in rows), disjoint))
                    for at, cell in enumerate(row)
                    if cell is not None
                ]
                # Equal columns give equal branches.
                return [*dict.fromkeys(chosen), (Pairing(needed, tuple(rows), disjoint),)]
            case NoPairing(needed=needed, cells=cells, disjoint=disjoint):
                # Of cells that can be paired off as long as none is made false, one has to be made false.
                standing = largest_matching(rows_of(cells, lambda cell: costs[cell] > 0))
                return [
                    (nodes[cell], NoPairing(needed, _without_cell(cells, row, column), disjoint))
                    for column, row in sorted(standing.items())[:needed]
                    if (cell := cells[row][column]) is not None
                ]
        raise TypeError(f"There is no choice in {node!r}.")


def _without_cell(cells: Cells, row: int, column: int) -> Cells:
    changed = (*cells[row][:column], None, *cells[row][column + 1 :])
    return (*cells[:row], changed, *cells[row + 1 :])


class GoalProgress:
    """The progress of one goal over the objects of one scene, for every step of a simulation.

    `missing` is a lower bound on the number of literals that must still change, or become known, to make the goal
    true; it is exact where no two conjuncts share an atom. The progress is 1 minus the missing ones as a share of those
    that are missing where nothing is known. So the progress is

    - 1 exactly when the goal is true, by Kleene's tables where the state is known in part: an unknown atom counts as
      one that must still change, whatever value it is to have;
    - 0 where nothing is known (unless nothing needs to be), and for goals that no state can make true by their form
      alone, such as `(or)`;
    - never lower when more becomes known, and always less than 1 for goals that contradict themselves.

    Attributes:
        atoms: The distinct ground atoms that the goal depends on, in the order of `ground`.

    Source: docs/bddl.md, Progress and options.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(and (not (open box_0)) (or (inside cup_0 box_0) (inside cup_1 box_0)))")
        >>> progress = bddl.GoalProgress(goal)
        >>> progress({bddl.Atom("open", ("box_0",)): False})
        0.5
        >>> progress.missing({})
        2
    """

    __slots__ = ("_form", "_least", "atoms")

    def __init__(self, goal: Formula, objects: Objects | None = None, *, pairs: PairSemantics = "matching") -> None:
        grounded = ground(goal, objects, pairs)
        self.atoms = grounded.atoms
        self._form = normal_form(grounded)
        self._least = self._cost(0, 0)

    def __call__(self, state: State) -> float:
        """Return the progress in a state."""
        return self._share(*known_bits(self.atoms, state))

    def packed(self, state: int) -> float:
        """Return the progress in a complete state whose bit i is the value of `atoms[i]`."""
        return self._share(state, ~state)

    def missing(self, state: State) -> float:
        """Return how many literals must at least change or become known; infinity where the goal cannot be true."""
        cost = self._cost(*known_bits(self.atoms, state))
        return inf if cost >= IMPOSSIBLE else cost

    def _cost(self, true: int, false: int) -> int:
        def price(literal: Lit) -> int:
            return 0 if (true if literal.value else false) >> literal.atom & 1 else 1

        return self._form.costs(price)[self._form.root]

    def _share(self, true: int, false: int) -> float:
        cost = self._cost(true, false)
        if not cost:
            return 1.0
        return 0.0 if cost >= IMPOSSIBLE else 1.0 - cost / self._least
