"""How long reading takes beside the reference: best of several rounds, the two taking turns."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import bddl
from bddl.dialects import PROFILES
from benchmarks.conformance.context import Context, Measure, Result

ROUNDS = 5
QUICK_ROUNDS = 1
MOST_TIMES_PARSE = 4
MOST_PARSE_S = 2.5
MOST_TIMES_CHECK = 1.0
MOST_COLD_S = 0.2
# The first import and the first text, in a process of its own.
_COLD = """
import sys, time
text = sys.stdin.read()
begin = time.perf_counter()
import bddl
bddl.parse(text, profile="behavior")
print(time.perf_counter() - begin)
"""


def check_speed(context: Context) -> Result:
    """Times parsing and checking of the whole corpus, and the first text of a process."""
    texts = list(context.corpus.values())
    rounds = QUICK_ROUNDS if context.quick else ROUNDS
    bare = replace(PROFILES["behavior"], rules=frozenset())
    steps: dict[str, Callable[[], float]] = {
        "reference: tokens": lambda: _theirs(context, "tokens", texts),
        "reference: parse": lambda: _theirs(context, "parse", texts),
        "reference: parse, compile, verify": lambda: _theirs(context, "check", texts),
        "parse": lambda: _ours(texts, bare),
        "parse and check": lambda: _ours(texts, PROFILES["behavior"]),
        "cold": lambda: _cold(context.legal["adding_chemicals_to_hot_tub"]),
    }
    best = dict.fromkeys(steps, float("inf"))
    for _ in range(rounds):
        for name, step in steps.items():
            best[name] = min(best[name], step())
    parse, check, cold = best["parse"], best["parse and check"], best["cold"]
    tokens, full = best["reference: tokens"], best["reference: parse, compile, verify"]
    theirs = best["reference: parse"]
    return Result(
        (
            Measure(
                f"parse {len(texts)} files to trees with places",
                f"{parse:.3f} s, with all checks {check:.3f} s, {check / theirs:.1f} x",
                f"tokens {tokens:.3f} s, parse {theirs:.3f} s, no places, no checks",
                f"with all checks {MOST_TIMES_PARSE} x, {MOST_PARSE_S} s",
                check / theirs <= MOST_TIMES_PARSE and parse <= MOST_PARSE_S,
            ),
            Measure(
                "parse and full strict check",
                f"{check:.3f} s, {check / full:.2f} x",
                f"parse, compile, verify {full:.3f} s",
                f"{MOST_TIMES_CHECK} x",
                check / full <= MOST_TIMES_CHECK,
            ),
            Measure("import and first file, cold", f"{cold:.3f} s", goal=f"{MOST_COLD_S} s", holds=cold <= MOST_COLD_S),
        ),
        {"rounds": rounds, "best_s": best},
    )


def _theirs(context: Context, what: str, texts: Sequence[str]) -> float:
    seconds = context.peer.ask("time", what=what, texts=texts)
    if not isinstance(seconds, float):
        raise TypeError(f"the reference answered {seconds!r}")
    return seconds


def _ours(texts: Sequence[str], profile: bddl.Profile) -> float:
    begin = time.perf_counter()
    for text in texts:
        # The two illegal activities take their time as well.
        try:
            bddl.parse(text, profile=profile)
        except bddl.BDDLError:
            continue
    return time.perf_counter() - begin


def _cold(text: str) -> float:
    """Return how long a new process takes; modules are compiled already, as they are wherever one has run before."""
    with tempfile.TemporaryDirectory() as compiled:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": compiled}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        seconds = [
            float(
                subprocess.run(
                    [sys.executable, "-c", _COLD],
                    input=text,
                    env=environment,
                    capture_output=True,
                    text=True,
                    encoding="utf-8",
                    check=True,
                ).stdout
            )
            for _ in range(2)
        ]
    return seconds[-1]
