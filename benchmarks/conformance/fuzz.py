"""Random texts: whatever they are, the outcome is a tree or a BDDLError; size and depth have no limits."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Iterator, Sequence

import bddl
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.cutting import listed

INPUTS = 100_000
QUICK_INPUTS = 1_000
PROFILES = ("behavior", "behavior-compat", "scene")
DEPTH = 10_000
OBJECTS = 200_000
_PIECES = listed(
    "( ) ( ) - ? ?x ?? x? and or not imply forall exists forn forpairs fornpairs define problem domain :domain :goal "
    ":init :objects :requirements :types :predicates :action omnigibson open ontop inroom future real kitchen "
    "apple.n.01 apple.n.01_1 apple.n.01_* ?apple.n.01 (2) (-1) (x) 12 ; \n \t \ufeff \x00 é İ ß \ud800 `` ```"
)


def check_fuzz(context: Context) -> Result:
    """Reads random texts in every profile, deep ones and long ones."""
    inputs = QUICK_INPUTS if context.quick else INPUTS
    outcomes: Counter[str] = Counter()
    escaped: list[str] = []
    slowest = 0.0
    texts = fuzzed(list(context.corpus.values()), random.Random(context.seed))
    for number in range(inputs):
        text = next(texts)
        begin = time.perf_counter()
        outcomes[_outcome(text, PROFILES[number % len(PROFILES)], escaped)] += 1
        slowest = max(slowest, time.perf_counter() - begin)
    deep, long = _deep(escaped), _long(escaped)
    return Result(
        (
            Measure(
                f"exceptions of another type in {inputs} random inputs",
                str(len(escaped)),
                goal="0",
                holds=not escaped,
            ),
            Measure("slowest input", f"{slowest:.2f} s", goal="1 s", holds=slowest < 1),
            Measure(f"formula {DEPTH} deep", f"{deep:.2f} s", "RecursionError from about 500 on"),
            Measure(f"{OBJECTS} objects", f"{long:.2f} s"),
        ),
        {"inputs": inputs, "outcomes": dict(outcomes), "escaped": escaped[:20]},
    )


def fuzzed(corpus: Sequence[str], rng: random.Random) -> Iterator[str]:
    """Yields texts without end: heaps of tokens, damaged activities, spliced activities, and noise."""
    while True:
        form = rng.randrange(4)
        if form == 0:
            yield rng.choice(("", " ")).join(rng.choices(_PIECES, k=rng.randrange(1, 40)))
        elif form == 1:
            yield _damaged(rng.choice(corpus), rng)
        elif form == 2:
            first, second = rng.choice(corpus), rng.choice(corpus)
            yield first[: rng.randrange(len(first))] + second[rng.randrange(len(second)) :]
        else:
            yield "".join(
                chr(rng.choice((rng.randrange(128), rng.randrange(0x3000)))) for _ in range(rng.randrange(60))
            )


def _damaged(text: str, rng: random.Random) -> str:
    """Returns a text with a few words put in, taken out or doubled."""
    for _ in range(rng.randrange(1, 6)):
        start = rng.randrange(len(text) + 1)
        end = min(len(text), start + rng.randrange(12))
        text = text[:start] + rng.choice((rng.choice(_PIECES), "", text[start:end] * 2)) + text[end:]
    return text


def _outcome(text: str, profile: str, escaped: list[str]) -> str:
    try:
        bddl.parse(text, profile=profile)
    except bddl.BDDLError as error:
        str(error)
        return error.diagnostics[0].code
    except Exception as error:
        escaped.append(f"{profile}: {type(error).__name__}: {error}: {text[:200]!r}")
        return type(error).__name__
    return "accepted"


def _deep(escaped: list[str]) -> float:
    """Returns how long a deep goal takes to be read, printed and read again."""
    goal = "(not " * DEPTH + "(open ?door.n.01_1)" + ")" * DEPTH
    text = (
        "(define (problem deep-0) (:domain omnigibson) (:objects door.n.01_1 - door.n.01) "
        f"(:init (open door.n.01_1)) (:goal {goal}))"
    )
    begin = time.perf_counter()
    try:
        problem = bddl.parse(text, profile="behavior")
        if bddl.parse(bddl.format(problem), profile="behavior") != problem:
            escaped.append("a deep goal does not survive printing")
    except Exception as error:
        escaped.append(f"deep: {type(error).__name__}: {error}")
    return time.perf_counter() - begin


def _long(escaped: list[str]) -> float:
    """Returns how long many objects take to be read."""
    names = " ".join(f"door.n.01_{number}" for number in range(OBJECTS))
    text = (
        f"(define (problem long-0) (:domain omnigibson) (:objects {names} - door.n.01) (:init (open door.n.01_7)) "
        "(:goal (forall (?door.n.01 - door.n.01) (open ?door.n.01))))"
    )
    begin = time.perf_counter()
    try:
        if len(bddl.parse(text, profile="behavior").objects) != OBJECTS:
            escaped.append("objects are lost")
    except Exception as error:
        escaped.append(f"long: {type(error).__name__}: {error}")
    return time.perf_counter() - begin
