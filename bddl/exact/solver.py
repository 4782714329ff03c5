"""The one door to z3: satisfiability of SMT-LIB text over Boolean constants, loaded when first asked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal, TypeAlias

from bddl.syntax.errors import SolverMissing

DEFAULT_TIMEOUT_MS = 10_000
# Every run explores in the same order, so that a formula has one answer and one model.
_SEED = 0

Status: TypeAlias = Literal["sat", "unsat", "unknown"]
# A declared constant and the value that it is given for one question.
Assumed: TypeAlias = tuple[str, bool]


@dataclass(frozen=True, slots=True)
class Answer:
    """What the solver found.

    Attributes:
        status: "sat", "unsat", or "unknown" when the time was up.
        true: For "sat", the constants that are true in one model; all others may be false.
        core: For "unsat", assumed values that clash already; not necessarily the fewest.
        reason: For "unknown", why.
    """

    status: Status
    true: frozenset[str] = frozenset()
    core: tuple[Assumed, ...] = ()
    reason: str = ""


class Session:
    """Some text, read once, and many questions about it.

    Example:
        >>> from bddl.exact.solver import Session
        >>> session = Session("(declare-const a Bool) (declare-const b Bool) (assert (or a b))")
        >>> session.check([("a", False)]).true
        frozenset({'b'})
        >>> session.check([("a", False), ("b", False)]).status
        'unsat'
    """

    def __init__(self, text: str, *, timeout_ms: int = DEFAULT_TIMEOUT_MS) -> None:
        """Reads the text.

        Args:
            text: Declarations and assertions of SMT-LIB; commands such as `check-sat` are ignored.
            timeout_ms: The most time that one question may take; the answer is "unknown" after that.

        Raises:
            SolverMissing: z3 is not installed.
            ValueError: The text is no SMT-LIB, or uses what was not declared.
        """
        self._z3: Any = _z3()
        # A context of its own makes an answer independent of what was asked before it in the same process.
        self._context = self._z3.Context()
        # This solver for finite domains, unlike the general one, copes with cardinalities nested thousands deep.
        self._solver = self._z3.SolverFor("QF_FD", ctx=self._context)
        self._solver.set("timeout", timeout_ms)
        self._solver.set("random_seed", _SEED)
        self._literals: dict[Assumed, Any] = {}
        self.add(text)

    def add(self, text: str) -> None:
        """Reads more text, which may speak of what was declared before and must not declare it again.

        Raises:
            ValueError: The text is no SMT-LIB, or uses what was not declared.
        """
        try:
            self._solver.from_string(text)
        except self._z3.Z3Exception as problem:
            said = problem.args[0] if problem.args else problem
            raise ValueError(f"z3 cannot read the text: {_plain(said)}") from None

    def require(self, name: str, value: bool = True) -> None:
        """Gives a constant a value for all questions from now on."""
        self._solver.add(self._literal(name, value))

    def check(self, assumed: Iterable[Assumed] = ()) -> Answer:
        """Decides whether the text is satisfiable when some constants have given values.

        Args:
            assumed: Constants and their values, for this question alone.
        """
        literals = {self._literal(name, value): (name, value) for name, value in assumed}
        status = str(self._solver.check(*literals))
        if status == "sat":
            model = self._solver.model()
            return Answer("sat", frozenset(d.name() for d in model.decls() if self._z3.is_true(model[d])))
        if status == "unsat":
            return Answer("unsat", core=tuple(literals[literal] for literal in self._solver.unsat_core()))
        return Answer("unknown", reason=str(self._solver.reason_unknown()))

    def _literal(self, name: str, value: bool) -> Any:
        """Returns a constant or its negation; making one takes longer than most questions, and each is asked often."""
        known = self._literals.get((name, value))
        if known is None:
            constant = self._z3.Bool(name, self._context)
            known = self._literals[name, value] = constant if value else self._z3.Not(constant)
        return known


def solve(text: str, timeout_ms: int = DEFAULT_TIMEOUT_MS) -> Answer:
    """Decides whether SMT-LIB text over Boolean constants is satisfiable.

    Args:
        text: Declarations and assertions.
        timeout_ms: The most time that it may take; the answer is "unknown" after that.

    Raises:
        SolverMissing: z3 is not installed.
        ValueError: The text is no SMT-LIB, or uses what was not declared.

    Example:
        >>> from bddl.exact.solver import solve
        >>> solve("(declare-const a Bool) (assert (and a (not a)))").status
        'unsat'
    """
    return Session(text, timeout_ms=timeout_ms).check()


def _z3() -> ModuleType:
    """Returns z3, which takes a while to load and which most plans and formulas never need."""
    try:
        import z3
    except ImportError as problem:
        raise SolverMissing(str(problem)) from None
    loaded: ModuleType = z3
    return loaded


def _plain(said: object) -> str:
    return said.decode(errors="replace").strip() if isinstance(said, bytes) else str(said).strip()
