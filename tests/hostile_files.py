"""Scene and task files with something wrong in them: drawn by a seed, so that each one can be had again by its number.

A mutant is a pair of texts, since some mistakes are of the text and not of the data (a key twice, half a file). What is
mutated are the paper's tasks with their scenes, and the scenes that come with the package.
"""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.hostile_values import FLOWS, FORMULAS, strange_number, strange_text, strange_value

DATA = Path(__file__).parent / "data"
PACKAGED = Path(__file__).parents[1] / "executor" / "scenes" / "data"
PAIRS = tuple((DATA / f"T{n}.json", DATA / f"T{n}_scene.json") for n in range(1, 5)) + tuple(
    (DATA / f"T{n}.json", PACKAGED / f"kitchen_t{n}.json") for n in range(1, 5)
)
_ROLES = ("target", "support_init", "support_goal")


@dataclass(frozen=True)
class Mutant:
    """A task file and a scene file; `label` says what was done to which of them, with the number that draws it."""

    label: str
    task: str
    scene: str


def _paths(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of every value below the root."""
    members = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in members:
        yield (*path, key)
        yield from _paths(value, (*path, key))


def _at(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


def _put(data: Any, path: tuple[Any, ...], value: Any) -> str:
    _at(data, path[:-1])[path[-1]] = value
    return ".".join(map(str, path))


def _place(rng: random.Random, data: Any, fits: Callable[[tuple[Any, ...], Any], bool] = lambda *_: True) -> Any:
    """Return one place that fits; None when there is none."""
    places = [path for path in _paths(data) if fits(path, _at(data, path))]
    return rng.choice(places) if places else None


# Each of these changes the data in place, and returns what it did; None when there is nothing of its kind to change.
def _drop(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data)
    del _at(data, path[:-1])[path[-1]]
    return f"dropped {path}"


def _retype(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data)
    return f"another value at {_put(data, path, strange_value(rng))}"


def _reword(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda _, value: isinstance(value, str))
    return path and f"another text at {_put(data, path, strange_text(rng))}"


def _renumber(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda _, value: isinstance(value, int | float))
    return path and f"another number at {_put(data, path, strange_number(rng))}"


def _rename(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda path, _: isinstance(path[-1], str))
    parent, key = _at(data, path[:-1]), path[-1]
    name = rng.choice((strange_text(rng), key + "s", key[:-1], key.upper(), f"{key} ", "parameters", "scale"))
    items = [(name if old == key else old, value) for old, value in parent.items()]
    parent.clear()
    parent.update(items)
    return f"renamed {path} to {name!r:.20}"


def _repeat(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda path, _: isinstance(path[-1], int))
    if path is None:
        return None
    rows = _at(data, path[:-1])
    rows.extend(copy.deepcopy(rows[path[-1]]) for _ in range(rng.choice((1, 2, 40))))
    return f"repeated {path}"


def _shuffle(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda _, value: isinstance(value, list) and len(value) > 1)
    if path is None:
        return None
    rng.shuffle(_at(data, path))
    return f"shuffled {path}"


def _swap(rng: random.Random, data: Any) -> str | None:
    one, other = _place(rng, data), _place(rng, data)
    if one[: len(other)] == other or other[: len(one)] == one:
        return None
    first, second = copy.deepcopy(_at(data, one)), copy.deepcopy(_at(data, other))
    _put(data, one, second)
    _put(data, other, first)
    return f"swapped {one} and {other}"


def _swap_roles(rng: random.Random, data: Any) -> str | None:
    if not data.get("sub_tasks"):
        return None
    subtask = rng.choice(data["sub_tasks"])
    one, other = rng.sample(_ROLES, 2)
    subtask[one], subtask[other] = subtask.get(other), subtask.get(one)
    return f"swapped {one} and {other}"


def _reform(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda path, value: isinstance(value, str) and value.startswith("("))
    return path and f"another formula at {_put(data, path, rng.choice(FORMULAS))}"


def _reflow(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda path, _: path[-1] == "flow")
    return path and f"another flow at {_put(data, path, copy.deepcopy(rng.choice(FLOWS)))}"


def _break_formula(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda path, value: isinstance(value, str) and value.startswith("("))
    if path is None:
        return None
    text = _at(data, path)
    place = rng.randrange(len(text))
    piece = rng.choice(("", "(", ")", " ", "?", "\n", "()", "'", "\u00e9", text))
    return f"broken formula at {_put(data, path, text[:place] + piece + text[place + rng.randrange(3) :])}"


def _add(rng: random.Random, data: Any) -> str | None:
    path = _place(rng, data, lambda _, value: isinstance(value, dict))
    into = data if path is None else _at(data, path)
    into[strange_text(rng)] = strange_value(rng)
    return f"added to {path}"


def _double_key(rng: random.Random, text: str) -> str:
    places = [place for place in range(len(text)) if text[place] == "{" and text[place + 1 : place + 2] != "}"]
    place = rng.choice(places) + 1
    return text[:place] + '"target": "glass_0", "name": 1, "target": [], "name": "x", ' + text[place:]


def _cut(rng: random.Random, text: str) -> str:
    return text[: rng.randrange(len(text))]


def _damage(rng: random.Random, text: str) -> str:
    place = rng.randrange(len(text))
    return text[:place] + rng.choice(("\x00", "[", "{", '"', ",", "NaN", "\u2028", "\\ud800", "//")) + text[place + 1 :]


def _bury(rng: random.Random, text: str) -> str:
    depth = rng.choice((50, 900, 5000, 100_000))
    return rng.choice(("[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth, '{"sub_tasks":' + "[" * depth))


_EDITS = (
    _drop,
    _retype,
    _retype,
    _reword,
    _reword,
    _renumber,
    _renumber,
    _rename,
    _repeat,
    _shuffle,
    _swap,
    _swap_roles,
    _reform,
    _reform,
    _reflow,
    _reflow,
    _break_formula,
    _add,
)
_TEXT_EDITS = (_double_key, _cut, _damage, _bury)


def mutant(number: int) -> Mutant:
    """Return the mutant of a number; an equal number gives an equal one."""
    rng = random.Random(number)
    task_path, scene_path = rng.choice(PAIRS)
    texts = [task_path.read_text(encoding="utf-8"), scene_path.read_text(encoding="utf-8")]
    said = [f"mutant {number} of {task_path.stem} in {scene_path.stem}"]
    if rng.random() < 0.06:
        which = rng.randrange(2)
        edit = rng.choice(_TEXT_EDITS)
        texts[which] = edit(rng, texts[which])
        return Mutant(f"{said[0]}: {edit.__name__} in the {('task', 'scene')[which]}", *texts)
    data = [json.loads(text) for text in texts]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        which = int(rng.random() < 0.4)
        # An earlier change may have left nothing to change.
        done = rng.choice(_EDITS)(rng, data[which]) if data[which] else None
        said.append(f"{('task', 'scene')[which]}: {done}")
    return Mutant("; ".join(said), *(json.dumps(part, ensure_ascii=rng.random() < 0.9) for part in data))


def mutants(count: int, first: int = 0) -> Iterator[Mutant]:
    """Yield so many mutants, from a number on."""
    return map(mutant, range(first, first + count))
