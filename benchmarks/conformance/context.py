"""What every check gets and gives back."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from benchmarks.conformance.goal_peer import GoalPeer

REFERENCE = ("bddl==3.6.0", "numpy", "pandas")
ENVIRONMENT = Path(".venv-reference")
SCRIPT = Path(__file__).with_name("reference_texts.py")
# The two activities that are no legal BDDL: a second formula in the goal, and a stray backslash.
ILLEGAL: Mapping[str, tuple[str, int, int]] = {
    "loading_the_car": ("several-formulas", 31, 9),
    "wash_a_baseball_cap": ("bad-section", 22, 6),
}


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure.

    Attributes:
        name: What was measured.
        ours: This project's figure.
        reference: The reference's, or "" when there is none.
        goal: What it should be, or "" when nothing was promised.
        holds: Whether it is as it should be.
    """

    name: str
    ours: str
    reference: str = ""
    goal: str = ""
    holds: bool = True


@dataclass(frozen=True, slots=True)
class Result:
    """What a check found.

    Attributes:
        measures: The figures.
        details: Everything behind them, as JSON.
    """

    measures: tuple[Measure, ...]
    details: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Context:
    """What a check works with.

    Attributes:
        interpreter: The Python of the reference's environment.
        peer: The reference, which reads texts on request (`reference_texts`).
        corpus: The text of every activity.
        seed: Decides whatever is random.
        quick: Whether a small sample is enough.
        libero: A folder with LIBERO's files, and its parser when the whole package lies there; None to leave it out.
    """

    interpreter: Path
    peer: GoalPeer
    corpus: Mapping[str, str]
    seed: int
    quick: bool
    libero: Path | None = None

    @property
    def legal(self) -> dict[str, str]:
        """The activities that are legal BDDL."""
        return {name: text for name, text in self.corpus.items() if name not in ILLEGAL}


Check: TypeAlias = Callable[[Context], Result]


def reference_interpreter() -> Path:
    """Return the Python of the reference's environment, which is made when it is not there."""
    python = ENVIRONMENT / "bin" / "python"
    if not python.exists():
        print(f"[conformance] installing {' '.join(REFERENCE)} into {ENVIRONMENT}", file=sys.stderr)
        venv.create(ENVIRONMENT, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *REFERENCE], check=True)
    return python


def load_corpus(peer: GoalPeer) -> dict[str, str]:
    """Return the text of every activity of the reference's installation."""
    corpus = peer.ask("corpus")
    if not isinstance(corpus, dict) or len(corpus) < 1000:
        raise RuntimeError(f"the reference's installation has no corpus of activities: {json.dumps(corpus)[:80]}")
    return corpus
