"""Repairs: each reason of a failure gives other plans, and the graph proves those before they are gone through."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

import bddl
import llm
import oag
from executor.assets.library import asset_for
from executor.records import Failure, FailureKind, StepRecord, SubtaskRecord
from executor.rollouts.repairs import (
    WIDER_FRACTIONS,
    Failed,
    Repair,
    another_door,
    another_order,
    moved_aside,
    opened_wider,
    repairs,
)
from executor.scenes.library import load
from executor.skills.navigate_to_support import NOMINAL
from oag import Scene, SceneObject
from oag.measurements import JointMotion, Measurement, SupportDrive, TargetDrive, Unplanned

WIDTH_M = 0.045
"""Of things that the hand takes as they are."""


def with_cans(*places_m: tuple[float, float]) -> Scene:
    """The kitchen with narrow cans on the table, off the glass by the given offsets."""
    kitchen = load("kitchen_t1")
    x, y, z = kitchen["glass_0"].position
    bottom = z - kitchen["glass_0"].extent_m[2] / 2
    upright, one, size = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (WIDTH_M, WIDTH_M, 0.10)
    cans = {
        f"can_{k}": SceneObject(f"can_{k}", "can", "can", (x + dx, y + dy, bottom + 0.05), upright, size, one)
        for k, (dx, dy) in enumerate(places_m)
    }
    facts = (*kitchen.facts, *(bddl.Atom("ontop", (name, "table_0")) for name in cans))
    return replace(kitchen, objects={**kitchen.objects, **cans}, facts=facts)


def step(primitive: str, *measurements: Measurement, failure: Failure | None = None) -> StepRecord:
    return StepRecord(0, 0, primitive, 1, 0.0, 0.0, 0.0, measurements, failure)


def record(task: oag.Task, index: int, *steps: StepRecord) -> SubtaskRecord:
    return SubtaskRecord(index, task.subtasks[index].name, task.subtasks[index].flow or (), steps, (), "", b"", {})


def blocked(scene: Scene, query: str, index: int, *bodies: str) -> Failed:
    """A pick that failed since the hand meets some bodies."""
    task = llm.propose(query, scene).task
    found = Unplanned(target=task.subtasks[index].target, in_the_way=bodies)
    failure = Failure(FailureKind.NO_PATH, "no way", (found,))
    return Failed(task, index, record(task, index, step("NAVIGATE_TO_TARGET", failure=failure)), scene, None)


def proved(failed: Failed, table: Callable[[Failed], Iterator[Repair]]) -> list[Repair]:
    return [one for one in table(failed) if oag.compose(one.task, scene=failed.scene).verify()]


def test_what_is_in_the_way_is_set_down_elsewhere_by_a_plan_that_is_proved() -> None:
    failed = blocked(with_cans((0.06, 0.0)), "put the glass into the refrigerator", 1, "panda_hand and can_0/can")
    found = proved(failed, moved_aside)
    assert found
    for repair in found:
        names = [one.name for one in repair.task.subtasks]
        assert names[1:3] == ["take_can_0_away", "set_can_0_down"] and repair.last == 3
        assert [*names[:1], *names[3:]] == [one.name for one in failed.task.subtasks]
        assert repair.detour.count == 2 and "can_0" in repair.detour.reason
    assert not proved(failed, another_order), "the plan does not handle the can"


def test_a_door_in_the_way_is_opened_wider_where_the_plan_opens_it() -> None:
    scene = with_cans()
    body = "panda_link5 and refrigerator_0/door"
    found = blocked(scene, "put the glass into the refrigerator", 2, body)
    motion = JointMotion("door_hinge", "rigid arc", 0.0, 0.65, 0.65, 0.8)
    before = (record(found.task, 0, step("ARTICULATE_OPEN", motion)), record(found.task, 1, step("GRASP")))
    failed = replace(found, before=before, held="glass_0")
    repaired = proved(failed, opened_wider)
    assert [repair.first for repair in repaired] == [0, 0] and all(repair.last == 2 for repair in repaired)
    ends = [
        action.parameter for repair in repaired for action in repair.task.subtasks[0].flow or () if action.parameter
    ]
    assert ends == [(0.0, fraction) for fraction in WIDER_FRACTIONS]
    wide = replace(motion, fraction_reached=0.98)
    assert not proved(replace(failed, before=(record(found.task, 0, step("OPEN", wide)), before[1])), opened_wider)
    # Opened wider, the left door of two does not move the right one that is in the way.
    other = replace(motion, joint="left_door_hinge")
    assert not proved(replace(failed, before=(record(found.task, 0, step("OPEN", other)), before[1])), opened_wider)
    # The door of what is not reached into is another matter.
    elsewhere = blocked(scene, "put the glass into the refrigerator", 1, body)
    assert not proved(replace(elsewhere, before=before[:1]), opened_wider)


def test_a_door_that_stands_ajar_is_opened_wider_before_the_thing_is_taken() -> None:
    kitchen = with_cans()
    ajar = replace(kitchen["refrigerator_0"], parameters={**kitchen["refrigerator_0"].parameters, "open_fraction": 0.3})
    is_open = bddl.Atom("open", ("refrigerator_0",))
    facts = (*(fact for fact in kitchen.facts if fact != bddl.Not(is_open)), is_open)
    scene = replace(kitchen, objects={**kitchen.objects, "refrigerator_0": ajar}, facts=facts)
    found = blocked(scene, "put the glass into the refrigerator", 1, "held object and refrigerator_0/door")
    (repair,) = proved(replace(found, held="glass_0"), opened_wider)
    names = [one.name for one in repair.task.subtasks]
    assert names[0] == "open_refrigerator_0_wider" and (repair.first, repair.last) == (0, 2)
    assert repair.task.subtasks[2] == found.subtask and repair.detour.count == 1


def test_what_the_plan_handles_later_is_handled_first() -> None:
    scene = with_cans((0.06, 0.0))
    failed = blocked(scene, "put the glass and the can into the refrigerator", 1, "can_0/can")
    (repair,) = proved(failed, another_order)
    targets = [one.target for one in repair.task.subtasks]
    assert targets.index("can_0") == 1 and targets[repair.last] == "glass_0"
    assert sorted(one.name for one in repair.task.subtasks) == sorted(one.name for one in failed.task.subtasks)


def no_place(scene: Scene, query: str, index: int, *, suits: bool | None) -> Failed:
    """A thing in the hand that found no place, from a grasp that suits its place or not."""
    task = llm.propose(query, scene).task
    put = task.subtasks[index]
    drive = SupportDrive(str(put.support_goal), stance=NOMINAL)
    failure = Failure(FailureKind.NO_PATH, "no place", (Unplanned(target=put.target, support=put.support_goal),))
    taken = step("NAVIGATE_TO_TARGET", TargetDrive(0.0, 0.0, 0.0, 40.0, 2, suits_place=suits))
    before = tuple(record(task, k, taken) for k in range(index))
    return Failed(
        task, index, record(task, index, step("NAVIGATE_TO_SUPPORT", drive, failure=failure)), scene, put.target, before
    )


def test_what_is_taken_later_from_where_there_is_no_place_goes_first() -> None:
    scene = with_cans((0.06, 0.0))
    on_top = bddl.Atom("ontop", ("can_0", "refrigerator_0"))
    facts = (*(fact for fact in scene.facts if "can_0" not in str(fact)), on_top)
    scene = replace(scene, facts=facts)
    failed = no_place(scene, "put the glass on the refrigerator and the can on the table", 1, suits=None)
    first = next(repairs(failed))
    targets = [one.target for one in first.task.subtasks]
    assert targets[:2] == ["can_0", "can_0"] and first.last == 3 and "can_0" in first.detour.reason
    other = no_place(scene, "put the glass on the refrigerator", 1, suits=None)
    assert not proved(other, another_order), "nothing is taken from there"


@pytest.mark.parametrize(("suits", "again"), [(False, True), (None, False)])
def test_a_hand_that_does_not_suit_the_place_takes_the_thing_again_first(suits: bool | None, again: bool) -> None:
    failed = no_place(two_doors(), "put the glass into the cabinet", 2, suits=suits)
    motion = JointMotion("left_door_hinge", "rigid arc", 0.0, 0.8, 0.8, 1.5)
    opened = record(failed.task, 0, step("ARTICULATE_OPEN", motion))
    first = next(repairs(replace(failed, before=(opened, *failed.before[1:]))))
    assert ("taken again" in first.detour.reason) is again
    assert again or first.avoided, "else another door is tried first"


def two_doors() -> Scene:
    kitchen = load("kitchen_t1")
    size = (0.6, 1.0, 0.85)
    place, upright, one = (1.5, -1.5, size[2] / 2), (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    cabinet = SceneObject("cabinet_0", "bottom_cabinet", "cabinet_two_doors", place, upright, size, one, {"shelves": 1})
    facts = (*kitchen.facts, bddl.Not(bddl.Atom("open", ("cabinet_0",))))
    return replace(kitchen, objects={**kitchen.objects, "cabinet_0": cabinet}, facts=facts)


@pytest.mark.parametrize("body", ["refrigerator_0/door", "wall_9/wall", "glass_0/glass"])
def test_furniture_the_target_and_strangers_are_not_moved(body: str) -> None:
    failed = blocked(with_cans(), "put the glass into the refrigerator", 1, f"panda_hand and {body}")
    assert not list(repairs(failed))


def test_another_drawer_is_opened_where_the_first_has_no_place() -> None:
    kitchen = load("kitchen_t1")
    size = (0.6, 0.5, 0.85)
    place, upright, one = (1.5, -1.5, size[2] / 2), (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    drawers = SceneObject("cabinet_0", "bottom_cabinet", "cabinet_drawers", place, upright, size, one, {"drawers": 3})
    facts = (*kitchen.facts, bddl.Not(bddl.Atom("open", ("cabinet_0",))))
    scene = replace(kitchen, objects={**kitchen.objects, "cabinet_0": drawers}, facts=facts)
    task = llm.propose("put the glass into the cabinet", scene).task
    names = [one.name for one in task.subtasks]
    opening, placing = 0, next(k for k, name in enumerate(names) if name.startswith("put"))
    motion = JointMotion("drawer_0_slide", "rigid arc", 0.0, 0.8, 0.8, 0.3)
    before = tuple(
        record(task, k, step("ARTICULATE_OPEN", motion) if k == opening else step("GRASP")) for k in range(placing)
    )
    nowhere = SupportDrive("cabinet_0", stance="nominal: the flow's numbers reach no free spot")
    failure = Failure(FailureKind.NO_PATH, "no place", ())
    last = record(task, placing, step("NAVIGATE_TO_SUPPORT", nowhere), step("MOVE_BASE_FORWARD", failure=failure))
    failed = Failed(task, placing, last, scene, "glass_0", before)
    (repair,) = another_door(failed)
    assert repair.avoided == {("cabinet_0", "drawer_0_slide")} and repair.task == task
    assert (repair.first, repair.last, repair.detour.count) == (opening, placing, 0)
    handles = {handle.joint for handle in asset_for(scene["cabinet_0"]).handles}
    assert len(handles) == 3
    everything = frozenset(("cabinet_0", joint) for joint in handles)
    assert not list(another_door(replace(failed, avoided=everything)))
