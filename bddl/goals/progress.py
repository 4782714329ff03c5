"""How far a goal is reached: the share of a cheapest way to make it true that holds already."""

from __future__ import annotations

from math import inf, lcm
from typing import Final, Protocol

from bddl.goals.assignment import INFINITE
from bddl.goals.clusters import Cluster, clusters
from bddl.goals.costs import Costs
from bddl.goals.negations import normal_form
from bddl.goals.prices import Shares
from bddl.goals.search import Budget
from bddl.goals.untangle import untangled
from bddl.problem import Objects
from bddl.semantics.ground import PairSemantics, ground
from bddl.semantics.knownstate import State
from bddl.semantics.statebits import known_bits, numbered
from bddl.syntax import Formula

# Entangled conjuncts are rewritten when that visits no more nodes and ends in no more alternatives.
_MOST_NODES: Final = 500_000
_MOST_ALTERNATIVES: Final = 64


class _Part(Protocol):
    """Conjuncts that share no atom with the others, ready to be asked what they still cost."""

    # Costs are in units of one scale-th of a literal.
    scale: int

    def cost(self, true: int, false: int) -> int:
        """Returns what is missing where some atoms are true and some are false."""


class _Literals:
    """Literals that every way to the goal has."""

    def __init__(self, true: int, false: int) -> None:
        self.scale = 1
        self._true = true
        self._false = false

    def cost(self, true: int, false: int) -> int:
        return (self._true & ~true).bit_count() + (self._false & ~false).bit_count()


class _Summed:
    """Conjuncts whose cost is computed from the literals up."""

    def __init__(self, cluster: Cluster) -> None:
        shares = Shares(cluster)
        self.scale = shares.scale
        self._costs = Costs(cluster.form, lambda literal: shares.share(literal, 1))
        self._root = cluster.form.root

    def cost(self, true: int, false: int) -> int:
        return self._costs.sweep(true, false)[self._root]


class GoalProgress:
    """The progress of one goal over the objects of one scene, ready to be asked in every step of a simulation.

    `missing` is the number of literals that must still change, or become known, in a cheapest way to make the goal
    true. The progress is 1 minus the missing ones as a share of those that are missing where nothing is known, which
    is the number of literals in the cheapest way of all. So the progress is

    - 1 exactly when the goal is true, by Kleene's tables where the state is known in part: an unknown atom counts as
      one that must still change, whatever value it is to have;
    - 0 where nothing is known (unless nothing needs to be), and for goals that no state can make true by their form
      alone, such as `(or)`;
    - always less than 1 for goals that contradict themselves, however they do it;
    - never lower after a wrong literal of a cheapest way was put right, if `exact`: it rises by one share each time.

    Conjunctions add up, disjunctions take the least, `forn` makes the cheapest parts true and the others false,
    `forpairs` takes a cheapest assignment, and negations are pushed down to the atoms first. Adding up is exact where
    conjuncts share no atom. Where they do, they are rewritten as a choice between forms whose parts share none, up to
    a limit, which makes it exact again. Beyond the limit the price of an atom is split evenly among its uses: then
    `missing` may be a fraction, never exceeds the true number, and is still 0 exactly when the goal is true; `exact`
    is False.

    Args:
        goal: Any formula.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers.
        pairs: How `forpairs` and `fornpairs` are read, as for `evaluate`.

    Attributes:
        atoms: The distinct ground atoms that the goal depends on, in the order of `compile_goal`.
        exact: Whether `missing` is the least number of literals in every state. False beyond the limit above, and
            where the goal is found to contradict itself, so that no number is right.

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
        2.0
    """

    __slots__ = ("_bits", "_every", "_least", "_parts", "_unit", "atoms", "exact")

    def __init__(self, goal: Formula, objects: Objects | None = None, *, pairs: PairSemantics = "matching") -> None:
        grounded = ground(goal, objects, pairs)
        found = clusters(normal_form(grounded))
        self.atoms = grounded.atoms
        self._bits = numbered(self.atoms)
        self._every = (1 << len(self.atoms)) - 1
        groups = [_untangled(cluster) for cluster in found.groups]
        self.exact = not found.contradictory and not any(group.entangled for group in groups)
        parts: list[_Part] = [_Summed(group) for group in groups]
        if found.true or found.false:
            parts.append(_Literals(found.true, found.false))
        # Costs of all parts are brought to one unit, so that their sum is a whole number.
        self._unit = lcm(*(part.scale for part in parts))
        self._parts = [(part.cost, self._unit // part.scale) for part in parts]
        self._least = self._cost(0, 0)

    def __call__(self, state: State) -> float:
        """Returns the progress in a state.

        Args:
            state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for
                unknown.

        Returns:
            A number from 0 to 1.
        """
        return self._share(*known_bits(self._bits, state))

    def packed(self, state: int) -> float:
        """Returns the progress in a complete state that was packed by `CompiledGoal.pack`: bit i is `atoms[i]`."""
        return self._share(state, self._every & ~state)

    def missing(self, state: State) -> float:
        """Returns how many literals must still change or become known.

        Args:
            state: As for the progress.

        Returns:
            A whole number if `exact`; infinity where no state can make the goal true by its form alone.
        """
        cost = self._cost(*known_bits(self._bits, state))
        return inf if cost >= INFINITE else cost / self._unit

    def _cost(self, true: int, false: int) -> int:
        return sum([cost(true, false) * units for cost, units in self._parts])

    def _share(self, true: int, false: int) -> float:
        cost = self._cost(true, false)
        if not cost:
            return 1.0
        return 0.0 if cost >= INFINITE else 1.0 - cost / self._least


def progress(
    goal: Formula,
    state: State,
    objects: Objects | None = None,
    *,
    pairs: PairSemantics = "matching",
) -> float:
    """Returns how far a goal is reached in a state, from 0 to 1, and 1 exactly when it is true there.

    To ask about many states, make a `GoalProgress` once; it says what exactly is counted.

    Args:
        goal: Any formula.
        state: What is known: a mapping in which an absent atom is unknown, or a function that returns None for unknown.
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers.
        pairs: How `forpairs` and `fornpairs` are read, as for `evaluate`.

    Raises:
        ObjectsRequired: There is a quantifier and `objects` is None.
        UnknownPairSemantics: `pairs` is neither of the two.

    Source: docs/bddl.md, Progress and options.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(forn (1) (?x - cup) (inside ?x box_0))")
        >>> state = {bddl.Atom("inside", (cup, "box_0")): True for cup in ("cup_0", "cup_1")}
        >>> bddl.progress(goal, state, {"cup_0": "cup", "cup_1": "cup", "box_0": "box"})
        0.5
    """
    return GoalProgress(goal, objects, pairs=pairs)(state)


def _untangled(cluster: Cluster) -> Cluster:
    """Returns the same conjuncts in a form in which costs are exact, if there is one of reasonable size."""
    if not cluster.entangled:
        return cluster
    form = untangled(cluster, Budget(_MOST_NODES // len(cluster.form.nodes)), _MOST_ALTERNATIVES)
    return cluster if form is None else Cluster(form, entangled=False)
