"""Judge goals on the physical world: detector readings, put down and picked up, distances to places, step observations.

Put down means upright, or as the item stood in the scene. `(ontop glass_0 table_0)` is true of a glass that fell over,
and `(not (ontop glass_0 table_0))` must stay false of it. So this is no matter of the detector but of the request: no
wish asks for a lying thing, so none is granted by one. Picked up means held clear of where the item was.
The distances turn "it fell beside the shelf" into a number that a flow can be corrected by.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

import bddl
from bddl import Atom, Formula, Not, conjuncts, evaluate, format
from executor.assets.asset_geometry import bounds, is_cube, rolls_freely
from executor.assets.model import Region
from executor.geometry import Array, inverse, rotation_z, transform_from_quaternion
from executor.records import Failure, FailureKind, StepRecord, SubtaskRecord
from executor.sim.detectors import GRIPPER, box_around, fingers_touching, read, touching_bodies
from executor.sim.world import World
from executor.skills.session import Session
from llm.evolve import AttemptObservation, StartObservation, StepObservation
from oag import Action, Task
from oag.measurements import NOTHING_MEASURED, AtomMeasured, GoalReading, Miss, Unmet
from oag.model.actions import flow_from_json
from oag.model.domain import BUILT_IN
from oag.model.symbols import has_boards

STANDS_DEG = 10.0
"""Largest tilt [deg] of an item on something level from its initial orientation: as much as on crumbs."""

LEANS_DEG = 45.0
"""The same inside an item [deg]: a bowl's walls are sloped, and what is smaller than its bottom leans on them;
beyond this the item lies on another side than it stood on."""

PICKED_UP_M = 0.10
"""Least height [m] above its place of a held item that counts as picked up."""

PLACING = frozenset({"inside", "ontop"})


@dataclass(frozen=True, slots=True)
class Handled:
    """Whether an item is put down or picked up as the goal means it.

    Attributes:
        as_meant: False for one that fell over, or that is hardly lifted.
        measured: The numbers behind it, and the reason where something is wrong.
    """

    as_meant: bool = True
    measured: AtomMeasured = NOTHING_MEASURED


def put_down(atom: Atom, world: World) -> Handled:
    """Return whether an item stands upright, or as in the scene, where an atom puts it on or in something.

    Items without an upright, such as a ball, always do; so does what is in the gripper.

    Args:
        atom: A ground atom that holds; one about no place counts as meant.
        world: The present world; its scene has the initial poses.
    """
    if atom.predicate not in PLACING or atom.args[0] not in world.dynamic_ids or atom.args[1] == GRIPPER:
        return Handled()
    item, support = atom.args
    if rolls_freely(world.assets[item]):
        return Handled()
    tilted_deg = tilt_deg(world, item)
    most_deg = LEANS_DEG if atom.predicate == "inside" and support in world.dynamic_ids else STANDS_DEG
    measured = AtomMeasured(tilted_deg=round(tilted_deg, 1))
    if tilted_deg <= most_deg:
        return Handled(measured=measured)
    words = f"{item} stands neither upright nor as it stood: {tilted_deg:.0f} degrees off; {most_deg:.0f} are the most"
    return Handled(False, replace(measured, reason=words))


def tilt_deg(world: World, item: str) -> float:
    """Return the tilt [deg] of an item from its initial orientation, or from upright where that is less.

    For an item that is round about its own z axis, rotation about that axis does not count. A cube is upright on each
    of its faces.
    """
    thing = world.scene.objects[item]
    before = transform_from_quaternion(thing.position, thing.orientation)[2, :3]
    now = world.T_world_link(item)[2, :3]
    off_upright = _angle_deg(float(np.abs(now).max()) if is_cube(world.assets[item]) else now[2])
    if world.assets[item].symmetric_about_z:
        return min(abs(off_upright - _angle_deg(before[2])), off_upright)
    return min(_angle_deg(float(before @ now)), off_upright)


def _angle_deg(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def picked_up(atom: Atom, world: World) -> Handled:
    """Return whether an item in the gripper is clear of its initial place.

    What was inside something is clear once it is outside; what was on a shelf, once it is out from between the boards;
    all else once it is `PICKED_UP_M` above its place.

    Args:
        atom: A ground atom that holds; one that is not about the gripper counts as meant.
        world: The present world; its scene has the initial poses.
    """
    if atom.predicate != "inside" or atom.args[1] != GRIPPER or atom.args[0] not in world.dynamic_ids:
        return Handled()
    item = atom.args[0]
    held_in = [fact for fact in _stated(world) if fact.predicate == "inside" and fact.args[0] == item]
    if any(read(fact, world).value for fact in held_in):
        return Handled(False, AtomMeasured(reason=f"{item} is still inside {held_in[0].args[1]}"))
    lifted_m = _lifted_m(world, item)
    measured = AtomMeasured(lifted_m=round(lifted_m, 4))
    if held_in or lifted_m >= PICKED_UP_M or _is_off_the_boards(world, item):
        return Handled(measured=measured)
    words = f"{item} is {100 * lifted_m:.1f} cm above its place; from {100 * PICKED_UP_M:.0f} cm on it is picked up"
    return Handled(False, replace(measured, reason=words))


def _is_off_the_boards(world: World, item: str) -> bool:
    """Return whether an item that stood on a shelf in the scene is over none of its boards."""
    for fact in _stated(world):
        if fact.predicate == "ontop" and fact.args[0] == item and fact.args[1] in world.assets:
            beyond_m = read(fact, world).measurements.centre_beyond_edge_m
            if has_boards(world.scene.objects[fact.args[1]].category) and beyond_m is not None and beyond_m > 0.0:
                return True
    return False


def _lifted_m(world: World, item: str) -> float:
    """Return by how much [m] an item's lowest point is above its initial height."""
    thing = world.scene.objects[item]
    T = transform_from_quaternion(thing.position, thing.orientation)
    before_m = T[2, 3] + bounds(world.assets[item], T[:3, :3])[0][2]
    centre, half = box_around(world, item)
    return float(centre[2] - half[2] - before_m)


def _stated(world: World) -> list[Atom]:
    return [one.atom for fact in world.scene.facts for one in bddl.literals(fact) or () if one.value]


PLACES = frozenset({"inside", "ontop", "under", "nextto"})
_KINDS = {"inside": "interior", "ontop": "surface"}
CLEARANCE_M = 0.01
"""Clearance [m] of the item's box from the sides of its place."""

FREE_FALL_M = 0.04
"""Largest height [m] above its place from which an item may be released."""


def judge(goal: Formula, world: World) -> tuple[GoalReading, ...]:
    """Return a reading for every conjunct of a goal.

    A literal is read by its detector. Any other formula is evaluated over its atoms' readings, quantifiers over the
    scene's objects. What no detector can decide counts as not satisfied, and is marked as undecided. Items that are
    to be on or in something have to stand there as in the scene (`put_down`).
    """
    return tuple(_judge_conjunct(part, world) for part in conjuncts(goal))


def judge_at_rest(goal: Formula, world: World) -> tuple[GoalReading, ...]:
    """Return a reading for every conjunct of a task's goal at the end: a held item is in no place.

    Atoms that put an item into or onto something hold only once no finger presses on it. What is to be in the
    gripper has to be clear of its initial place. The others are read as by `judge`.
    """
    return tuple(
        _clear(_let_go(reading, part, world), part, world)
        for reading, part in zip(judge(goal, world), conjuncts(goal), strict=True)
    )


def _clear(reading: GoalReading, part: Formula, world: World) -> GoalReading:
    return _combine(reading, picked_up(part, world)) if isinstance(part, Atom) and reading.satisfied else reading


def _combine(reading: GoalReading, found: Handled) -> GoalReading:
    """Return a reading that is false where an item is not as meant, with the numbers and the reason."""
    measured_fields = {field.name: getattr(found.measured, field.name) for field in fields(found.measured)}
    measured = replace(
        reading.measurements, **{name: value for name, value in measured_fields.items() if value is not None}
    )
    return replace(reading, value=reading.value and found.as_meant, measurements=measured)


def _let_go(reading: GoalReading, part: Formula, world: World) -> GoalReading:
    places = isinstance(part, Atom) and part.predicate in PLACES and part.args[1] != GRIPPER
    if not (places and reading.satisfied and isinstance(part, Atom) and part.args[0] in world.assets):
        return reading
    fingers = fingers_touching(world, part.args[0])
    return replace(reading, value=fingers == 0, measurements=replace(reading.measurements, fingers_touching=fingers))


def _judge_conjunct(part: Formula, world: World) -> GoalReading:
    atom, wanted = (part.body, False) if isinstance(part, Not) else (part, True)
    if isinstance(atom, Atom):
        reading = read(atom, world)
        if reading.value is None:
            undecided = replace(reading.measurements, undecided=True)
            return GoalReading(format(atom), wanted, not wanted, undecided, atom.predicate)
        found = GoalReading(format(atom), wanted, reading.value, reading.measurements, atom.predicate)
        return _combine(found, put_down(atom, world)) if wanted and found.satisfied else found
    categories = {object_id: thing.category for object_id, thing in world.scene.objects.items()}

    def standing(atom: Atom) -> bool | None:
        value = read(atom, world).value
        return value and put_down(atom, world).as_meant

    # Both must hold: an item that fell over is still there where a goal denies that it is.
    values = [evaluate(part, reads, categories) for reads in (lambda atom: read(atom, world).value, standing)]
    return GoalReading(
        format(part), True, all(value is True for value in values), AtomMeasured(undecided=None in values)
    )


def as_failure(readings: tuple[GoalReading, ...], name: str) -> Failure | None:
    """Return a failure that names what a goal still lacks, or None when it holds."""
    missing = [reading for reading in readings if not reading.satisfied]
    if not missing:
        return None
    wanted = [f"{r} ({r.measurements.reason})" if r.measurements.reason else str(r) for r in missing]
    return Failure(
        FailureKind.GOAL_NOT_REACHED,
        f"{name} ran, but {' and '.join(wanted)} does not hold",
        tuple(Unmet(reading.literal, reading.measurements) for reading in missing),
    )


def misses(goal: Iterable[Atom], world: World, base_yaw_rad: float) -> tuple[Miss, ...]:
    """Return how far the items of a goal are from their places, one for each `inside` or `ontop` that has a place.

    Args:
        goal: Atoms that shall be true.
        base_yaw_rad: The robot's heading, which is "forward".
    """
    return tuple(found for atom in goal for found in _nearest(atom, world, base_yaw_rad))


def _nearest(atom: Atom, world: World, base_yaw_rad: float) -> Iterator[Miss]:
    if atom.predicate not in _KINDS or len(atom.args) != 2:
        return
    item, support = atom.args
    if item not in world.dynamic_ids or support not in world.assets:
        return
    regions = [r for r in world.assets[support].regions if r.kind == _KINDS[atom.predicate]]
    found = [_miss(atom, world, region, base_yaw_rad) for region in regions]
    if found:
        yield min(found, key=lambda miss: miss.distance_m)


def _miss(atom: Atom, world: World, region: Region, base_yaw_rad: float) -> Miss:
    item, support = atom.args
    T_world_link = world.T_world_link(support, region.link)
    centre, half = box_around(world, item, inverse(T_world_link))
    middle, room = np.asarray(region.center_m), np.asarray(region.half_extents_m)
    # Where its centre may be: inside by its own size at the sides; standing, or a little above, in height.
    free = np.maximum(room - half - CLEARANCE_M, 0.0)
    low, high = middle - free, middle + free
    standing = middle[2] - room[2] + half[2]
    low[2], high[2] = standing, standing + FREE_FALL_M
    to_robot = rotation_z(base_yaw_rad).T @ T_world_link[:3, :3]
    offset: Array = to_robot @ (np.clip(centre, low, high) - centre)
    to_middle: Array = to_robot @ (middle - centre)
    numbers = (float(v) for v in np.round([*offset, *to_middle[:2]], 4))
    return Miss(format(atom), *numbers)


Moment = tuple[tuple[GoalReading, ...], tuple[Miss, ...]]


class StepWatch:
    """Readings of the goal before and after every step; it moves nothing.

    Args:
        goal: The subtask's regressed goal.
    """

    def __init__(self, goal: Formula) -> None:
        self._goal = goal
        self._wanted = tuple(part for part in conjuncts(goal) if isinstance(part, Atom))
        self._start: StartObservation | None = None
        self._before: list[Moment] = []
        self._after: list[Moment] = []

    def before(self, session: Session) -> None:
        """Read the goal when a step is about to run, and before the first one all facts."""
        if self._start is None:
            x_m, y_m, yaw_rad = (float(value) for value in session.control.q[:3])
            self._start = StartObservation(tuple(_facts(session)), (x_m, y_m, yaw_rad))
        self._before.append(self._look(session))

    def after(self, session: Session) -> None:
        """Read the goal when a step has run."""
        self._after.append(self._look(session))

    def observation(self, task: Task, record: SubtaskRecord) -> AttemptObservation:
        """Return the observation of an attempt, with the readings at its steps."""
        flow = task.subtasks[record.index].flow or ()
        domain = BUILT_IN if task.scene is None else task.scene.domain
        steps = tuple(
            _step(step, flow_from_json([step.action], domain)[0], asked, before, after)
            for step, asked, before, after in zip(record.steps, flow, self._before, self._after, strict=False)
        )
        return AttemptObservation(task, record.index, flow, steps, record.readings, self._start)

    def _look(self, session: Session) -> Moment:
        readings = judge(self._goal, session.world)
        yaw_rad = float(session.control.q[2])
        return readings, misses(self._wanted, session.world, yaw_rad)


def _facts(session: Session) -> Iterator[str]:
    """Yield what is true of doors and of movable items, as BDDL; objects that are not believed are left out."""
    world, known = session.world, session.believed.assets
    atoms = [Atom("open", (name,)) for name in world.articulated_ids]
    for name in world.dynamic_ids:
        containers = [other for other, asset in known.items() if asset.regions and other != name]
        atoms += [Atom("ontop", (name, other)) for other in touching_bodies(world, name) if other in known]
        atoms += [Atom("inside", (name, other)) for other in containers]
    yield from (format(atom) for atom in atoms if read(atom, world).value)
    if session.hand.held is not None:
        yield format(Atom("inside", (session.hand.held, GRIPPER)))


def _step(step: StepRecord, done: Action, asked: Action, before: Moment, after: Moment) -> StepObservation:
    failure = step.failure
    return StepObservation(
        step=step.step,
        asked=asked,
        done=done,
        measurements=step.measurements,
        failure=failure.kind.value if failure else "",
        message=failure.message if failure else "",
        failure_measurements=failure.measurements if failure else (),
        before=before[0],
        after=after[0],
        misses_before=before[1],
        misses_after=after[1],
    )
