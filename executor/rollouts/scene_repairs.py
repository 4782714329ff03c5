"""The nearest valid scene: small changes of a scene in which a wish is proved and feasible, where it is not.

    judged = repaired(scene, lambda scene: llm.propose(query, scene).task, seed=0)
    judged.feasible, judged.fixes, judged.scene, judged.task

What the refusal, the verdict or the dry run says decides which changes are tried, the smallest first: another place for
a thing, a door opened or shut, what blocks removed. A change counts if the scene holds in physics, the plan is proved
in it, and all of the plan is feasible by geometry. Where one is not enough, the search goes on from the first that
gets further, and then from the next. Equal scenes, plans and seeds give equal repairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import Literal, get_args

import numpy as np

import bddl
from executor.assets.footprint import Footprint, open_fraction
from executor.assets.parameters import AssetError
from executor.records import SceneFix
from executor.rollouts.feasibility import MOST_REPAIRS, Feasibility, feasible
from executor.scenes.changes import elsewhere, has_one_way, place_of, supports_near, with_door, without
from executor.scenes.room import NoRoom
from executor.scenes.validation import Unsettled, settle
from executor.scenes.vary import resting_on
from llm import QueryError, RefusalCode
from oag import Report, Scene, Task, compose
from oag.model.scene import FLOOR
from oag.model.symbols import Kind
from oag.primitives.table import OPEN_FRACTION

MOST_FIXES = 3
MOST_TRIES = 10
"""How many changed scenes are gone through by geometry."""
MOST_EFFORT_S = 24.0
"""How much effort of planning these may take together; none is begun after it (`executor.system.effort`)."""
MOST_SCENES = 30
"""How many changed scenes are settled in physics, those without a proved plan among them."""

_NEAR_M = 1.0
_WALL = "wall"

Plan = Callable[[Scene], Task]
"""Plans the wish in a scene; raises QueryError where it cannot."""


@dataclass(frozen=True, slots=True)
class Judged:
    """What is known of a wish in a scene.

    Attributes:
        scene: The scene, with the changes.
        fixes: The changes.
        refusal: Why there is no plan, or None.
        report: What `verify` says of the plan; None without one.
        found: What the dry run says of a proved plan; None before it.
    """

    scene: Scene
    fixes: tuple[SceneFix, ...] = ()
    refusal: QueryError | None = None
    report: Report | None = None
    found: Feasibility | None = None

    @property
    def feasible(self) -> bool:
        """Whether the plan is proved and feasible."""
        return bool(self.found)

    @property
    def reason(self) -> str:
        """Code of the refusal, the verdict, or kind of the failure; empty where the plan is feasible."""
        if self.refusal is not None:
            return self.refusal.code
        if self.found is not None:
            return self.found.failure.kind.value if self.found.failure is not None else ""
        return "" if self.report is None else self.report.verdict.value.lower()

    @property
    def progress(self) -> tuple[int, int]:
        """How far it gets: reading, proof, geometry; and how far within that."""
        if self.refusal is not None:
            return 0, get_args(RefusalCode).index(self.refusal.code)
        if self.report is not None and not self.report:
            return 1, -len(self.report.missing)
        return 2, 0 if self.found is None else len(self.found.subtasks) - len(self.found.task.subtasks)

    def gets_further_than(self, other: Judged) -> bool:
        """Decide whether it gets further, or as far where another name is open."""
        if self.refusal is not None and other.refusal is not None and self.refusal.among != other.refusal.among:
            return self.progress >= other.progress
        return self.progress > other.progress


def repaired(scene: Scene, plan: Plan, seed: int) -> Judged:
    """Return a wish in the nearest scene in which it is feasible; in the given one where it is, or where none is found.

    Args:
        scene: A concrete scene: nothing is left to vary.
        plan: Plans the wish.
        seed: Seed of all planning by geometry.
    """
    first = _gone_through(_planned(scene, plan), seed, MOST_REPAIRS)
    return first if first.feasible else _Search(plan, seed).further_than(first) or first


@dataclass
class _Search:
    """Depth-first search for a feasible scene; what leads no further is given up for the next change.

    Attributes:
        plan, seed: As for `repaired`.
        tries_left, effort_left_s: How many changed scenes may still be gone through by geometry, with which effort.
        scenes_left: How many may still be settled.
    """

    plan: Plan
    seed: int
    tries_left: int = MOST_TRIES
    effort_left_s: float = MOST_EFFORT_S
    scenes_left: int = MOST_SCENES

    def further_than(self, at: Judged) -> Judged | None:
        """Return a feasible scene that is reached from one by further changes; None where none is found."""
        for changed in _changes(at) if len(at.fixes) < MOST_FIXES else ():
            candidate = _planned(changed.scene, self.plan, changed.fixes)
            if not candidate.report and not candidate.gets_further_than(at):
                continue
            if self.tries_left == 0 or self.scenes_left == 0 or self.effort_left_s <= 0.0:
                return None
            self.scenes_left -= 1
            try:
                candidate = _planned(settle(changed.scene), self.plan, changed.fixes)
            except (Unsettled, AssetError):
                continue
            self.tries_left -= bool(candidate.report)
            candidate = _gone_through(candidate, self.seed, 0)
            self.effort_left_s -= 0.0 if candidate.found is None else candidate.found.effort_s
            if candidate.feasible:
                return candidate
            if candidate.gets_further_than(at) and (found := self.further_than(candidate)) is not None:
                return found
        return None


def _planned(scene: Scene, plan: Plan, fixes: tuple[SceneFix, ...] = ()) -> Judged:
    try:
        task = plan(scene)
    except QueryError as refusal:
        return Judged(scene, fixes, refusal)
    return Judged(scene, fixes, report=compose(task, scene=scene).verify())


def _gone_through(planned: Judged, seed: int, most_repairs: int) -> Judged:
    """Return the plan with what the dry run says of it, where it is proved; repairs of plans take most of the time."""
    if not planned.report:
        return planned
    graph = compose(planned.report.task, scene=planned.scene)
    found = feasible(graph, planned.scene, seed, vary=False, most_repairs=most_repairs)
    return Judged(planned.scene, planned.fixes, report=planned.report, found=found)


def _changes(at: Judged) -> Iterator[Judged]:
    """Yield changed scenes that the reason suggests, the smallest change first; nothing of them is checked."""
    changes = _Changes(at)
    if at.refusal is not None:
        yield from changes.of_refusal(at.refusal)
    elif at.found is not None:
        yield from changes.of_geometry(at.found)
    elif at.report is not None:
        yield from changes.of_verdict(at.report)


class _Changes:
    """Changes of one scene for one reason."""

    def __init__(self, at: Judged) -> None:
        self._at, self._scene = at, at.scene
        kinds = {name: thing.kind for name, thing in at.scene.objects.items() if thing.category not in (_WALL, FLOOR)}
        self._items = [name for name, kind in kinds.items() if kind is Kind.ITEM]
        self._fixtures = [name for name, kind in kinds.items() if kind is not Kind.ITEM]

    def of_refusal(self, refusal: QueryError) -> Iterator[Judged]:
        """Yield scenes for a sentence that has no task: one bearer of a name is left, things are elsewhere."""
        if refusal.code == "ambiguous-object":
            rivals = [[other for other in refusal.among if other != kept] for kept in refusal.among]
            rivals.sort(key=lambda names: len(self._with_cargo(names)))
            for change in (self._removed, self._cleared):
                for others in rivals:
                    yield from change(others)
        elif refusal.code == "wrong-place":
            for item in refusal.among:
                if item in self._items:
                    yield from self._elsewhere(item, *self._other_supports(item))
        elif refusal.code == "already-so":
            yield from self._doors(self._fixtures)
            for item in self._items:
                yield from islice(self._elsewhere(item, *self._other_supports(item)), 3)

    def of_verdict(self, report: Report) -> Iterator[Judged]:
        """Yield scenes for a refuted plan: what it needs, and does not have, is so at the start."""
        failures = () if report.trace is None else report.trace.failures
        for predicate, first, *rest in (tuple(map(str, c.fact)) for failure in failures for c in failure.missing):
            if first not in self._scene.objects:
                continue
            if predicate == "open":
                yield from self._doors([first])
            elif predicate in ("ontop", "inside") and first in self._items:
                named = [(rest[0], predicate)] if rest and rest[0] in self._fixtures else []
                yield from self._elsewhere(first, *named, *islice(self._other_supports(first), 1))

    def of_geometry(self, found: Feasibility) -> Iterator[Judged]:
        """Yield scenes for an infeasible plan: by what is taken, what is in the way, and where it goes."""
        failed, subtasks = found.subtasks[-1].record, found.task.subtasks
        subtask = subtasks[min(failed.index, len(subtasks) - 1)]
        target, place = subtask.target, str(subtask.support_goal)
        roles = {str(name) for part in subtasks for name in (part.target, part.support_init, part.support_goal)}
        used = roles | {name for atom in bddl.atoms(found.task.goal) for name in atom.args}
        named = [body.partition("/")[0] for pair in found.in_the_way for body in pair.split()]
        blockers = [name for name in dict.fromkeys((*named, *failed.moved_m)) if name in self._scene.objects]
        items = [name for name in blockers if name in self._items and name not in used]
        movable = [name for name in (target, place) if name in self._items]
        here = {name: at for name in movable if (at := place_of(self._scene, name)) is not None}
        for name, at in here.items():
            yield from self._elsewhere(name, *[at] * 3)
        hosts = [support for support, _ in here.values()]
        around = [name for name in (place, *hosts, target) if name in self._fixtures]
        yield from self._doors(list(dict.fromkeys((*(b for b in blockers if b in self._fixtures), *around))))
        for name in items:
            yield from self._removed([name])
        contents = sorted(resting_on(self._scene, place) - used) if place in self._fixtures else []
        for names in (items if len(items) > 1 else [], contents if contents != items else []):
            yield from self._removed(names)
        for name in movable:
            yield from self._elsewhere(name, *islice(self._other_supports(name), 3))
        pieces = [name for name in blockers if name in self._fixtures and used.isdisjoint(self._with_cargo([name]))]
        for name in dict.fromkeys((*pieces, *islice(self._neighbours(around or [target], used), 2))):
            yield from self._removed([name])

    def _doors(self, names: list[str]) -> Iterator[Judged]:
        """Yield the scene with each door in its other state."""
        for name in names:
            thing = self._scene[name]
            if thing.kind is Kind.ARTICULATED and has_one_way(self._scene, name):
                opens = open_fraction(thing) <= OPEN_FRACTION
                try:
                    changed = with_door(self._scene, name, is_open=opens)
                except AssetError:
                    continue
                words = f"{name} is {'open' if opens else 'shut'} at the start"
                yield self._with(changed, "door", (name,), words)

    def _elsewhere(self, item: str, *places: tuple[str, str]) -> Iterator[Judged]:
        for number, (support, relation) in enumerate(places):
            try:
                changed = elsewhere(self._scene, item, support, relation, number)
            except NoRoom:
                continue
            x, y, z = changed[item].position
            words = f"{item} stands {'in' if relation == 'inside' else 'on'} {support} at ({x:.2f}, {y:.2f}, {z:.2f}) m"
            yield self._with(changed, "place", (item,), words)

    def _removed(self, names: list[str]) -> Iterator[Judged]:
        gone = self._with_cargo(names)
        if gone:
            yield self._with(without(self._scene, names), "removed", gone, f"without {', '.join(gone)}")

    def _cleared(self, names: list[str]) -> Iterator[Judged]:
        """Yield the scene without some furniture; what stood on it is on other furniture, and not on one like it."""
        scene, moved = self._scene, list[str]()
        alike = {self._scene[name].category for name in names}
        hosts = {name for name in self._fixtures if scene[name].category not in alike and not place_of(scene, name)}
        for item in self._with_cargo(names):
            for support, relation in supports_near(scene, item) if item not in names else ():
                if support in hosts:
                    with suppress(NoRoom):
                        scene = elsewhere(scene, item, support, relation)
                        moved.append(f"{item} {'in' if relation == 'inside' else 'on'} {support}")
                        break
        if moved:
            words = f"without {', '.join(names)}, and with {', '.join(moved)}"
            yield self._with(without(scene, names), "removed", self._with_cargo(names), words)

    def _with_cargo(self, names: list[str]) -> tuple[str, ...]:
        gone = {*names, *(carried for name in names for carried in resting_on(self._scene, name))}
        return tuple(name for name in self._scene.objects if name in gone)

    def _with(
        self, scene: Scene, kind: Literal["place", "door", "removed"], objects: tuple[str, ...], words: str
    ) -> Judged:
        return Judged(scene, (*self._at.fixes, SceneFix(kind, objects, words, self._at.reason)))

    def _other_supports(self, item: str) -> Iterator[tuple[str, str]]:
        here = place_of(self._scene, item)
        return (found for found in supports_near(self._scene, item) if found != here)

    def _neighbours(self, around: list[str], used: set[str]) -> Iterator[str]:
        """Yield furniture near what is handled that the plan does not use, the nearest first."""
        bodies = [Footprint.of(self._scene[name]) for name in around]
        gaps_m = {
            name: float(np.min([Footprint.of(self._scene[name]).gap_m(body) for body in bodies]))
            for name in self._fixtures
            if used.isdisjoint(self._with_cargo([name]))
        }
        return (name for name in sorted(gaps_m, key=lambda key: (gaps_m[key], key)) if gaps_m[name] < _NEAR_M)
