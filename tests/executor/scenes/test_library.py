"""The package's scenes load, and say what they contain."""

from __future__ import annotations

import pytest

import bddl
from executor.assets.library import asset_for
from executor.scenes import library
from executor.scenes.library import SceneNotFound
from oag import Scene


def test_the_paper_s_four_scenes_are_there() -> None:
    assert {"kitchen_t1", "kitchen_t2", "kitchen_t3", "kitchen_t4"} <= set(library.names())


@pytest.mark.parametrize("name", library.names())
def test_every_scene_loads_and_can_be_written_back(name: str) -> None:
    scene = library.load(name)
    assert scene.name == name
    assert Scene.from_json(scene.to_json()) == scene
    for obj in scene.objects.values():
        assert asset_for(obj).extent_m == pytest.approx(obj.extent_m)


@pytest.mark.parametrize("name", library.names())
def test_facts_are_over_the_scene_s_objects(name: str) -> None:
    scene = library.load(name)
    assert scene.facts
    named = {argument for fact in scene.facts for atom in bddl.atoms(fact) for argument in atom.args}
    assert named <= set(scene.objects)


def test_objects_have_the_sizes_that_the_size_adjustment_starts_from() -> None:
    assert library.load("kitchen_t1").objects["glass_0"].bbox_extent == (0.07, 0.07, 0.12)
    assert library.load("kitchen_t3").objects["apple_0"].bbox_extent[0] == 0.08


def test_an_unknown_scene_names_near_ones() -> None:
    with pytest.raises(SceneNotFound, match="there is no scene 'kitchen_t0'") as caught:
        library.load("kitchen_t0")
    assert "kitchen_t1" in str(caught.value)
