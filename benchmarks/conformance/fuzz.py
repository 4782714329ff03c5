"""Random texts: whatever they are, every function that takes a text gives a value or a BDDLError; size and depth have
no limits.
"""

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
PROFILES = ("behavior", "behavior-compat", "scene", "libero")
# What analyses, corrects and lays out a text is slower than reading it, and is asked about every so many inputs.
EVERY = 10
DEPTH = 10_000
OBJECTS = 200_000
_PIECES = listed(
    "( ) ( ) - ? ?x ?? x? and or not imply forall exists forn forpairs fornpairs define problem domain :domain :goal "
    ":init :objects :requirements :types :predicates :action omnigibson open ontop inroom future real kitchen "
    "apple.n.01 apple.n.01_1 apple.n.01_* ?apple.n.01 (2) (-1) (x) 12 ; \n \t \ufeff \x00 é İ ß \ud800 `` ``` "
    "robosuite (:language :regions :fixtures :obj_of_interest :scene_properties :target :ranges :yaw_rotation :rgba "
    ":floor pi -pi/2 1e309 nan (:regions (On (And"
)
# A file in LIBERO's format, so that its sections are damaged too where no folder with such files is at hand.
LIBERO_TEXT = """\
(define (problem LIBERO_Tabletop_Manipulation)
  (:domain robosuite)
  (:language Put the bowl (the black one) on the plate; then stop)
    (:regions
      (plate_region
          (:target main_table)
          (:ranges (
              (0.04 -0.03 0.06 -0.01)
            )
          )
          (:yaw_rotation (
              (-pi/2 3.14)
            )
          )
          (:rgba (0 0 1 0.5))
      )
      (top_region
          (:target wooden_cabinet_1)
      )
    )

  (:fixtures
    main_table - table
    wooden_cabinet_1 - wooden_cabinet
  )

  (:objects
    bowl_1 bowl_2 - akita_black_bowl
    plate_1 - plate
  )

  (:obj_of_interest
    bowl_1
    wooden_cabinet_1_top_region
  )

  (:scene_properties
    (kitchen (:floor wood) (:wall white))
  )

  (:init
    (On bowl_1 main_table_plate_region)
    (Open wooden_cabinet_1_top_region)
  )

  (:goal
    (And (On bowl_1 plate_1) (Close wooden_cabinet_1_top_region))
  )
)
"""


def check_fuzz(context: Context) -> Result:
    """Read, checks, analyses, corrects and lays out random texts in every profile, and reads deep and long ones."""
    inputs = QUICK_INPUTS if context.quick else INPUTS
    outcomes: Counter[str] = Counter()
    escaped: list[str] = []
    slowest = 0.0
    texts = fuzzed([*context.corpus.values(), *libero_texts(context)], random.Random(context.seed))
    for number in range(inputs):
        text = next(texts)
        begin = time.perf_counter()
        profile = PROFILES[number % len(PROFILES)]
        outcomes[_outcome(text, profile, escaped)] += 1
        slowest = max(slowest, time.perf_counter() - begin)
        if number // len(PROFILES) % EVERY == 0:
            _try_everything(text, profile, escaped)
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
    """Yield texts without end: heaps of tokens, damaged activities, spliced activities, and noise."""
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
    """Return a text with a few words put in, taken out or doubled."""
    for _ in range(rng.randrange(1, 6)):
        start = rng.randrange(len(text) + 1)
        end = min(len(text), start + rng.randrange(12))
        text = text[:start] + rng.choice((rng.choice(_PIECES), "", text[start:end] * 2)) + text[end:]
    return text


def libero_texts(context: Context) -> list[str]:
    """Return LIBERO's files when there is a folder with them, else one text in their format, each a hundred times.

    A hundred, since BEHAVIOR's activities are many more.
    """
    if context.libero is None:
        return [LIBERO_TEXT] * 100
    return [path.read_text(encoding="utf-8") for path in sorted(context.libero.rglob("*.bddl"))]


def use_everything(text: str, profile: str) -> None:
    """Give a text to every function that takes one; none may raise anything but BDDLError.

    Raises:
        RuntimeError: What was read is not what is read of its print.
    """
    for finding in bddl.analyse(text, profile=profile):
        str(finding), finding.to_json()
    bddl.correct(text, profile=profile)
    try:
        problem = bddl.parse(text, profile=profile)
    except bddl.BDDLError:
        return
    if bddl.parse(bddl.format(problem), profile=profile) != problem:
        raise RuntimeError("what was read does not survive printing")
    laid_out = bddl.lay_out(text, bddl.PROFILES[profile].free_text)
    if bddl.parse(laid_out, profile=profile) != problem:
        raise RuntimeError("what was read does not survive being laid out")


def _try_everything(text: str, profile: str, escaped: list[str]) -> None:
    try:
        use_everything(text, profile)
    except Exception as error:
        escaped.append(f"{profile}: {type(error).__name__}: {error}: {text[:200]!r}")


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
    """Return how long a deep goal takes to be read, printed and read again."""
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
    """Return how long many objects take to be read."""
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
