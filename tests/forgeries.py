"""Certificates with a few things changed, and what such a certificate claims, judged by the oracle."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import permutations, product
from pathlib import Path
from typing import Any

import jsonschema
from hypothesis import strategies as st

import oag
from tests.bruteforce import Fact, Kinds, Literal, Part, completions, decided, following, read_action

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
MOST_STARTS = 20_000
SCHEMA = json.loads((Path(oag.__file__).parent / "certificate" / "certificate.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
_RESTING = ("ontop", "inside")
_LENGTHS = {"ontop": 3, "inside": 3, "open": 2, "hot": 2}


def paths(value: Any, prefix: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The place of every value inside JSON data."""
    found = [prefix] if prefix else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in items:
        found += paths(part, (*prefix, key))
    return found


def single_changes(original: dict[str, Any], replacements: tuple[Any, ...] = REPLACEMENTS) -> Iterator[dict[str, Any]]:
    """Every certificate in which one value is deleted, doubled, swapped with the next of its list, or replaced.

    And every one in which something is added to a mapping or a list, that of the certificate itself included.
    """
    for path in ((), *paths(original)):
        data = json.loads(json.dumps(original))
        if _add(data, path):
            yield data
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


def _add(data: Any, path: tuple[Any, ...]) -> bool:
    """Add an unknown field to the mapping at a place, or an item to the list there; False when there is neither."""
    at = data
    for key in path:
        at = at[key]
    if isinstance(at, dict):
        at["note"] = "added"
    elif isinstance(at, list):
        at.append(None)
    return isinstance(at, dict | list)


@st.composite
def forgeries(draw: st.DrawFn, original: dict[str, Any], most: int = 3) -> dict[str, Any]:
    """A certificate with one to `most` changes, each of any value or one that a forger would make; hashes are right."""
    data: dict[str, Any] = copy.deepcopy(original)
    for _ in range(draw(st.integers(1, most))):
        # What was changed before may leave nothing to change.
        with suppress(KeyError, IndexError, TypeError, AttributeError, ValueError):
            draw(st.sampled_from((_any_change, _any_change, *CUNNING)))(draw, data, original)
    return rehashed(data)


def _any_change(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    """Replace, deletes or doubles one value, swaps it with another of its list, or adds something beside it."""
    # Every field is as likely as every other, however much it holds.
    field = draw(st.sampled_from(sorted(data)))
    path = draw(st.sampled_from(paths({field: data[field]})))
    at: Any = data
    for key in path[:-1]:
        at = at[key]
    change = draw(st.sampled_from(("replace", "delete", "double", "swap", "borrow", "add")))
    if change == "add":
        _add(data, path[: draw(st.integers(0, len(path)))])
    elif change == "delete":
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
        # A copy, which later changes may alter: the replacements are everybody's.
        at[path[-1]] = copy.deepcopy(draw(st.sampled_from(REPLACEMENTS)))


def _turn(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    """Something assumed is turned into its opposite, or moved to another time."""
    entry = draw(st.sampled_from([entry for entry in data["assumptions"] if "time" in entry]))
    entry.pop("text", None)
    if draw(st.booleans()):
        entry["value"] = not entry["value"]
    else:
        entry["time"] = draw(st.sampled_from((0, 1, entry["time"] + 2, entry["time"] - 2)))


def _drop_assumption(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    del data["assumptions"][draw(st.integers(0, len(data["assumptions"]) - 1))]


def _drop_links(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    """The links of one place go, or all that come after one."""
    place = draw(st.sampled_from([link[:3] for link in data["links"]]))
    if draw(st.booleans()):
        data["links"] = [link for link in data["links"] if link[:3] != place]
    else:
        last = max(n for n, link in enumerate(data["links"]) if link[:3] == place)
        data["links"] = data["links"][: last + 1]


def _state(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    """The scene says something else of a fact."""
    start = data["scene"]["start"]
    known = [entry[0] for entry in start if "*" not in entry[0]]
    fact = draw(st.sampled_from((["hand"], *known, ["open", "fridge_0"], ["inside", "cup_0", "fridge_0"])))
    start[:] = [entry for entry in start if entry[0] != fact]
    value = draw(st.sampled_from((True, False, None) if fact != ["hand"] else ("holding cup_0", "empty", None)))
    if value is not None:
        start.append([fact, value])


def _change_flow(draw: st.DrawFn, data: dict[str, Any], original: dict[str, Any]) -> None:
    """A step of the plan goes, or another comes in."""
    flow = draw(st.sampled_from([subtask["flow"] for subtask in data["plan"]["subtasks"]]))
    index = draw(st.integers(0, len(flow)))
    flow[index : index + draw(st.integers(0, 1))] = draw(st.lists(st.sampled_from((1, 2, 3, 5, 6, 7, 17)), max_size=1))


CUNNING = (_turn, _drop_assumption, _drop_links, _state, _change_flow)


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
    """Whether what a certificate says of its own plan and scene is so, by trying every start state.

    The starts are those that agree with what the scene states and with the resets that are listed, whatever is assumed.
    The verdict has to be the one that they give, and the failure the first place that none of them gets past. What is
    assumed has to be unknown, be so in some start, let every such start go through, and not be so without any part.

    Args:
        data: A certificate whose conditions are literals.
        facts: Facts to take for unknown where the scene does not say.

    Returns:
        None when there are too many start states to try, when an atom is not one that the oracle knows, when a subtask
        is said to have no flow, and when the data does not have the documented form, so that it says nothing.
    """
    if not VALIDATOR.is_valid(data) or "no-flow" in (data["failure"] or ()) or _has_formulas(data["plan"]):
        return None
    scene, subtasks, failure = data["scene"], data["plan"]["subtasks"], data["failure"]
    assumed = [entry for entry in data["assumptions"] if entry["kind"] == "assumed"]
    if any("formula" in entry for entry in assumed) or (failure is None and any(s["flow"] is None for s in subtasks)):
        return False
    parts, goal = tuple(_part(subtask) for subtask in subtasks), _literals(data["plan"]["goal"])
    stated = {tuple(fact): value for fact, value in scene["start"]}
    mentioned = {fact for part in parts for fact, _ in (*part.init, *part.goal)} | {fact for fact, _ in goal}
    mentioned |= {tuple(entry["fact"]) for entry in assumed} | {fact for fact in stated if "*" not in fact}
    universe = sorted({fact for fact in mentioned | set(facts) if len(fact) > 1 and fact[2:] != ("gripper",)})
    known = {fact: value for fact in universe if (value := _stated(fact, stated)) is not None}
    # What follows from a carrier need not be said.
    implied = following(fact for fact, value in known.items() if value)
    known |= {fact: True for fact in implied if fact in known and fact not in stated}
    # Furniture is on or in a thing only where the scene says so; what asks for more is left open.
    items = set(scene["items"])
    heaped = {f for f in universe if f not in known and f[0] in _RESTING and f[1] not in items and items & {*f[2:]}}
    if data["verdict"] == "PROVED":
        known |= dict.fromkeys(heaped, False)
    unknown = tuple(fact for fact in universe if fact not in known)
    if len(unknown) > MOST_UNKNOWN or not all(len(fact) == _LENGTHS.get(fact[0], 0) for fact in universe):
        return None
    # Where it is open what carries what, an answer may be left open that there is.
    pairs = [(name, *pair) for name in _RESTING for pair in permutations(scene["items"], 2)]
    solid = {name for name in scene["items"] if name.split("_")[0] == "apple"}
    pairs = [pair for pair in pairs if pair[0] == "ontop" or pair[2] not in solid]
    carrying = any(known.get(pair) or _stated(pair, stated) is None for pair in pairs)
    carrying = carrying or any(part.place is not None and part.place[1] in scene["items"] for part in parts)
    loose = bool(heaped) or (carrying and any(fact[0] in _RESTING for fact in unknown))
    kinds = Kinds(frozenset(scene["items"]), frozenset(scene["articulated"]))
    robots = list(_robots(data, stated.get(("hand",))))
    starts = [replace(s, base=b, arm=a, hand=h) for s in completions(known, unknown, None) for b, a, h in robots]
    if len(starts) > MOST_STARTS:
        return None
    verdict, grades = decided(starts, parts, goal, kinds) if starts else ("", [])
    wrong: bool | None = False
    if loose and (data["verdict"] == "CONDITIONAL" or data["verdict"] == verdict == "REFUTED"):
        wrong = None
    if data["verdict"] != verdict or failure != (list(grades[-1][0]) if verdict == "REFUTED" else None):
        return wrong
    if verdict != "CONDITIONAL":
        # A refutation may mention what the plan itself forces before it fails.
        return (not assumed or verdict == "REFUTED") or wrong
    wanted = {(tuple(entry["fact"]), entry["value"]) for entry in assumed}

    def goes_through(given: set[tuple[Fact, bool]]) -> bool:
        meant = [start for start in starts if all((fact in start.true) is value for fact, value in given)]
        return bool(meant) and decided(meant, parts, goal, kinds)[0] == "PROVED"

    if not all(fact in unknown for fact, _ in wanted) or not goes_through(wanted):
        return wrong
    return not any(goes_through(wanted - {part}) for part in wanted) or wrong


def _has_formulas(said: dict[str, Any]) -> bool:
    conditions = (said["goal"], *(subtask[key] for subtask in said["subtasks"] for key in ("init", "goal")))
    return any(isinstance(condition, str) for condition in conditions)


def _robots(data: dict[str, Any], hand: str | None) -> Iterator[tuple[str | None, tuple[str, str], str | None]]:
    """Every base, arm and hand that agrees with the scene and with the resets that are listed."""
    listed = {entry["fact"][0]: entry["value"] for entry in data["assumptions"] if entry["kind"] == "reset"}
    objects, scene = list(data["scene"]["objects"]), data["scene"]
    bases = [listed["near"]] if "near" in listed else [None, *objects]
    arms = [("home", "")]
    if "eef" not in listed:
        arms += [("free", ""), *product(("before", "at"), objects)]
    held = listed.get("hand", hand)
    hands = [None, *scene["items"], *scene["articulated"]]
    if held is not None:
        hands = [None if held == "empty" else held.partition(" ")[2]]
    return product(bases, arms, hands)


def _stated(fact: Fact, stated: dict[Fact, bool]) -> bool | None:
    """What a scene says of a fact: the fact itself, or that nothing of a kind is so, the more special first."""
    name, *arguments = fact
    patterns = sorted(product(*((argument, "*") for argument in arguments)), key=lambda p: (p.count("*"), p[0] == "*"))
    return next((stated[(name, *pattern)] for pattern in patterns if (name, *pattern) in stated), None)


def _part(subtask: dict[str, Any]) -> Part:
    flow = tuple(read_action(item) for item in subtask["flow"] or ())
    init, goal = _literals(subtask["init"]), _literals(subtask["goal"])
    return Part(subtask["target"], subtask["support_goal"], init, goal, flow)


def _literals(condition: list[Any]) -> tuple[Literal, ...]:
    return tuple((tuple(names), value) for names, value in condition)
