"""The ways to make a goal true, cheapest first, one after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from heapq import heappop, heappush
from itertools import count
from math import inf
from typing import Final, NamedTuple, TypeAlias

from bddl.goals.normal import (
    IMPOSSIBLE,
    Cells,
    Either,
    Enough,
    Every,
    Exact,
    Lit,
    NoPairing,
    NormalForm,
    NormalNode,
    Pairing,
    normal_form,
    rows_of,
)
from bddl.semantics.ground import ground
from bddl.semantics.matching import largest_matching
from bddl.semantics.members import PairSemantics
from bddl.semantics.truth import State, known_bits
from bddl.syntax.errors import SearchLimit
from bddl.syntax.problem import Objects
from bddl.syntax.structure import Literal
from bddl.syntax.tree import Formula

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
    """Returns the ways to make a goal true, cheapest first, each made only when it is asked for.

    An option is a set of literals such that the goal is true when they hold, whatever the other atoms are and even
    when they are unknown. No option contradicts itself, and none contains another; every set of literals that makes
    the goal true by Kleene's tables contains one. A goal that holds anyway has the one option without literals, and
    one that nothing makes true has none.

    Without a state, an option costs the number of its literals. In a state it costs the number of its literals that
    do not hold there (what is unknown does not hold), and of options that cost the same those with fewer literals
    come first; the literals that hold already are part of the option, since they have to stay. A wildcard of BEHAVIOR
    is counted as one object, of which CountedWildcard warns.

    Args:
        goal: Any formula.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers.
        state: Where the goal is to be reached from, as for `evaluate`; None to count from nothing.
        pairs: How `forpairs` and `fornpairs` are read, as for `evaluate`.
        steps: How many steps the search may take. Goals whose parts share many atoms, or contradict each other, may
            take a number that is exponential in their size.

    Returns:
        An iterator over options; the literals of each stand in the order in which the goal first names their atoms.

    Raises:
        ObjectsRequired: There is a quantifier and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.
        SearchLimit: Raised by the iterator when the steps are used up; there may be more options, or none at all.

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
        tuple(Literal(atom, bool(way.true >> at & 1)) for at, atom in enumerate(grounded.atoms) if way.atoms >> at & 1)
        for way in search.ways(steps)
    )


class _Choice(NamedTuple):
    """Literals, as sets of bits: atoms to be true, and atoms to be false."""

    true: int = 0
    false: int = 0

    @property
    def atoms(self) -> int:
        """All atoms of which a literal is chosen."""
        return self.true | self.false

    def holds(self, literal: Lit) -> bool:
        """Decides whether a literal is among them."""
        return bool((self.true if literal.value else self.false) >> literal.atom & 1)

    def with_literal(self, literal: Lit) -> _Choice:
        """Returns the choice with one literal more."""
        bit = 1 << literal.atom
        return _Choice(self.true | bit, self.false) if literal.value else _Choice(self.true, self.false | bit)

    def within(self, other: _Choice) -> bool:
        """Decides whether the other choice has all literals of this one."""
        return not (self.true & ~other.true or self.false & ~other.false)


# What has to be made true still.
_Open: TypeAlias = tuple[NormalNode, ...]


class _Search:
    """A best-first search over literals chosen so far and what has to be made true beside them.

    Args:
        form: The goal.
        held: The literals that hold at the start.
        surcharge: What a literal costs, beside 1, that does not hold at the start.
    """

    def __init__(self, form: NormalForm, held: _Choice, surcharge: int) -> None:
        self._form = form
        self._held = held
        self._surcharge = surcharge

    def ways(self, steps: int) -> Iterator[_Choice]:
        """Yields the smallest choices that make the goal true, cheapest first.

        Raises:
            SearchLimit: More steps would be needed.
        """
        found: list[_Choice] = []
        # Where the search was already: several orders of the same steps lead to one place.
        expanded: set[tuple[_Choice, frozenset[NormalNode]]] = set()
        serial = count()
        # Of equal costs the latest goes first, so that the search runs straight to a way.
        heap: list[tuple[int, int, _Choice, _Open]] = [(0, 0, _Choice(), (self._form.nodes[self._form.root],))]
        for _ in range(steps):
            if not heap:
                return
            least, _, choice, waiting = heappop(heap)
            settled = self._settled(choice, waiting)
            if settled is None:
                continue
            bound, choice, waiting, costs = settled
            bound = max(least, bound)
            if heap and heap[0][0] < bound:
                heappush(heap, (bound, -next(serial), choice, waiting))
            elif waiting and (choice, frozenset(waiting)) not in expanded:
                expanded.add((choice, frozenset(waiting)))
                first, *others = waiting
                for branch in reversed(self._branches(first, costs)):
                    heappush(heap, (bound, -next(serial), choice, (*branch, *others)))
            elif not waiting and not any(way.within(choice) for way in found):
                found.append(choice)
                yield choice
        if heap:
            raise SearchLimit(steps)

    def _settled(self, choice: _Choice, waiting: _Open) -> tuple[int, _Choice, _Open, list[int]] | None:
        """Takes the steps that leave no choice: literals are chosen, parts of conjunctions are waited for.

        Returns:
            The least cost of the ways from here, the literals chosen then, the nodes that leave a choice, and the
            cost of each node of the goal beside the literals chosen; None when there is no way from here.
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
        """Returns what it costs at least to make all nodes true: the sum over nodes of which no two share an atom."""
        total = seen = 0
        for node, cost in still_open.items():
            atoms = self._form.below(node)
            if not seen & atoms:
                total += cost
                seen |= atoms
        return max(total, max(still_open.values(), default=0))

    def _prices(self, choice: _Choice) -> Callable[[Lit], int]:
        """Returns what each literal costs beside those chosen."""
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
        """Returns what can take the place of a node that leaves a choice; all ways are in one of them."""
        nodes = self._form.nodes
        match node:
            case Either(parts=parts):
                return [(nodes[part],) for part in dict.fromkeys(parts) if costs[part] < IMPOSSIBLE]
            case Enough(needed=needed, parts=parts, apart=apart):
                left = tuple(part for part in parts if costs[part])
                needed -= len(parts) - len(left)
                with_it = (nodes[left[0]], Enough(needed - 1, left[1:], apart))
                return [with_it, (Enough(needed, left[1:], apart),)]
            case Exact(needed=needed, parts=(part, *parts), opposites=(opposite, *opposites), apart=apart):
                rest = tuple(parts), tuple(opposites), apart
                return [(nodes[part], Exact(needed - 1, *rest)), (nodes[opposite], Exact(needed, *rest))]
            case Pairing(needed=needed, cells=(row, *rows), apart=apart):
                chosen: list[_Open] = [
                    (nodes[cell], Pairing(needed - 1, tuple((*one[:at], *one[at + 1 :]) for one in rows), apart))
                    for at, cell in enumerate(row)
                    if cell is not None
                ]
                # Where the columns say the same, so do the branches.
                return [*dict.fromkeys(chosen), (Pairing(needed, tuple(rows), apart),)]
            case NoPairing(needed=needed, cells=cells, apart=apart):
                # Of cells that can be paired off as long as all of them stand, one has to be made false.
                standing = largest_matching(rows_of(cells, lambda cell: costs[cell] > 0))
                return [
                    (nodes[cell], NoPairing(needed, _without(cells, row, column), apart))
                    for column, row in sorted(standing.items())[:needed]
                    if (cell := cells[row][column]) is not None
                ]
        raise TypeError(f"There is no choice in {node!r}.")


def _without(cells: Cells, row: int, column: int) -> Cells:
    changed = (*cells[row][:column], None, *cells[row][column + 1 :])
    return (*cells[:row], changed, *cells[row + 1 :])


class GoalProgress:
    """The progress of one goal over the objects of one scene, ready to be asked in every step of a simulation.

    `missing` is a lower bound on the number of literals that must still change, or become known, to make the goal
    true; it is exact where no two conjuncts share an atom. The progress is 1 minus the missing ones as a share of those
    that are missing where nothing is known. So the progress is

    - 1 exactly when the goal is true, by Kleene's tables where the state is known in part: an unknown atom counts as
      one that must still change, whatever value it is to have;
    - 0 where nothing is known (unless nothing needs to be), and for goals that no state can make true by their form
      alone, such as `(or)`;
    - never lower when more becomes known, and always less than 1 for goals that contradict themselves.

    Conjunctions add up, disjunctions take the least, `forn` makes the cheapest parts true and the others false,
    `forpairs` counts the pairs that are missing, and negations are pushed down to the atoms first. Where conjuncts
    share an atom, one literal may serve several of them, and only one counts.

    Args:
        goal: Any formula.
        objects: As for `evaluate`.
        pairs: As for `evaluate`.

    Attributes:
        atoms: The distinct ground atoms that the goal depends on, in the order of `compile_goal`.

    Raises:
        ObjectsRequired: There is a quantifier and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.

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
        """Returns the progress in a state.

        Args:
            state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for
                unknown.

        Returns:
            A number from 0 to 1.
        """
        return self._share(*known_bits(self.atoms, state))

    def packed(self, state: int) -> float:
        """Returns the progress in a complete state that was packed by `CompiledGoal.pack`: bit i is `atoms[i]`."""
        return self._share(state, ~state)

    def missing(self, state: State) -> float:
        """Returns how many literals must at least change or become known.

        Args:
            state: As for the progress.

        Returns:
            A whole number; infinity where no state can make the goal true by its form alone.
        """
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
