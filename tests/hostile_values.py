"""Values that do not belong into scene and task files: texts that are no names, numbers that are no lengths."""

from __future__ import annotations

import math
import random
from typing import Any

_LONG = "x" * 5000


def strange_text(rng: random.Random) -> str:
    """Return a text that is no name, or another one than the file needs."""
    name = rng.choice(("glass_0", "table_0", "refrigerator_0", "apple_0", "open", "scene"))
    return rng.choice(
        (
            "",
            " ",
            "\n",
            "\t\r\n",
            f"{name} ",
            f" {name}",
            f"{name}\n",
            name.replace("_", " "),
            name.replace("_", "\n"),
            f"({name})",
            f"{name})",
            f";{name}",
            f"?{name}",
            f"-{name}",
            "*",
            "-",
            "?",
            "?x",
            "and",
            "not",
            "forall",
            "gripper",
            "robot",
            "floor",
            "null",
            "None",
            "near",
            "eef",
            "hand",
            name.upper(),
            "glas\u0301s_0",
            "\u2126_0",
            "杯子_0",
            "\U0001f34e",
            "\ud800",
            "\u202eglass_0",
            "\u00a0",
            "\u200b",
            "\ufeffglass_0",
            "\x00",
            "\x1b[31mglass_0",
            "__class__",
            "../../etc/passwd",
            "a/b",
            "%s%n{0}",
            _LONG,
            "0",
            "1e308",
        )
    )


def strange_number(rng: random.Random) -> Any:
    """Return a number at the edge of what numbers are, or a truth value."""
    return rng.choice(
        (
            0,
            -1,
            -0.0,
            1e308,
            -1e308,
            1.7976931348623157e308,
            5e-324,
            1e-300,
            1e200,
            1e15,
            -1e15,
            1e6,
            10**30,
            10**400,
            math.nan,
            math.inf,
            -math.inf,
            True,
            False,
        )
    )


def strange_value(rng: random.Random) -> Any:
    """Return a value of any type."""
    return rng.choice(
        (
            strange_text(rng),
            strange_number(rng),
            None,
            [],
            {},
            [None],
            [[]],
            {"": None},
            {"x": {"y": {}}},
            [0] * 3,
            [1e308] * 3,
            [1e308] * 4,
            [5e-324] * 3,
            [math.nan] * 3,
            ["1", "2", "3"],
            "(and)",
            _nested_list(rng.choice((3, 60, 900))),
        )
    )


def _nested_list(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


FORMULAS = (
    "",
    "(",
    ")",
    "()",
    "(and)",
    "(or)",
    "(not)",
    "(and (and) (or))",
    "(not (and))",
    "(open)",
    "(open glass_0)",
    "(open refrigerator_0 refrigerator_0)",
    "(inside glass_0 glass_0)",
    "(inside gripper gripper)",
    "(inside glass_0 gripper gripper)",
    "(inside gripper glass_0)",
    "(inside robot gripper)",
    "(ontop glass_0 floor)",
    "(inroom glass_0 kitchen)",
    "(covered glass_0 dust)",
    "(near glass_0)",
    "(hand glass_0)",
    "(eef home)",
    "(and (inside glass_0 gripper) (inside apple_0 gripper))",
    "(and (ontop glass_0 table_0) (not (ontop glass_0 table_0)))",
    "(and (ontop glass_0 table_0) (ontop table_0 glass_0))",
    "(or (open refrigerator_0) (not (open refrigerator_0)))",
    "(imply (open refrigerator_0) (inside glass_0 refrigerator_0))",
    "(forall (?x - object) (open ?x))",
    "(forall (?x - nothing) (open ?x))",
    "(exists (?x - water_glass) (inside ?x refrigerator_0))",
    "(exists (?x - object) (ontop ?x ?x))",
    "(exists (?x - object) (exists (?y - object) (inside ?x ?y)))",
    "(exists (?x - object) (exists (?x - object) (open ?x)))",
    "(forn (0) (?x - object) (open ?x))",
    "(forn (99999999999999999999) (?x - object) (open ?x))",
    "(forn (-1) (?x - object) (open ?x))",
    "(forpairs (?x - object) (?y - object) (nextto ?x ?y))",
    "(fornpairs (2) (?x - object) (?y - object) (nextto ?x ?y))",
    "(forall (?a - object) (forall (?b - object) (forall (?c - object) (forall (?d - object) (nextto ?a ?d)))))",
    " ".join(f"(exists (?x{n} - object)" for n in range(30)) + " (open ?x0)" + ")" * 30,
    "(forall (glass_0 - object) (open glass_0))",
    "(open ?x)",
    "(frozen glass_0)",
    "(unicorn glass_0)",
    "(ontop glass_0 unicorn_0)",
    "(open 'refrigerator_0')",
    "(open refrigerator_0) (open refrigerator_0)",
    "open refrigerator_0",
    "inside(glass_0, refrigerator_0)",
    "(:goal (open refrigerator_0))",
    "(define (problem p) (:domain d))",
    "; (open refrigerator_0)",
    "(and\n(open refrigerator_0)\n)",
    "(and " + "(open refrigerator_0) " * 300 + ")",
    "(not " * 50 + "(open refrigerator_0)" + ")" * 50,
    "(not " * 5000 + "(open refrigerator_0)" + ")" * 5000,
    "(" * 20000,
    "(open \u2126)",
    "(open \x00)",
    "(open \ud800)",
    "(open *)",
    "(ontop * table_0)",
    "(= glass_0 glass_0)",
    "(not glass_0)",
)
FLOWS: tuple[Any, ...] = (
    [],
    [17],
    [5],
    [3, 3, 3],
    [18],
    [1, 2, 3, 4, 5] * 100,
    [0],
    [22],
    [-1],
    [99],
    ["GRASP"],
    ["3"],
    [" 3 "],
    ["\u0663"],
    [""],
    [None],
    [True],
    [3.0],
    [[3]],
    [{}],
    [{"7": 0.2, "8": 0.1}],
    [{"7": None}],
    [{"7": []}],
    [{"7": [0.1]}],
    [{"7": [0.1, 0.2]}],
    [{"7": "0.2"}],
    [{"7": 1e308}],
    [{"7": -5}],
    [{"7": math.nan}],
    [{"7": math.inf}],
    [{"7": True}],
    [{"7": 10**400}],
    [{"3": 0.1}],
    [{"4": [0.0, 1e308]}],
    [{"4": [0, 0]}],
    [{"20": 1e308}],
    [{"": 1}],
    [{"x": 1}],
    [{"7": {"7": 0.2}}],
    "17 1 2 3",
    {"17": None},
)
