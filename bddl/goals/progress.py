"""How far a goal is reached: the share of the literals of a cheapest way that hold already."""

from __future__ import annotations

from math import inf

from bddl.goals.normal import IMPOSSIBLE, Lit, normal_form
from bddl.semantics.ground import PairSemantics, ground
from bddl.semantics.states import State, known_bits
from bddl.syntax import Formula
from bddl.syntax.problem import Objects


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
        objects: Category of each object, or the declared objects of a problem; needed for quantifiers.
        pairs: How `forpairs` and `fornpairs` are read, as for `evaluate`.

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
