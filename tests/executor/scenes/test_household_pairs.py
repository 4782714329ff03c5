"""The pairs of a seed: determinism, variety, plans that are proved and mean what the layout means, settled scenes."""

from __future__ import annotations

import pytest

import oag
from executor.assets.library import asset_for
from executor.scenes.generators import household
from executor.scenes.pair import NotDrawn, ScenePair
from executor.scenes.reachability import reach
from executor.scenes.validation import overlaps, settle
from executor.sim.world import World
from oag import Verdict
from oag.sizes import LEAST_SCALE, PAPER_GRIPPER, resized_targets

pytestmark = pytest.mark.physics
SEED = 13100
# Of each kind of room, and of each deed: opening, picking up, closing.
SAMPLE = (3, 26, 50, 57, 78, 92, 96)
ALL = range(household.COUNT)
BEAR, BOWL = 51, 96


@pytest.fixture(scope="module")
def sample() -> dict[int, ScenePair]:
    return {index: household.pair(SEED, index) for index in SAMPLE}


@pytest.mark.slow
def test_equal_seeds_give_equal_pairs_and_others_do_not(sample: dict[int, ScenePair]) -> None:
    again, other = household.pair(SEED, SAMPLE[0]), household.pair(SEED + 1, SAMPLE[0])
    assert again == sample[SAMPLE[0]]
    assert other.scene.objects != again.scene.objects and other.query == again.query


def test_a_pair_is_named_after_its_family_seed_and_room(sample: dict[int, ScenePair]) -> None:
    assert sample[26].id == f"T5-{SEED}-kitchen09-c"
    assert sample[57].id == f"T6-{SEED}-bedroom04-a"
    assert sample[26].family == "T5" and sample[57].family == "T6"


def test_nothing_is_made_into_another_thing_and_widths_differ(sample: dict[int, ScenePair]) -> None:
    changes = [change for pair in sample.values() for change in resized_targets(pair.task, pair.scene)]
    assert changes and all(min(change.factors) >= LEAST_SCALE for change in changes)
    # A room whose target is the widest that there are, and one that is held by its rim at its own size.
    bears, bowls = ([household.pair(seed, index) for seed in range(SEED, SEED + 3)] for index in (BEAR, BOWL))
    widths_m = [min(pair.scene["teddy_bear_0"].extent_m[:2]) for pair in bears]
    assert len(set(widths_m)) == 3 and max(widths_m) <= PAPER_GRIPPER.widest_m
    assert all(not resized_targets(pair.task, pair.scene) for pair in bowls)
    assert min(min(pair.scene["bowl_0"].extent_m[:2]) for pair in bowls) > PAPER_GRIPPER.widest_m


def test_a_room_in_which_nothing_is_scaled_has_nothing_that_is() -> None:
    kept = household.pair(SEED, BOWL, keep_sizes=True)
    assert {obj.scale for obj in kept.scene.objects.values()} == {(1.0, 1.0, 1.0)}
    with pytest.raises(NotDrawn, match=r"teddy_bear_0 is 0.0.. m wide.*it is to keep its size"):
        household.pair(SEED, BEAR, keep_sizes=True)


def test_there_are_pairs_0_to_101() -> None:
    with pytest.raises(IndexError, match="0 to 101"):
        household.pair(SEED, 102)


@pytest.mark.parametrize("index", SAMPLE)
def test_the_plan_is_proved_and_is_what_the_layout_means(sample: dict[int, ScenePair], index: int) -> None:
    check_plan(sample[index], index)


@pytest.mark.parametrize("index", SAMPLE)
def test_the_scene_is_concrete_settled_and_at_its_adjusted_size(sample: dict[int, ScenePair], index: int) -> None:
    check_scene(sample[index])


def test_what_starts_open_is_open(sample: dict[int, ScenePair]) -> None:
    scene = sample[26].scene
    facts = {str(fact) for fact in scene.facts}
    assert "(open refrigerator_0)" in facts
    assert len(asset_for(scene["refrigerator_0"]).joints) == 1


def test_the_variations_of_a_room_have_other_models_and_sizes() -> None:
    rooms = [household.pair(SEED, index).scene for index in (0, 1, 2)]
    fridges = [room["refrigerator_0"] for room in rooms]
    assert len({fridge.model for fridge in fridges}) == 3
    for thing in ("refrigerator_0", "table_0", "bottle_0", "apple_0"):
        assert len({room[thing].bbox_extent for room in rooms}) == 3
        assert len({room[thing].position for room in rooms}) == 3
    assert len({str(fridge.parameters) for fridge in fridges}) == 3


def test_a_query_that_is_understood_otherwise_is_told_apart(sample: dict[int, ScenePair]) -> None:
    wish = household.layouts()[1].wishes[0]
    assert not list(household.mismatches(sample[3].task, wish))
    assert list(household.mismatches(sample[57].task, wish)) == [
        "it is about medicine_0, not cabinet_1",
        "it does not open anything",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("index", ALL)
def test_every_pair_of_a_seed(index: int) -> None:
    pair = household.pair(SEED, index)
    check_plan(pair, index)
    check_scene(pair)


@pytest.mark.slow
def test_at_least_95_of_the_102_pass_the_rule_of_reach() -> None:
    found = {pair.id: reach(pair.scene, pair.task) for pair in household.pairs(SEED)}
    refused = {name: each.reason for name, each in found.items() if not each.reachable}
    assert len(found) == household.COUNT
    assert len(refused) <= household.COUNT - 95, refused


def check_plan(pair: ScenePair, index: int) -> None:
    """Asserts that a pair's task is the one subtask that its layout declares, and proved."""
    wish = household.layouts()[index // household.VARIATIONS].wishes[index % household.VARIATIONS]
    (subtask,) = pair.task.subtasks
    assert (subtask.target, pair.query, pair.family) == (wish.target, wish.query, wish.family)
    primitives = {action.primitive.name for action in subtask.flow or ()}
    assert {"open": "ARTICULATE_OPEN", "close": "ARTICULATE_CLOSE", "pick": "GRASP"}[wish.deed] in primitives
    graph = oag.compose(pair.task, scene=pair.scene)
    assert graph.verify().verdict is Verdict.PROVED


def check_scene(pair: ScenePair) -> None:
    """Asserts that nothing overlaps, that nothing moves any more, and that no size is left to adjust."""
    assert set(pair.task.scales.values()) <= {1.0}
    with World(pair.scene, oracle=True) as world:
        assert not [found for found in overlaps(world) if found[2] > 1e-3]
    settled = settle(pair.scene, most_moved_m=2e-3)
    assert set(settled.objects) == set(pair.scene.objects)
