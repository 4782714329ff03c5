"""Size adjustment in proposals: one factor an object, every scaling said, and one that goes too far refused."""

from __future__ import annotations

import copy

import pytest

import llm
import oag
from llm.offline.subtasks import scale_factors
from llm.proposing.model_proposer import ModelProposer
from oag.sizes import TO_THE_AIM, Sizing
from tests.llm.kitchens import SCENES
from tests.llm.scripted_modules import QUERIES, Script, Wrong, right_answers, scene_of

QUERY = "put the cup into the fridge"


def kitchen(width_m: float, scene: oag.Scene = SCENES["kitchen_t1"]) -> oag.Scene:
    """Return a kitchen with a glass of that width."""
    data = scene.to_json()
    objects = data["objects"]
    assert isinstance(objects, dict)
    objects["glass_0"] |= {"bbox_extent": [width_m, width_m, 0.12]}
    return oag.Scene.from_json(data)


def test_each_object_gets_one_factor_in_order_of_first_use() -> None:
    targets = ("refrigerator_0", "glass_0", "glass_0", "refrigerator_0")
    factors = scale_factors(targets, SCENES["kitchen_t1"], TO_THE_AIM)
    assert list(factors.items()) == [("refrigerator_0", 1.0), ("glass_0", 0.71)]
    assert llm.propose("put the cup into the fridge", SCENES["kitchen_t1"]).task.scales == factors


def test_every_scaling_is_in_the_notes() -> None:
    proposal = llm.propose(QUERY, SCENES["kitchen_t1"])
    said = "glass_0 is scaled by 0.71, from 70 x 70 x 120 to 50 x 50 x 85 mm"
    assert said in proposal.notes and said in proposal.to_json()["notes"]
    assert not any("scaled" in note for note in llm.propose(QUERY, kitchen(0.053)).notes)


@pytest.mark.parametrize("width_m", [0.054, 0.057, 0.06, 0.086])
def test_what_the_gripper_does_not_take_is_scaled(width_m: float) -> None:
    proposal = llm.propose(QUERY, kitchen(width_m))
    assert 0.6 <= proposal.task.scales["glass_0"] < 1.0
    assert oag.compose(proposal.task).verify()


def test_a_model_is_not_asked_for_a_size_that_there_is_not() -> None:
    script = Script(right_answers("T1"))
    with pytest.raises(llm.QueryError) as refused:
        ModelProposer(script, name="script", cross_check=False).propose(QUERIES["T1"], kitchen(5.0, scene_of("T1")))
    assert refused.value.code == "too-large"
    assert script.count(2) == 1 and script.count(3) == 0 and script.count(4) == 0


def test_a_models_size_below_the_least_is_refused() -> None:
    right = right_answers("T1")
    for entry in right[4]["sub_tasks"]:
        if entry["target"] == "glass_0":
            entry["scale"] = 0.6
    wrong = copy.deepcopy(right[4])
    for entry in wrong["sub_tasks"]:
        if entry["target"] == "glass_0":
            entry["scale"] = 0.59
    script = Script(right, {4: [Wrong(wrong, "nothing is scaled by less than 0.6")]})
    proposal = ModelProposer(script, name="script", cross_check=False).propose(
        QUERIES["T1"], kitchen(0.085, scene_of("T1"))
    )
    assert proposal.task.scales["glass_0"] == 0.6 and script.count(4) == 2
    assert "glass_0 is scaled by 0.6, from 85 x 85 x 120 to 51 x 51 x 72 mm" in proposal.notes


def test_a_seed_draws_the_width_and_keeping_sizes_draws_none() -> None:
    scene = SCENES["kitchen_t1"]
    factors = {llm.propose(QUERY, scene, sizing=Sizing(seed)).task.scales["glass_0"] for seed in range(8)}
    assert len(factors) == 8 and all(0.6 <= factor <= 0.052 / 0.07 + 1e-3 for factor in factors)
    with pytest.raises(llm.QueryError, match="it is to keep its size") as refused:
        llm.propose(QUERY, scene, sizing=Sizing(0, keep=True))
    assert refused.value.code == "too-large"
    kept = llm.propose(QUERY, kitchen(0.052), sizing=Sizing(0, keep=True))
    assert set(kept.task.scales.values()) == {1.0}


def test_a_model_is_not_asked_for_sizes_that_are_kept() -> None:
    script = Script(right_answers("T1"))
    proposer = ModelProposer(script, name="script", cross_check=False, sizing=Sizing(keep=True))
    proposal = proposer.propose(QUERIES["T1"], kitchen(0.05, scene_of("T1")))
    assert script.count(4) == 0 and set(proposal.task.scales.values()) == {1.0}


@pytest.mark.parametrize("width_m", [0.09, 5.0])
def test_a_scale_below_the_least_is_refused_and_what_fits_is_said(width_m: float) -> None:
    with pytest.raises(llm.QueryError, match=r"nothing is scaled by less than 0\.6.*up to 0\.087 m wide") as refused:
        llm.propose(QUERY, kitchen(width_m))
    assert refused.value.code == "too-large" and refused.value.understood == "put glass_0 into refrigerator_0"
