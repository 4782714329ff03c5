"""From a drawn photograph to a scene that a task is proved in, through the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.drawn_rooms.measure import category_in
from benchmarks.drawn_rooms.tracks import MockedDetector, input_of, noisy
from executor.bench.photo.truth import Shot, photograph, photographer
from executor.cli.app import run
from executor.scenes.file import complete_scene, load_scene

SIZE = (480, 360)
ROOM = {
    "name": "corner",
    "robot": {"position": [-1.6, 1.6]},
    "objects": {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.0, 0.0], "heading_deg": 12.0},
        "bowl_0": {"category": "bowl", "on": "table_0", "at": [0.1, 0.1]},
        "cabinet_0": {
            "category": "bottom_cabinet",
            "model": "cabinet_one_door",
            "position": [0.7, -1.0],
            "parameters": {"hinge": "right"},
        },
    },
}


@pytest.fixture(scope="module")
def shot() -> Shot:
    """A photograph of a corner with a table, a bowl on it, and a cabinet."""
    scene = complete_scene(ROOM).scene
    assert scene is not None
    with photographer():
        return photograph(scene, 62001, SIZE)


@pytest.fixture(scope="module")
def folder(shot: Shot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The photograph as files: picture, noisy depth, camera, and boxes around what is seen of each thing."""
    path = tmp_path_factory.mktemp("photo")
    Image.fromarray(shot.rgb).save(path / "room.png")
    depth = np.round(1000 * noisy(shot.depth_m, np.random.default_rng(0))).astype(np.uint16)
    Image.fromarray(depth).save(path / "depth.png")
    (path / "camera.json").write_text(json.dumps({"K": shot.K.tolist()}))
    things = []
    for name, mask in shot.visible().items():
        rows, columns = np.nonzero(mask)
        box = [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]
        things.append({"label": shot.scene.objects[name].category, "box": box})
    (path / "boxes.json").write_text(json.dumps({"source": "the test", "things": things}))
    return path


def photo(folder: Path, *more: str) -> int:
    """Run the command on the photograph and returns its exit code."""
    given = ["--depth", folder / "depth.png", "--boxes", folder / "boxes.json", "--camera", folder / "camera.json"]
    return run(["photo", str(folder / "room.png"), *map(str, given), "--out", str(folder / "out"), *more])


@pytest.mark.slow
@pytest.mark.render
def test_a_photograph_becomes_a_scene_that_a_plan_is_proved_in(
    shot: Shot, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert photo(folder, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["refused"] == "" and set(told["things"]) == {"table_0", "bowl_0", "bottom_cabinet_0"}
    scene = load_scene(folder / "out" / "scene.json")
    names = {"table_0": "table_0", "bowl_0": "bowl_0", "bottom_cabinet_0": "cabinet_0"}
    # The back of a cabinet that stands free is not seen.
    for (made, true), most_m in zip(names.items(), (0.02, 0.02, 0.04), strict=True):
        x, y, z = (shot.T_level_world @ [*shot.scene.objects[true].position, 1.0])[:3]
        assert np.linalg.norm(np.subtract(scene.objects[made].position, (x, y, z))) < most_m, made
        assert scene.objects[made].model == shot.scene.objects[true].model
    assert "(ontop bowl_0 table_0)" in scene.to_json()["facts"]
    origins = json.loads((folder / "out" / "scene.json").read_text())["provenance"]
    assert origins["bowl_0"]["category"] == "the test: bowl" and "fitted" in origins["bowl_0"]["position"]
    page = (folder / "out" / "report.html").read_text()
    assert all(key in page for key in names) and "settled in physics" in page
    assert run(["plan", "pick up the bowl", "--scene", str(folder / "out" / "scene.json"), "--json"]) == 0
    assert photo(folder) == 2, "results are not overwritten"
    made = (folder / "out" / "scene.json").read_bytes()
    assert photo(folder, "--force") == 0
    assert (folder / "out" / "scene.json").read_bytes() == made, "the same input makes the same scene"


@pytest.mark.slow
@pytest.mark.render
def test_a_run_makes_its_scene_of_a_photograph_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beside = ["--depth", folder / "depth.png", "--boxes", folder / "boxes.json", "--camera", folder / "camera.json"]
    command = [
        "run",
        "pick up the bowl",
        "--photo",
        folder / "room.png",
        *beside,
        "--out",
        folder / "run",
        "--no-video",
    ]
    words = [str(word) for word in command]
    assert run([*words, "--scene", "kitchen_t1"]) == 2, "one scene is enough"
    assert run(words) == 0
    made = (folder / "run" / "photo" / "scene.json").read_bytes()
    assert json.loads((folder / "run" / "scene.json").read_text())["objects"].keys() >= {"bowl_0", "table_0"}
    monkeypatch.setattr("executor.photo.pipeline.reconstruct_scene", lambda *given: pytest.fail("it was made before"))
    assert run([*words, "--force"]) == 0
    assert (folder / "run" / "photo" / "scene.json").read_bytes() == made


@pytest.mark.render
def test_whoever_names_a_thing_calls_it_what_it_is_called_in_its_room(shot: Shot) -> None:
    cabinet = replace(shot.scene.objects["cabinet_0"], category="dresser")
    room = replace(shot, scene=replace(shot.scene, objects={**shot.scene.objects, "cabinet_0": cabinet}))
    categories = {name: category_in(room.scene, name) for name in room.visible()}
    sure = MockedDetector(missed=0.0, misnamed=0.0)
    boxes = input_of("B", "corner", room, categories, sure, np.random.default_rng(0)).boxes
    assert (boxes["cabinet_0"].label, boxes["cabinet_0"].category) == ("dresser", "bottom_cabinet")
    assert boxes["table_0"].label == boxes["table_0"].category == "table"
