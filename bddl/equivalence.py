"""Whether two goals say the same of a scene, and a state that tells them apart where they do not.

Quantifiers are expanded over the objects of the scene, so the question is one of Boolean atoms, which z3 decides. Atoms
are regarded as independent: no physics and no knowledge of the start is assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from bddl.ast import And, Atom, Formula, literals
from bddl.diagnostics import BDDLError
from bddl.dialects import Profile
from bddl.errors import FormulaTooLarge
from bddl.evaluation import evaluate
from bddl.grounding import GroundNode, PairSemantics, check_pair_semantics, children, count_ground_parts, ground
from bddl.parser import check, read_formula
from bddl.problem import Objects, categories_of
from bddl.smt import DEFAULT_TIMEOUT_MS, Script, Solver, SolverAnswer

# A pair of goals that grounds to more parts is refused, since its text would take minutes to write and to read.
MOST_PARTS = 200_000


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Answer to the question whether two goals hold in the same states; it is true when they do.

    Attributes:
        equal: Whether they do; None when the solver did not decide it in time.
        state: A state in which exactly one of them holds, with a value for each atom of the two; None without one.
        holds: The goal that holds in that state, "a" or "b"; empty without a state.
        reason: For an undecided question, why.
    """

    equal: bool | None
    state: Mapping[Atom, bool] | None = None
    holds: str = ""
    reason: str = ""

    def __bool__(self) -> bool:
        return self.equal is True

    def __str__(self) -> str:
        if self.state is None:
            return "The goals hold in the same states." if self else f"It is undecided: {self.reason}."
        true = [str(atom) for atom, value in self.state.items() if value]
        return f"Goal {self.holds} alone holds where {' '.join(true) or 'nothing'} is true, and all else is false."


def equivalent(
    goal_a: Formula | str,
    goal_b: Formula | str,
    scene: Objects,
    *,
    pairs: PairSemantics = "matching",
    profile: str | Profile = "auto",
    timeout_ms: int = DEFAULT_TIMEOUT_MS,
) -> Equivalence:
    """Decide whether two goals hold in exactly the same states of a scene.

    Args:
        scene: Category of each object, or the declared objects of a problem.
        pairs: How `forpairs` is read, as in `evaluate`.
        timeout_ms: The most time that the solver may take [ms].

    Raises:
        BDDLError: A text is not legal, or a goal names objects that the scene lacks.
        FormulaTooLarge: The goals have too many parts once their quantifiers are expanded.
        SolverMissing: The question needs z3, which is not installed.

    Source: Tseitin's names for parts, and a matching with its certificate both ways (`bddl.smt`).

    Example:
        >>> import bddl
        >>> cups = {"cup_0": "cup", "cup_1": "cup", "table_0": "table"}
        >>> both = "(and (ontop cup_0 table_0) (ontop cup_1 table_0))"
        >>> bool(bddl.equivalent("(forall (?x - cup) (ontop ?x table_0))", both, cups))
        True
        >>> print(bddl.equivalent("(exists (?x - cup) (ontop ?x table_0))", both, cups))
        Goal a alone holds where (ontop cup_0 table_0) is true, and all else is false.
    """
    check_pair_semantics(pairs)
    first, second = read_formula(goal_a, profile), read_formula(goal_b, profile)
    objects = categories_of(scene)
    _check_names((first, second), profile, objects)
    if _are_alike(first, second):
        return Equivalence(True)
    size = count_ground_parts(And((first, second)), objects, MOST_PARTS)
    if size > MOST_PARTS:
        raise FormulaTooLarge(MOST_PARTS)
    grounded = ground(And((first, second)), objects, pairs)

    def distinguished(state: Callable[[Atom], bool]) -> Equivalence | None:
        values = [evaluate(goal, state, objects, pairs=pairs) for goal in (first, second)]
        if values[0] is values[1]:
            return None
        return Equivalence(False, {atom: state(atom) for atom in grounded.atoms}, "a" if values[0] else "b")

    # Most goals that differ do so in a simple state, and the solver takes a while to load.
    for guess in _guesses(grounded.atoms):
        found = distinguished(guess)
        if found is not None:
            return found
    # The root is a conjunction of the two; where both are one node, they have the same ground form.
    parts = children(grounded.root)
    if parts[0] is parts[-1]:
        return Equivalence(True)
    return _by_solver(parts, grounded.atoms, distinguished, timeout_ms)


def _check_names(goals: Sequence[Formula], profile: str | Profile, objects: Mapping[str, str]) -> None:
    found = (each for goal in goals for each in check(goal, profile, objects))
    unknown = {each.message: each for each in found if each.code == "unknown-object" and each.severity == "error"}
    if unknown:
        raise BDDLError(unknown.values())


def _by_solver(
    parts: Sequence[GroundNode],
    atoms: tuple[Atom, ...],
    distinguished: Callable[[Callable[[Atom], bool]], Equivalence | None],
    timeout_ms: int,
) -> Equivalence:
    answer = _where_one_holds(parts, len(atoms), timeout_ms)
    if answer.status == "unsat":
        return Equivalence(True)
    if answer.status == "unknown":
        return Equivalence(None, reason=answer.reason)
    true = frozenset(atom for index, atom in enumerate(atoms) if _variable(index) in answer.true)
    found = distinguished(true.__contains__)
    if found is None:
        raise RuntimeError("the solver's state does not tell the goals apart")
    return found


def _where_one_holds(parts: Sequence[GroundNode], atom_count: int, timeout_ms: int) -> SolverAnswer:
    """Ask the solver for values of the atoms with which exactly one of two parts holds."""
    script = Script()
    script.declare(*map(_variable, range(atom_count)))
    script.require(f"(xor {' '.join(script.term(part, _variable) for part in parts)})")
    return Solver(script.text(), timeout_ms=timeout_ms).check()


def _variable(index: int) -> str:
    return f"a{index}"


def _are_alike(first: Formula, second: Formula) -> bool:
    """Decide whether two goals are the same formula, or conjunctions of the same literals."""
    ours, theirs = literals(first), literals(second)
    return first == second or (ours is not None and theirs is not None and frozenset(ours) == frozenset(theirs))


# Goals of more atoms get no guesses with one atom each.
_MOST_GUESSES = 200


def _guesses(atoms: tuple[Atom, ...]) -> Iterator[Callable[[Atom], bool]]:
    """Yield the states in which no atom is true, one is, all are, or all but one."""
    yield lambda atom: False
    few = atoms if len(atoms) <= _MOST_GUESSES else ()
    for one in few:
        yield one.__eq__
    yield lambda atom: True
    for one in few:
        yield one.__ne__
