"""Certificates with one thing changed, and what such a certificate claims, judged by the oracle."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import jsonschema
from hypothesis import strategies as st

import oag
from tests.bruteforce import Fact, Kinds, Literal, Part, World, completions, run

REPLACEMENTS: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    2,
    7,
    -1,
    1.0,
    "",
    "*",
    "cup_0",
    "table_0",
    "open",
    "holding cup_0",
    "gripping fridge_0",
    "PROVED",
    "CONDITIONAL",
    "REFUTED",
    "task-goal",
    [],
    {},
    [1],
    [["open", "fridge_0"], True],
    ["open", "fridge_0"],
)
# With more unknown facts than this a claim has too many start states to try.
MOST_UNKNOWN = 9
SCHEMA = json.loads((Path(oag.__file__).parent / "certificate.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
_LENGTHS = {"ontop": 3, "inside": 3, "open": 2}


def paths(value: Any, prefix: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The place of every value inside JSON data."""
    found = [prefix] if prefix else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in items:
        found += paths(part, (*prefix, key))
    return found


def single_changes(original: dict[str, Any], replacements: tuple[Any, ...] = REPLACEMENTS) -> Iterator[dict[str, Any]]:
    """Every certificate in which one value is deleted, doubled, swapped with the next of its list, or replaced."""
    for path in paths(original):
        for change in ("delete", "double", "swap", *((value,) for value in replacements)):
            data = json.loads(json.dumps(original))
            at: Any = data
            for key in path[:-1]:
                at = at[key]
            if isinstance(change, tuple):
                at[path[-1]] = change[0]
            elif change == "delete":
                del at[path[-1]]
            elif not isinstance(at, list):
                continue
            elif change == "double":
                at.insert(path[-1], at[path[-1]])
            else:
                other = (path[-1] + 1) % len(at)
                at[path[-1]], at[other] = at[other], at[path[-1]]
            yield data


@st.composite
def forgeries(draw: st.DrawFn, original: dict[str, Any]) -> dict[str, Any]:
    """A certificate with one value replaced, deleted, doubled, or swapped with another of its list."""
    data: dict[str, Any] = copy.deepcopy(original)
    # Every field is as likely as every other, however much it holds.
    field = draw(st.sampled_from(sorted(data)))
    path = draw(st.sampled_from(paths({field: data[field]})))
    at: Any = data
    for key in path[:-1]:
        at = at[key]
    change = draw(st.sampled_from(("replace", "delete", "double", "swap", "borrow")))
    if change == "delete":
        del at[path[-1]]
    elif change == "double" and isinstance(at, list):
        at.insert(draw(st.integers(0, len(at))), copy.deepcopy(at[path[-1]]))
    elif change == "swap" and isinstance(at, list):
        other = draw(st.integers(0, len(at) - 1))
        at[path[-1]], at[other] = at[other], at[path[-1]]
    elif change == "borrow":
        source: Any = original
        for key in draw(st.sampled_from(paths(original))):
            source = source[key]
        at[path[-1]] = copy.deepcopy(source)
    else:
        at[path[-1]] = draw(st.sampled_from(REPLACEMENTS))
    return data


def rehashed(data: dict[str, Any]) -> dict[str, Any]:
    """The data with its hashes made right, as somebody would who wants it to pass."""
    for key, part in (("task_hash", "plan"), ("scene_sha", "scene")):
        text = json.dumps(data.get(part), sort_keys=True, separators=(",", ":"))
        data[key] = hashlib.sha256(text.encode()).hexdigest()
    return data


def same(left: Any, right: Any) -> bool:
    """Equality of JSON texts, in which 1 and true differ."""
    return json.dumps(left, sort_keys=True) == json.dumps(right, sort_keys=True)


def claim_holds(data: dict[str, Any], facts: Iterable[Fact]) -> bool | None:
    """Whether what a certificate says of its own plan and scene is so, from every start that meets its assumptions.

    Args:
        data: A certificate whose conditions are literals.
        facts: Facts to take for unknown where the scene does not say.

    Returns:
        None when there are too many start states to try, when an atom is not one that the oracle knows, and when the
        data does not have the documented form, so that it says nothing.
    """
    if not VALIDATOR.is_valid(data):
        return None
    scene, plan = data["scene"], data["plan"]
    parts = tuple(_part(subtask) for subtask in plan["subtasks"])
    goal = _literals(plan["goal"])
    stated = {tuple(fact): value for fact, value in scene["start"]}
    mentioned = {fact for part in parts for fact, _ in (*part.init, *part.goal)} | {fact for fact, _ in goal}
    universe = sorted({fact for fact in mentioned | set(facts) if len(fact) > 1 and fact[2:] != ("gripper",)})
    universe += [fact for fact in stated if len(fact) > 1 and "*" not in fact and fact not in universe]
    known = {fact: value for fact in universe if (value := _stated(fact, stated)) is not None}
    unknown = tuple(fact for fact in universe if fact not in known)
    if len(unknown) > MOST_UNKNOWN or not all(len(fact) == _LENGTHS.get(fact[0], len(fact)) for fact in universe):
        return None
    hand = stated.get(("hand",), "empty")
    kinds = Kinds(frozenset(scene["items"]), frozenset(scene["articulated"]))
    starts = (
        replace(start, hand=None if hand == "empty" else hand.partition(" ")[2])
        for start in completions(known, unknown, parts[0].target if parts else None)
        if all(_assumed(start, entry) for entry in data["assumptions"])
    )
    stop = None if data["failure"] is None else tuple(data["failure"])
    return all(run(start, parts, goal, kinds) == stop for start in starts)


def _assumed(start: World, entry: dict[str, Any]) -> bool:
    return entry["kind"] == "reset" or (tuple(entry["fact"]) in start.true) is entry["value"]


def _stated(fact: Fact, stated: dict[Fact, bool]) -> bool | None:
    """What a scene says of a fact: the fact itself, or that nothing of a kind is so, the more special first."""
    name, *arguments = fact
    patterns = sorted(product(*((argument, "*") for argument in arguments)), key=lambda p: (p.count("*"), p[0] == "*"))
    return next((stated[(name, *pattern)] for pattern in patterns if (name, *pattern) in stated), None)


def _part(subtask: dict[str, Any]) -> Part:
    flow = tuple(int(next(iter(item)) if isinstance(item, dict) else item) for item in subtask["flow"] or ())
    init, goal = _literals(subtask["init"]), _literals(subtask["goal"])
    return Part(subtask["target"], subtask["support_goal"], init, goal, flow)


def _literals(condition: list[Any]) -> tuple[Literal, ...]:
    return tuple((tuple(names), value) for names, value in condition)
