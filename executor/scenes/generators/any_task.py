"""T7: any wish in any home, drawn without regard to what the planner, the reader or the robot can do.

Scenes are rooms of the households, kitchens of the long-horizon tasks, and rooms furnished freely from the library. A
layout is drawn again only if things overlap or do not hold in physics. No plan, no reading and no reach decides what is
drawn: things are too wide, places too low, full, too high or not there, and some wishes are no work for this robot at
all. Labels of the first hundred seeds are in `data/t7_labels.toml`. They were written by hand from the
scenes' facts and sizes, before anything was run.

The robot is of full size, and nothing is scaled.

    wish = any_task.draw(70000)
    wish.query, wish.kind, wish.scene, wish.meant
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

import bddl
from executor.assets.library import LIBRARY, asset_for
from executor.assets.parameters import AssetError
from executor.scenes.generators import household, long_horizon
from executor.scenes.pair import NotDrawn
from executor.scenes.placement import AtEdge, Clearance, PlaceSpec, place, stand_robot
from executor.scenes.room import NoRoom, Room, against, build_walls, stand, wall_length_m
from executor.scenes.validation import Unsettled, settle
from oag import Scene
from oag.model.robots import LIFTED
from oag.model.symbols import GRIPPER, Kind, has_boards

FAMILY = "T7"
MOST_LAYOUTS = 40
_HOMES = ("household", "kitchen", "free", "free")  # Half of the rooms are furnished freely.
_WALLS = ("east", "north", "west")
_ONE_DOOR = ("upright_one_door", "fridge_one_door", "cabinet_one_door", "microwave_side_hinge")
_HIGH_TOPS_M = (0.70, 0.95)
_NOT_FURNITURE = ("wall", "floor")


@dataclass(frozen=True, slots=True)
class AnyWish:
    """A wish in a scene.

    Attributes:
        kind: Kind of the wish, a key of the phrasings.
        scene: The scene, settled in physics, at its own sizes.
        meant: What has to hold in the end, as far as the language of goals can say it; empty where it cannot.
    """

    seed: int
    kind: str
    query: str
    scene: Scene
    meant: tuple[bddl.Literal, ...]


def draw(seed: int) -> AnyWish:
    """Draw the wish of a seed with its scene; equal seeds give equal wishes.

    Args:
        seed: Any integer from 0.

    Raises:
        NotDrawn: No layout holds, or none has what the kind of wish is about.
    """
    choice, weights, reasons = np.random.default_rng([seed, 7]), _data()["weights"], list[str]()
    shares = np.array(list(weights.values())) / sum(weights.values())
    wanted, home = str(choice.choice(list(weights), p=shares)), str(choice.choice(_HOMES))
    for attempt in range(MOST_LAYOUTS):
        rng = np.random.default_rng([seed, 7, attempt])
        try:
            return _wish(seed, wanted, _home(home, seed, attempt, rng), rng)
        except (NoRoom, Unsettled, AssetError, NotDrawn, _Lacking) as reason:
            reasons.append(str(reason))
    raise NotDrawn(f"{FAMILY}-{seed:06d}", reasons)


class _Lacking(ValueError):
    """A scene has nothing that a kind of wish is about."""


@cache
def _data() -> dict[str, Any]:
    return tomllib.loads((resources.files(__package__) / "data" / "any_task.toml").read_text(encoding="utf-8"))


def _home(home: str, seed: int, attempt: int, rng: np.random.Generator) -> Scene:
    own_seed = int(rng.integers(1_000_000))
    if home == "household":
        return household.pair(own_seed, int(rng.integers(household.COUNT)), keep_sizes=True, robot=LIFTED.name).scene
    if home == "kitchen":
        family = str(rng.choice(tuple(long_horizon.QUERIES)))
        return long_horizon.draw(family, own_seed, keep_sizes=True, robot=LIFTED.name).scene
    return settle(_furnished(f"t7_{seed:06d}_{attempt}", rng).scene().with_robot(LIFTED.name))


def _furnished(name: str, rng: np.random.Generator) -> Room:
    """Return a room with furniture along its walls and in the middle, and things on and in it."""
    kind_of_room = str(rng.choice(["kitchen", "living_room", "bedroom"]))
    depth_m, width_m = map(float, rng.uniform(3.4, 5.2, 2))
    room = Room(name, kind_of_room, rng, depth_m, width_m)
    models = _data()["models"]
    furniture = [m for m in (*models["articulated"], *models["support"]) if m not in ("wall", "microwave_side_hinge")]
    for _ in range(int(rng.integers(3, 8))):
        model = str(rng.choice(furniture))
        tall = {"z": round(float(rng.uniform(*_HIGH_TOPS_M)), 3)} if model == "counter_plain" else {}
        ajar = {"open_fraction": round(float(rng.uniform(0.3, 0.9)), 2)} if rng.uniform() < 0.2 else {}
        parameters = ajar if model in _ONE_DOOR else {}
        piece, wall = room.draw(model, extent_m=tall, parameters=parameters), str(rng.choice(_WALLS))
        span_m = max(wall_length_m(room, wall) / 2 - piece.extent_m[1] / 2, 0.0)
        for _ in range(6):
            try:
                if LIBRARY[model].category in ("coffee_table", "chair", "table") and rng.uniform() < 0.6:
                    x, y, yaw = rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2), rng.uniform(-math.pi, math.pi)
                    stand(room, piece, float(x), float(y), yaw_rad=float(yaw))
                else:
                    against(room, wall, piece, float(rng.uniform(-span_m, span_m)))
                break
            except NoRoom:
                continue
    hosts = list(room.objects)
    if not hosts:
        raise NoRoom(name, "no furniture fits")
    if rng.uniform() < 0.4:
        _somewhere(room, "microwave_side_hinge", hosts, rng, tops_only=True)
    for _ in range(int(rng.integers(4, 15))):
        vessels = [key for key, thing in room.objects.items() if thing.category in ("bowl", "box", "plate")]
        near = vessels if vessels and rng.uniform() < 0.2 else hosts
        _somewhere(room, str(rng.choice(models["item"])), near, rng, tops_only=rng.uniform() < 0.75)
    build_walls(room)
    stand_robot(room)
    return room


def _somewhere(room: Room, model: str, hosts: list[str], rng: np.random.Generator, *, tops_only: bool) -> None:
    """Put a thing at a place of one of the hosts; without a free place it is left out."""
    host = str(rng.choice(hosts))
    regions = () if room.objects[host].model in _data()["models"]["bare"] else asset_for(room.objects[host]).regions
    chosen = [r.name for r in regions if r.kind == "surface" or not tops_only] or [r.name for r in regions]
    if not chosen:
        return
    # People reach for the front of furniture, and most things are there.
    at = AtEdge("-x", (0.06, 0.25)) if room.objects[host].kind is not Kind.ITEM and rng.uniform() < 0.6 else None
    try:
        place(room, room.draw(model), PlaceSpec(host, str(rng.choice(chosen)), at=at, clear=Clearance(0.005, 0.02)))
    except NoRoom:
        return


def _wish(seed: int, wanted: str, scene: Scene, rng: np.random.Generator) -> AnyWish:
    """Draw the sentence of a kind, and what it is about, from what is in a scene."""
    items = [key for key, thing in scene.objects.items() if thing.kind is Kind.ITEM]
    furniture = [k for k, t in scene.objects.items() if t.kind is not Kind.ITEM and t.category not in _NOT_FURNITURE]
    doors = [key for key in furniture if scene.objects[key].kind is Kind.ARTICULATED]
    where = {a.args[0]: a for a in scene.facts if isinstance(a, bddl.Atom) and a.predicate in ("inside", "ontop")}
    # What is drawn may be what a person would hardly ask: into a bowl, a bed or a table.
    a = _one([k for k in items if k in where and (wanted != "take-out" or where[k].predicate == "inside")], rng)
    d = _one([key for key in items if key != a], rng) if wanted in ("second", "two", "swap") else ""
    hollow = [k for k in items if k not in (a, d) and any(r.kind == "interior" for r in asset_for(scene[k]).regions)]
    other = hollow if wanted in ("fill", "second") else [key for key in items if key not in (a, d)]
    c = _one(other, rng) if wanted in ("fill", "second", "stack", "next-to", "other-skill") else ""
    if wanted == "close":
        doors = [key for key in doors if bddl.Atom("open", (key,)) in scene.facts] or doors
    b = _one(doors if wanted in ("open", "close", "put-into", "named-part", "two") else furniture, rng)
    s = where[a].args[1]
    if wanted in ("tidy", "all"):
        s = _one(sorted({atom.args[1] for atom in where.values() if atom.args[1] in furniture}), rng)
    data = _data()
    phrasing = str(rng.choice(data["phrasings"][wanted]))
    words = {
        **{
            letter: _called(key, scene, where, rng) for letter, key in zip("abcds", (a, b, c, d, s), strict=True) if key
        },
        **{letter: str(rng.choice(data["absent"][letter])) for letter in "xy"},
        "n": _part(b, scene, rng),
    }
    # Who says "in the shelf" means its boards.
    wording = phrasing.replace("in the {b}", "on the {b}") if b and has_boards(scene[b].category) else phrasing
    return AnyWish(seed, wanted, phrasing.format(**words), scene, tuple(_meant(wanted, wording, a, b, c, d, s, where)))


def _part(key: str, scene: Scene, rng: np.random.Generator) -> str:
    """Draw a part that a person names, mostly one of a sort that the thing has."""
    parts: dict[str, list[str]] = _data()["parts"]
    regions = " ".join(region.name for region in asset_for(scene[key]).regions)
    own = [part for sort, names in parts.items() if sort in regions for part in names]
    return str(rng.choice(own if own and rng.uniform() < 0.8 else [part for names in parts.values() for part in names]))


def _one(keys: list[str], rng: np.random.Generator) -> str:
    if not keys:
        raise _Lacking("the scene has nothing for this kind of wish")
    return str(rng.choice(keys))


def _called(key: str, scene: Scene, where: dict[str, bddl.Atom], rng: np.random.Generator) -> str:
    """Return what a person calls an object: a noun, with its place where several have the noun."""
    nouns = _data()["nouns"].get(scene[key].category, [scene[key].category.replace("_", " ")])
    noun = str(nouns[0] if rng.uniform() < 0.6 else rng.choice(nouns))
    alike = [other for other, thing in scene.objects.items() if thing.category == scene[key].category]
    if len(alike) > 1 and key in where:
        host = scene.objects.get(where[key].args[1])
        if host is not None:
            spoken = _data()["nouns"].get(host.category, [host.category.replace("_", " ")])[0]
            return f"{noun} {'in' if where[key].predicate == 'inside' else 'on'} the {spoken}"
    return noun


def _meant(
    wanted: str, phrasing: str, a: str, b: str, c: str, d: str, s: str, where: dict[str, bddl.Atom]
) -> Iterator[bddl.Literal]:
    """Yield what a wish means, as far as goals can say it."""

    def holds(predicate: str, *names: str) -> bddl.Literal:
        return bddl.Literal(bddl.Atom(predicate, names), True)

    if wanted in ("open", "close"):
        yield bddl.Literal(bddl.Atom("open", (b,)), wanted == "open")
    elif wanted == "put-into":
        yield holds("inside", a, b)
    elif wanted == "put-onto" or (wanted == "move" and "put it on" in phrasing):
        yield holds("ontop", a, b)
    elif wanted == "take-out":
        yield holds("inside", a, GRIPPER)
    elif wanted == "stack":
        yield holds("ontop", a, c)
    elif wanted in ("fill", "second"):
        yield from (holds("inside", key, c) for key in (a, d) if key)
    elif wanted == "all":
        relation = "inside" if "in" in phrasing.split("{s}")[1].split() or "into" in phrasing else "ontop"
        yield from (holds(relation, key, b) for key, atom in where.items() if atom.args[1] == s)
    elif wanted == "two" and phrasing.startswith("put"):
        yield from (holds("inside", a, b), holds("ontop", d, s))
    elif wanted == "two" and phrasing.startswith("open"):
        yield from (holds("inside", a, b), bddl.Literal(bddl.Atom("open", (b,)), False))
