"""SMT-LIB text of ground formulas, and the solver z3, which is imported on the first question.

Each part of a formula gets one name, so the text is as long as the formula is large. The caller names the atoms (such
as `a0`), since an atom may have several values along a plan.

z3 reads the text faster than Python builds the same terms one by one: an exact decision took 1.7 times as long.

Source: SMT-LIB 2.6 for the form, with z3's `at-most` and `at-least` for cardinalities.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal, TypeAlias

from bddl.errors import SolverMissing
from bddl.grounding import All, AtLeast, Exactly, GroundNode, Leaf, Matching, Negation, Some, children, operands_first

TRUE = "true"
FALSE = "false"
# A part that is used once is written where it is used, up to this length; z3 reads nested text by recursion.
_LONGEST_INLINE = 160


class Script:
    """SMT-LIB text under construction.

    Whatever it adds for a part of a formula only gives that part a name: every valuation of the atoms extends to
    exactly one value of the name. So a term may be asserted, negated and counted alike.
    """

    def __init__(self, prefix: str = "") -> None:
        """Start with nothing.

        Args:
            prefix: What the names that it makes begin with; a number follows. Texts that are read into one session
                need different ones.
        """
        self._lines: list[str] = []
        self._prefix = prefix
        self._named = 0

    def text(self) -> str:
        return "\n".join(self._lines)

    def declare(self, *names: str) -> None:
        self._lines.extend(f"(declare-const {name} Bool)" for name in names)

    def require(self, term: str) -> None:
        self._lines.append(f"(assert {term})")

    def name(self, term: str) -> str:
        """Return a fresh constant that is true exactly when a term is; it can be assumed in a question."""
        name = self._fresh("n")
        self.require(f"(= {name} {term})")
        return name

    def term(self, root: GroundNode, atom: Callable[[int], str]) -> str:
        """Return the term of a node, after adding the names that it needs.

        Args:
            atom: The term of each atom by its index; `true` and `false` are folded away as far as they reach.
        """
        nodes = list(operands_first(root))
        uses = Counter(id(child) for node in nodes for child in children(node))
        terms: dict[int, str] = {}
        for node in nodes:
            term = self._compose(node, terms, atom)
            if len(term) > _LONGEST_INLINE or (uses[id(node)] > 1 and "(" in term):
                term = self.define(term)
            terms[id(node)] = term
        return terms[id(root)]

    def _compose(self, node: GroundNode, terms: dict[int, str], atom: Callable[[int], str]) -> str:
        match node:
            case Leaf(atom=index):
                return atom(index)
            case Negation(body=body):
                return negation(terms[id(body)])
            case All(parts=parts):
                return conjunction(terms[id(part)] for part in parts)
            case Some(parts=parts):
                return disjunction(terms[id(part)] for part in parts)
            case Exactly(count=count, parts=parts):
                counted = [terms[id(part)] for part in parts]
                return conjunction((_at_least(count, counted), _at_most(count, counted)))
            case Matching(count=count, cells=cells):
                return self._matching(
                    count,
                    {
                        (row, column): terms[id(cell)]
                        for row, line in enumerate(cells)
                        for column, cell in enumerate(line)
                        if cell is not None
                    },
                )
            case AtLeast(count=count, parts=parts):
                return _at_least(count, [terms[id(part)] for part in parts])

    def _matching(self, count: int, cells: dict[tuple[int, int], str]) -> str:
        """Return a constant that is true exactly when `count` cells of different rows and columns are.

        True has a witness, the chosen cells; so has false, by König's theorem: fewer than `count` rows and columns
        that cover every true cell. The constant chooses between the two, and only one of them can exist.
        """
        cells = {place: term for place, term in cells.items() if term != FALSE}
        lines = sorted({row for row, _ in cells}), sorted({column for _, column in cells})
        if count <= 0:
            return TRUE
        if count > min(map(len, lines)):
            return FALSE
        found = self._fresh("m")
        chosen = {place: self._fresh("c") for place in cells}
        covered = [{line: self._fresh("l") for line in side} for side in lines]
        for (row, column), term in cells.items():
            self.require(disjunction((negation(found), negation(chosen[row, column]), term)))
            self.require(disjunction((found, negation(term), covered[0][row], covered[1][column])))
        for side, numbers in enumerate(lines):
            for line in numbers:
                self.require(_at_most(1, [name for place, name in chosen.items() if place[side] == line]))
        self.require(disjunction((negation(found), _at_least(count, list(chosen.values())))))
        self.require(disjunction((found, _at_most(count - 1, [*covered[0].values(), *covered[1].values()]))))
        return found

    def define(self, term: str) -> str:
        """Return a short name that stands for a term, and cannot be assumed in a question."""
        name = self._new("d")
        self._lines.append(f"(define-fun {name} () Bool {term})")
        return name

    def _fresh(self, letter: str) -> str:
        name = self._new(letter)
        self.declare(name)
        return name

    def _new(self, letter: str) -> str:
        self._named += 1
        return f"{self._prefix}{letter}{self._named}"


def negation(term: str) -> str:
    """Return the negation of a term."""
    if term in (TRUE, FALSE):
        return FALSE if term == TRUE else TRUE
    return f"(not {term})"


def conjunction(terms: Iterable[str]) -> str:
    """Return the conjunction of terms, true without any."""
    return _junction("and", terms, TRUE, FALSE)


def disjunction(terms: Iterable[str]) -> str:
    """Return the disjunction of terms, false without any."""
    return _junction("or", terms, FALSE, TRUE)


def _junction(word: str, terms: Iterable[str], neutral: str, absorbing: str) -> str:
    kept = dict.fromkeys(term for term in terms if term != neutral)
    if absorbing in kept:
        return absorbing
    if len(kept) < 2:
        return next(iter(kept), neutral)
    return f"({word} {' '.join(kept)})"


def _at_least(count: int, terms: list[str]) -> str:
    open_terms, left = _uncounted(count, terms)
    if left <= 0 or left > len(open_terms):
        return TRUE if left <= 0 else FALSE
    return f"((_ at-least {left}) {' '.join(open_terms)})"


def _at_most(count: int, terms: list[str]) -> str:
    open_terms, left = _uncounted(count, terms)
    if left < 0 or left >= len(open_terms):
        return FALSE if left < 0 else TRUE
    return f"((_ at-most {left}) {' '.join(open_terms)})"


def _uncounted(count: int, terms: list[str]) -> tuple[list[str], int]:
    return [term for term in terms if term not in (TRUE, FALSE)], count - terms.count(TRUE)


DEFAULT_TIMEOUT_MS = 10_000
# Every run explores in the same order, so that a formula has one answer and one model.
_SEED = 0

Status: TypeAlias = Literal["sat", "unsat", "unknown"]
# A declared constant and the value that it is given for one question.
Assumed: TypeAlias = tuple[str, bool]


@dataclass(frozen=True, slots=True)
class SolverAnswer:
    """Answer of the solver.

    Attributes:
        status: "sat", "unsat", or "unknown" when the time was up.
        true: For "sat", the constants that are true in one model; all others may be false.
        core: For "unsat", assumed values that contradict already; not necessarily the fewest.
        reason: For "unknown", why.
    """

    status: Status
    true: frozenset[str] = frozenset()
    core: tuple[Assumed, ...] = ()
    reason: str = ""


class Solver:
    """A solver session: a text that is read once, and many questions about it.

    Example:
        >>> from bddl.smt import Solver
        >>> session = Solver("(declare-const a Bool) (declare-const b Bool) (assert (or a b))")
        >>> session.check([("a", False)]).true
        frozenset({'b'})
        >>> session.check([("a", False), ("b", False)]).status
        'unsat'
    """

    def __init__(self, text: str, *, timeout_ms: int = DEFAULT_TIMEOUT_MS) -> None:
        """Read the text.

        Args:
            text: Declarations and assertions of SMT-LIB; commands such as `check-sat` are ignored.
            timeout_ms: The most time that one question may take; the answer is "unknown" after that.
        """
        self._z3: Any = _z3()
        # A context of its own makes an answer independent of earlier questions in the same process.
        self._context = self._z3.Context()
        # This solver for finite domains, unlike the general one, copes with cardinalities nested thousands deep.
        self._solver = self._z3.SolverFor("QF_FD", ctx=self._context)
        self._solver.set("timeout", timeout_ms)
        self._solver.set("random_seed", _SEED)
        self._literals: dict[Assumed, Any] = {}
        self.add(text)

    def add(self, text: str) -> None:
        """Read more text, which may speak of what was declared before and must not declare it again."""
        try:
            self._solver.from_string(text)
        except self._z3.Z3Exception as problem:
            detail = problem.args[0] if problem.args else problem
            plain = detail.decode(errors="replace") if isinstance(detail, bytes) else str(detail)
            raise ValueError(f"z3 cannot read the text: {plain.strip()}") from None

    def require(self, name: str, value: bool = True) -> None:
        """Fix the value of a constant for all later questions."""
        self._solver.add(self._literal(name, value))

    def check(self, assumed: Iterable[Assumed] = ()) -> SolverAnswer:
        """Decide whether the text is satisfiable when some constants have given values, for this question alone."""
        literals = {self._literal(name, value): (name, value) for name, value in assumed}
        status = str(self._solver.check(*literals))
        if status == "sat":
            model = self._solver.model()
            return SolverAnswer("sat", frozenset(d.name() for d in model.decls() if self._z3.is_true(model[d])))
        if status == "unsat":
            return SolverAnswer("unsat", core=tuple(literals[literal] for literal in self._solver.unsat_core()))
        return SolverAnswer("unknown", reason=str(self._solver.reason_unknown()))

    def _literal(self, name: str, value: bool) -> Any:
        """Return a constant or its negation, cached: making one takes longer than most questions."""
        known = self._literals.get((name, value))
        if known is None:
            constant = self._z3.Bool(name, self._context)
            known = self._literals[name, value] = constant if value else self._z3.Not(constant)
        return known


def solve(text: str, timeout_ms: int = DEFAULT_TIMEOUT_MS) -> SolverAnswer:
    """Decide whether SMT-LIB text over Boolean constants is satisfiable.

    Example:
        >>> from bddl.smt import solve
        >>> solve("(declare-const a Bool) (assert (and a (not a)))").status
        'unsat'
    """
    return Solver(text, timeout_ms=timeout_ms).check()


def _z3() -> ModuleType:
    """Return z3, which takes a while to load and is rarely needed."""
    try:
        import z3
    except ImportError as problem:
        raise SolverMissing(str(problem)) from None
    loaded: ModuleType = z3
    return loaded
