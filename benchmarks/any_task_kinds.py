"""How much of each hard kind of wish succeeds in homes drawn as for T7, and why the others do not.

python benchmarks/any_task_kinds.py --each 12 --seed 85000 --results kinds.jsonl

Only the proof decides which wishes count: geometry may find each of them impossible. In "blocked", what is in the way
is moved there: before a thing in a compartment, onto what a thing is to stand on, or before the door of what stands on
furniture.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, get_args

import numpy as np

import bddl
import llm
import oag
from executor.assets.footprint import region_frame, yaw_of
from executor.assets.library import asset_for
from executor.assets.model import Region
from executor.bench.any_task import pursue
from executor.campaign.planning_model import plan_offline
from executor.campaign.rate import Rate
from executor.planning.whereabouts import parts_named
from executor.scenes.changes import place_of, placed
from executor.scenes.generators import any_task
from executor.scenes.generators.any_task import AnyWish
from executor.scenes.pair import NotDrawn
from executor.scenes.placement import Clearance, PlaceSpec
from executor.scenes.room import NoRoom
from executor.scenes.validation import Unsettled, settle
from oag import Scene, Task
from oag.model.symbols import GRIPPER, Kind
from oag.model.where import WHICH, Part, Where
from oag.sizes import Sizing

HIGH_M = (0.85, 0.95)
VESSELS = ("bowl", "box", "plate")
SIDES = {"next to": "next to", "left of": "to the left of", "right of": "to the right of", "behind": "behind"}
MOST_HOMES = 200
MOST_CHANGES = 20  # Blockers that are tried in one home.
CLOSE_M, FRONT_M, CLEAR = 0.03, 0.04, Clearance(0.005, 0.02)


@dataclass(frozen=True, slots=True)
class Asked:
    """A wish of a kind: its sentence, what has to hold, and the part or spot that it names."""

    query: str
    scene: Scene
    meant: tuple[bddl.Atom, ...]
    where: Where | None = None


class Home:
    """What wishes are drawn from in a scene."""

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        self.scene, self.rng = scene, rng
        objects = scene.objects
        self.places = {key: at for key in objects if (at := place_of(scene, key)) is not None}
        self.items = [key for key, thing in objects.items() if thing.kind is Kind.ITEM and key in self.places]
        others = (key for key, thing in objects.items() if thing.kind is not Kind.ITEM)
        self.furniture = [key for key in others if asset_for(objects[key]).regions]

    def shuffled(self, keys: Sequence[Any]) -> list[Any]:
        """Return things in a drawn order."""
        return [keys[int(index)] for index in self.rng.permutation(len(keys))]

    def called(self, key: str) -> str:
        """Return a noun where only one thing has it; else the id."""
        category = self.scene[key].category
        alike = sum(thing.category == category for thing in self.scene.objects.values())
        return f"the {category.replace('_', ' ')}" if alike == 1 else key

    def tops_m(self, key: str) -> dict[str, float]:
        """Return the heights of an object's surfaces above the floor, by region."""
        regions = (region for region in asset_for(self.scene[key]).regions if region.kind == "surface")
        return {region.name: float(region_frame(self.scene[key], region)[0][2, 3]) for region in regions}


def high(home: Home) -> Iterator[Asked]:
    """Yield wishes about surfaces of 0.85 to 0.95 m: something is taken from one, or put on one."""
    for item, place in home.shuffled([(a, b) for a in home.items for b in home.furniture]):
        host, relation = home.places[item]
        tops_m = home.tops_m(place)
        if host == place or not tops_m:
            continue
        foot_m = home.scene[item].position[2] - home.scene[item].extent_m[2] / 2
        from_high = relation == "ontop" and home.scene[host].kind is not Kind.ITEM and _is_high(foot_m)
        if from_high or (len(tops_m) == 1 and _is_high(*tops_m.values())):
            yield _put(home, item, "ontop", place)


def _is_high(*heights_m: float) -> bool:
    return all(HIGH_M[0] <= height_m <= HIGH_M[1] for height_m in heights_m)


def contents(home: Home) -> Iterator[Asked]:
    """Yield wishes for a second thing in a bowl or a box, or on a plate: both are put there, or one is there."""
    vessels = [key for key in home.items if home.scene[key].category in VESSELS and asset_for(home.scene[key]).regions]
    for vessel in home.shuffled(vessels):
        kinds = {region.kind for region in asset_for(home.scene[vessel]).regions}
        relation = "inside" if "interior" in kinds else "ontop"
        if home.scene[vessel].category == "box" and relation == "ontop":
            continue  # A carton is for stacking.
        has_some = any(at[0] == vessel for at in home.places.values())
        rest = home.shuffled([key for key in home.items if key != vessel and home.places[key][0] != vessel])
        rest = [key for key in rest if home.places[vessel][0] != key]
        for one, other in zip(rest[::2], rest[1::2], strict=False):
            names = (one,) if has_some else (one, other)
            spoken = " and ".join(map(home.called, names))
            word = "into" if relation == "inside" else "onto"
            meant = tuple(bddl.Atom(relation, (key, vessel)) for key in names)
            yield Asked(f"put {spoken} {word} {home.called(vessel)}", home.scene, meant)


def named_part(home: Home) -> Iterator[Asked]:
    """Yield wishes that name a drawer, a door or a shelf which the furniture has."""
    found = list[tuple[str, Where]]()
    for key in home.furniture:
        named = [Where(which=which, part=part) for which in WHICH for part in get_args(Part)]
        found += [(key, where) for where in named if len(parts_named(asset_for(home.scene[key]), where)) == 1]
    for key, where in home.shuffled(found):
        part, place = f"the {where} of {home.called(key)}", home.scene[key]
        item = home.shuffled(home.items)[0] if home.items else None
        if where.part == "door" or (where.part == "drawer" and home.rng.uniform() < 0.3):
            yield Asked(f"open {part}", home.scene, (bddl.Atom("open", (key,)),), where)
        elif item is not None and home.places[item][0] != key:
            relation = "ontop" if where.part == "shelf" and place.kind is not Kind.ARTICULATED else "inside"
            word = "on" if where.part == "shelf" else "in"
            yield Asked(
                f"put {home.called(item)} {word} {part}", home.scene, (bddl.Atom(relation, (item, key)),), where
            )


def next_to(home: Home) -> Iterator[Asked]:
    """Yield wishes for a thing at a side of another one."""
    for item, other in home.shuffled([(a, c) for a in home.items for c in home.items if a != c]):
        host, relation = home.places[other]
        if home.scene[host].kind is Kind.ITEM or host == item:
            continue
        side = str(home.rng.choice(list(SIDES)))
        query = f"put {home.called(item)} {SIDES[side]} {home.called(other)}"
        yield Asked(query, home.scene, (bddl.Atom(relation, (item, host)),), Where(side, other))


def stack(home: Home) -> Iterator[Asked]:
    """Yield wishes to stack a thing on another one with a top, or to take it off."""
    for item, other in home.shuffled([(a, c) for a in home.items for c in home.items if a != c]):
        if home.places[item] == (other, "ontop"):
            yield Asked(
                f"take {home.called(item)} off {home.called(other)}",
                home.scene,
                (bddl.Atom("inside", (item, GRIPPER)),),
            )
        elif home.places[other][0] != item and home.tops_m(other):
            yield replace(_put(home, item, "ontop", other), query=f"stack {home.called(item)} on {home.called(other)}")


def blocked(home: Home) -> Iterator[Asked]:
    """Yield wishes in which something else has to be moved aside first; it is put there."""
    sorts = [_before, _upon, _before_door]
    for _ in range(MOST_CHANGES):
        sort = sorts[int(home.rng.integers(len(sorts)))]
        if len(home.items) < 3:
            return
        item, blocker, third = home.shuffled(home.items)[:3]
        try:
            asked = sort(home, item, blocker, third)
            if asked is not None:
                yield replace(asked, scene=settle(asked.scene))
        except (NoRoom, Unsettled):
            continue


def _before(home: Home, item: str, blocker: str, _: str) -> Asked | None:
    """Put a thing at the front of a compartment or of a shelf's board, and another one close behind it."""
    places = [
        (key, region)
        for key in home.furniture
        for region in asset_for(home.scene[key]).regions
        if not region.opens_upward
    ]
    if not places:
        return None
    host, region = home.shuffled(places)[0]
    sizes_m = [max(home.scene[key].extent_m[:2]) for key in (item, blocker)]
    depth = region.opening[:2]
    before_m = FRONT_M + sizes_m[1] / 2 - region.half_extents_m[int(np.argmax(np.abs(depth)))]
    behind_m = before_m + sum(sizes_m) / 2 + CLOSE_M
    across_m = 0.5 * home.rng.uniform(-1.0, 1.0) * region.half_extents_m[int(np.argmin(np.abs(depth)))]
    scene, relation = home.scene, "inside" if region.kind == "interior" else "ontop"
    for key, along_m in ((item, -behind_m), (blocker, -before_m)):
        at = (depth[0] * along_m + depth[1] * across_m, depth[1] * along_m + depth[0] * across_m)
        scene = placed(scene, key, relation, PlaceSpec(host, region.name, at, clear=CLEAR))
    place = home.shuffled([key for key in home.furniture if key != host and home.tops_m(key)])[:1]
    return _put(Home(scene, home.rng), item, "ontop", place[0]) if place else None


def _upon(home: Home, item: str, blocker: str, third: str) -> Asked | None:
    """Put a thing in the middle of what another one is to be stacked on."""
    tops = [region for region in asset_for(home.scene[third]).regions if region.kind == "surface"]
    if not tops or home.places[third][0] in (item, blocker):
        return None
    scene = placed(home.scene, blocker, "ontop", PlaceSpec(third, tops[0].name, (0.0, 0.0), clear=Clearance(0.0, 0.02)))
    return _put(Home(scene, home.rng), item, "ontop", third)


def _before_door(home: Home, item: str, blocker: str, _: str) -> Asked | None:
    """Put a thing before the door of what stands on furniture, such as a microwave on a counter."""
    doors = [key for key in home.furniture if home.scene[key].kind is Kind.ARTICULATED and key in home.places]
    if not doors:
        return None
    door = home.shuffled(doors)[0]
    host, body = home.places[door][0], home.scene[door]
    yaw = yaw_of(body)
    ahead_m = body.extent_m[0] / 2 + max(home.scene[blocker].extent_m[:2]) / 2 + CLOSE_M
    aside_m = home.rng.uniform(-0.4, 0.4) * body.extent_m[1]
    point = np.array([*body.position[:2], 0.0, 1.0])
    point[0] += -ahead_m * math.cos(yaw) - aside_m * math.sin(yaw)
    point[1] += -ahead_m * math.sin(yaw) + aside_m * math.cos(yaw)
    region = _under(home, host, body.position[2] - body.extent_m[2] / 2)
    if region is None:
        return None
    local = np.linalg.inv(region_frame(home.scene[host], region)[0]) @ point
    at = (float(local[0]), float(local[1]))
    scene = placed(home.scene, blocker, "ontop", PlaceSpec(host, region.name, at, clear=CLEAR))
    return _put(Home(scene, home.rng), item, "inside", door)


def _under(home: Home, host: str, foot_m: float) -> Region | None:
    tops_m = home.tops_m(host)
    near = [name for name, height_m in tops_m.items() if abs(height_m - foot_m) < 0.02]
    return next((region for region in asset_for(home.scene[host]).regions if region.name in near), None)


def _put(home: Home, item: str, relation: str, place: str) -> Asked:
    word = "into" if relation == "inside" else "onto"
    query = f"put {home.called(item)} {word} {home.called(place)}"
    return Asked(query, home.scene, (bddl.Atom(relation, (item, place)),))


KINDS: dict[str, Callable[[Home], Iterator[Asked]]] = {
    "high": high,
    "contents": contents,
    "named-part": named_part,
    "next-to": next_to,
    "stack": stack,
    "blocked": blocked,
}


def unproved(asked: Asked) -> str:
    """Return why a wish has no proved plan for what it means; empty where it has one."""
    try:
        task = plan_offline(asked.query, asked.scene, Sizing(keep=True))
    except llm.QueryError as refusal:
        return f"{refusal.code}: {refusal.problem}"
    whole = bddl.And((task.goal, *asked.meant))
    if not bddl.equivalent(task.goal, whole, asked.scene.categories) or not _names(task, asked.where):
        return f"misread: {bddl.format(task.goal)}"
    return "" if oag.compose(task, scene=asked.scene).verify() else "unproved: verify does not prove it"


def _names(task: Task, where: Where | None) -> bool:
    return where is None or any(subtask.where == where for subtask in task.subtasks)


def drawn(first_seed: int, each: int, kinds: Sequence[str]) -> Iterator[tuple[int, str, Asked, str]]:
    """Yield wishes with their seeds and kinds, one of a kind and home, until each kind has so many with a proved plan.

    Those without come too, with the reason.
    """
    proved = Counter[str]()
    for seed in range(first_seed, first_seed + MOST_HOMES):
        lacking = [kind for kind in kinds if proved[kind] < each]
        if not lacking:
            return
        try:
            scene = any_task.draw(seed).scene
        except NotDrawn:
            continue
        for kind in lacking:
            rng = np.random.default_rng([seed, list(KINDS).index(kind)])
            asked = next(KINDS[kind](Home(scene, rng)), None)
            if asked is not None:
                reason = unproved(asked)
                proved[kind] += not reason
                yield seed, kind, asked, reason


def show(results: Sequence[dict[str, Any]], kinds: Sequence[str], each: int) -> None:
    """Print a table by kind and by number of subtasks, and the reasons of what was refused or failed.

    Args:
        results: What became of each drawn wish.
        kinds: The kinds that were drawn.
        each: How many wishes of each kind with a proved plan were asked for.
    """
    for kind in kinds:
        own = [result for result in results if result["kind"] == kind]
        proved = [result for result in own if result["ended"] != "not-proved"]
        lacking = f" ({each - len(proved)} fewer than asked for)" if len(proved) < each else ""
        print(f"{kind}: {len(own)} drawn, {len(proved)} proved{lacking}{_outcome(proved)}")
        unmet = [result for result in _run(proved) if result["ended"] != "succeeded"]
        for title, group in (("not proved", [result for result in own if result not in proved]), ("unmet", unmet)):
            codes = Counter(str(result["failure"]["kind"]) for result in group)
            if codes:
                print(f"  {title}: {', '.join(f'{count} {code}' for code, count in codes.most_common())}")
    ran = _run(results)
    for count in sorted({len(result["subtask_names"]) for result in ran}):
        print(f"of {count} subtasks: {_done([r for r in ran if len(r['subtask_names']) == count])}")


def _run(results: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the results of wishes whose plans were gone through, not only proved."""
    return [result for result in results if "stage" in result]


def _outcome(proved: Sequence[dict[str, Any]]) -> str:
    ran = _run(proved)
    if not ran:
        return ""
    moved, cpu_s = sum(result["stage"] == "physics" for result in ran), [result["cpu_s"] for result in ran]
    return f", {moved} feasible, succeeded {_done(ran)}; CPU median {median(cpu_s):.1f} s, most {max(cpu_s):.1f} s"


def _done(results: Sequence[dict[str, Any]]) -> Rate:
    return Rate(sum(result["ended"] == "succeeded" for result in results), len(results))


def main() -> None:
    """Draw the wishes, run them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=12, help="wishes of each kind with a proved plan")
    parser.add_argument("--seed", type=int, default=85000, help="of the first home")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--results", type=Path, help="file to which each result is appended as a line of JSON")
    parser.add_argument("--no-run", action="store_true", help="prove only")
    options = parser.parse_args()
    results = list[dict[str, Any]]()
    for seed, kind, asked, reason in drawn(options.seed, options.each, options.kinds):
        known: dict[str, Any] = {"seed": seed, "kind": kind, "query": asked.query}
        if reason:
            code, _, message = reason.partition(": ")
            result: dict[str, Any] = {**known, "ended": "not-proved", "failure": {"kind": code, "message": message}}
        elif options.no_run:
            result = {**known, "ended": "proved"}
        else:
            meant = tuple(bddl.Literal(atom, True) for atom in asked.meant)
            result = {**known, **pursue(AnyWish(seed, kind, asked.query, asked.scene, meant))}
        results.append(result)
        why = (result.get("failure") or {}).get("message", "")
        print(f"{seed} {kind:10} {asked.query:60} {result['ended']} {result.get('cpu_s', '')} {why[:150]}", flush=True)
        if options.results:
            with options.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result, default=str) + "\n")
    show(results, options.kinds, options.each)


if __name__ == "__main__":
    main()
