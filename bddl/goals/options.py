"""The cheapest ways to make a goal true, one after another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, TypeAlias

from bddl.errors import SearchLimit
from bddl.exact.smt import smt_text
from bddl.exact.solver import solve
from bddl.goals.clusters import Clusters, clusters
from bddl.goals.combinations import combined
from bddl.goals.negations import normal_form
from bddl.goals.prices import Prices
from bddl.goals.search import Budget, Way, ways
from bddl.problem import Objects
from bddl.semantics.ground import Ground, PairSemantics, ground
from bddl.semantics.knownstate import State
from bddl.semantics.statebits import known_bits, numbered
from bddl.structure import Literal
from bddl.syntax import Formula

DEFAULT_STEPS: Final = 20_000

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
    when they are unknown. Every set of literals that makes the goal true in this sense, by Kleene's tables, contains
    an option; no option contradicts itself, and none contains another. A goal that holds anyway has the one option
    without literals, and one that nothing makes true has none.

    Without a state, an option costs the number of its literals. In a state it costs the number of its literals that
    do not hold there (what is unknown does not hold), and of options that cost the same those with fewer literals
    come first; the literals that hold already are part of the option, since they have to stay.

    Nothing is enumerated that is not asked for: conjuncts that share no atom are searched apart and combined lazily.

    Args:
        goal: Any formula.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers.
        state: Where the goal is to be reached from, as for `evaluate`; None to count from nothing.
        pairs: How `forpairs` and `fornpairs` are read, as for `evaluate`.
        steps: How many steps the search may take for each group of conjuncts that share atoms. Goals that contradict
            themselves in roundabout ways may take more than any number.

    Returns:
        An iterator over options; the literals of each stand in the order in which the goal first names their atoms.

    Raises:
        ObjectsRequired: There is a quantifier and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.
        SearchLimit: Raised by the iterator when the steps are used up and it is not known that there are no more
            options. When none was found at all, z3 decides first whether there is one.
        SolverMissing: Raised by the iterator when z3 is needed for that and not installed.

    Source: docs/bddl.md, Progress and options.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(and (or (open box_0) (open box_1)) (not (open lid_0)))")
        >>> for option in bddl.options(goal, state={bddl.Atom("open", ("box_1",)): True}):
        ...     print(*option)
        (open box_1) (not (open lid_0))
        (open box_0) (not (open lid_0))
    """
    grounded = ground(goal, objects, pairs)
    parts = clusters(normal_form(grounded))
    prices = Prices()
    if state is not None:
        prices = Prices(*known_bits(numbered(grounded.atoms), state), surcharge=len(grounded.atoms) + 1)
    return _options(grounded, parts, prices, steps)


def _options(grounded: Ground, parts: Clusters, prices: Prices, steps: int) -> Iterator[Option]:
    if parts.contradictory:
        return
    base = Way(prices.of(parts.true, parts.false), parts.true, parts.false)
    lists = [ways(cluster, prices, Budget(steps)) for cluster in parts.groups]
    found = False
    try:
        for way in combined(base, lists):
            found = True
            yield _literals(grounded, way)
    except SearchLimit:
        if found or solve(smt_text(grounded)).status != "unsat":
            raise


def _literals(grounded: Ground, way: Way) -> Option:
    chosen = way.true | way.false
    return tuple(
        Literal(atom, bool(way.true >> index & 1)) for index, atom in enumerate(grounded.atoms) if chosen >> index & 1
    )
