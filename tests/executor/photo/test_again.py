"""A first scene within seconds, what Ctrl-C keeps, and corrections that are taken up again."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from executor.cli.app import run
from executor.photo.again import read_earlier
from executor.photo.drawing import side_by_side
from executor.photo.errors import LostCause, PhotoRefused
from executor.photo.fitting.hypothesis import PoseHypothesis, hypothesis_of
from executor.photo.geometry.observation import FloorPlane, Observation
from executor.photo.inputs.annotations import FLOOR, OWN_SUPPORTS, Detection
from executor.photo.inputs.picture import Exif, Photograph
from executor.photo.output import write_result
from executor.photo.pipeline import PhotoInput, PhotoResult, reconstruct_scene
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import RoomFitter
from executor.photo.room.reconstruct import FittedRoom, Listener, reconstruct
from executor.photo.scene import scene_of
from executor.scenes.file import load_scene
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.executor.photo.test_shapes import known, shape

CUP = replace(shape("generic_cylinder", (0.07, 0.07, 0.09)), y_m=0.25)


def result_of(seen: Observation, room: FittedRoom) -> PhotoResult:
    """Return fits that were not searched for as the reconstruction of a drawn picture."""
    picture = Photograph(Path("drawn.png"), seen.rgb, Exif(None, None, ""))
    floor = FloorPlane(np.array([0.0, -0.9, -0.43]), 1.5, 1.0, 25.0, 0.0)
    boxes = tuple(thing.detection for thing in room.things)
    found, made = scene_of(room, "drawn")
    return PhotoResult(PhotoInput("drawn", picture, None, seen.K, boxes, seen, floor), found, made, (), {})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Results of a table with a bowl and a cup on it."""
    seen, boxes = seen_from_above(TABLE, BOWL, CUP)
    labels = ("table", "bowl", "cup")
    things = [
        (replace(box, label=label), one) for box, label, one in zip(boxes, labels, (TABLE, BOWL, CUP), strict=True)
    ]
    write_result(tmp_path, result_of(seen, known(seen, *things)), {"picture": "drawn.png"})
    return tmp_path


def corrected(folder: Path, **values: dict[str, Any]) -> None:
    """Write other values into the lines of things."""
    path = folder / "things.json"
    data = json.loads(path.read_text())
    for entry in data["things"]:
        entry.update(values.get(entry["id"], {}))
    path.write_text(json.dumps(data))


def test_everything_stays_where_nothing_is_corrected(folder: Path) -> None:
    lines = [line for line in (folder / "things.json").read_text().splitlines() if '"id"' in line]
    assert len(lines) == 3 and '"on": "table_0"' in lines[1]
    earlier = read_earlier(folder)
    assert sorted(earlier.kept) == [0, 1, 2] and earlier.inputs == {"picture": "drawn.png"}
    assert [one.label for one in earlier.detections] == ["table", "bowl", "cup"]
    assert all(one.on is None and one.size_m is None for one in earlier.detections)
    for guess, fit in zip((TABLE, BOWL, CUP), earlier.kept.values(), strict=True):
        assert fit.guess == replace(guess, entry=fit.guess.entry) and fit.guess.entry.model == guess.entry.model


@pytest.mark.parametrize(
    ("changed", "kept"),
    [
        ({"cup_2": {"label": "beaker"}}, [0, 1]),
        ({"bowl_1": {"size_m": [0.2, 0.2, 0.07]}}, [0, 2]),
        ({"cup_2": {"on": "floor"}}, [0, 1]),
        ({"cup_2": {"on": "wall"}}, [0, 1]),
        ({"table_0": {"size_m": [1.2, 0.6, 0.75]}}, []),
    ],
)
def test_what_is_corrected_and_what_stands_on_it_is_fitted_again(
    folder: Path, changed: dict[str, dict[str, Any]], kept: list[int]
) -> None:
    corrected(folder, **changed)
    earlier = read_earlier(folder)
    assert sorted(earlier.kept) == kept
    (key, values), *_ = changed.items()
    one = earlier.detections[int(key[-1])]
    assert one.label == values.get("label", one.label)
    assert one.size_m == (tuple(values["size_m"]) if "size_m" in values else None)
    assert one.on == OWN_SUPPORTS.get(values.get("on", ""))


def test_a_correction_that_means_nothing_is_refused(folder: Path) -> None:
    corrected(folder, cup_2={"on": "tabel_0"})
    with pytest.raises(PhotoRefused, match="'tabel_0', which is no id; expected floor, wall, table_0"):
        read_earlier(folder)
    corrected(folder, cup_2={"on": "table_0", "size_m": [0.1, 0.1, -1.0]})
    with pytest.raises(PhotoRefused, match="expected three lengths in metres"):
        read_earlier(folder)
    corrected(folder, cup_2={"size_m": "large"})
    with pytest.raises(PhotoRefused, match="an entry is malformed"):
        read_earlier(folder)
    (folder / "photo.json").unlink()
    with pytest.raises(PhotoRefused, match="has no reconstruction to go on from"):
        read_earlier(folder)


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ({}, '"inputs" name no picture'),
        ([], '"inputs" name no picture'),
        ({"picture": 3}, '"inputs" name no picture'),
        ({"picture": "drawn.png", "tilt": "steep"}, "inputs/tilt is 'steep'; Input should be a valid number"),
        ({"picture": "drawn.png", "depth": 3}, "inputs/depth is 3"),
        ({"picture": "drawn.png", "depth_kind": "drawn"}, "inputs/depth_kind is 'drawn'"),
    ],
)
def test_inputs_that_cannot_be_read_are_one_message(
    folder: Path, capsys: pytest.CaptureFixture[str], inputs: object, words: str
) -> None:
    data = json.loads((folder / "things.json").read_text())
    (folder / "things.json").write_text(json.dumps({**data, "inputs": inputs}))
    assert run(["photo", "--again", str(folder)]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_an_earlier_result_stays_until_there_is_a_new_one_and_paid_answers_stay_always(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("exchanges.jsonl", "conversation.json", "boxes.json", "scene_1.json"):
        (folder / name).write_text("{}")
    seen, boxes = seen_from_above(TABLE)
    result = result_of(seen, known(seen, (boxes[0], TABLE)))

    def interrupted(given: PhotoInput, *_: Any, on_first: Callable[[PhotoResult], None], **__: Any) -> PhotoResult:
        on_first(replace(result, took_s={"first scene": 1.0}))
        raise KeyboardInterrupt

    def found(*_: Any, **__: Any) -> PhotoResult:
        return replace(result, made=replace(result.made, scene=None, refused="too narrow"))

    monkeypatch.setattr("executor.cli.commands.photo.read_photograph", lambda *_: result.given)
    monkeypatch.setattr("executor.photo.pipeline.reconstruct_scene", interrupted)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {"things.json", "photo.json", "scene.json"} < before.keys()
    again, anew = ["photo", "--again", str(folder)], ["photo", __file__, "--out", str(folder), "--force"]
    for command in (again, anew):
        assert run(command) == 130
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    monkeypatch.setattr("executor.photo.pipeline.reconstruct_scene", found)
    for command in (again, anew):
        assert run(command) == 1
        assert {path.name for path in folder.iterdir()} == before.keys() - {"scene.json", "scene_1.json"}
        kept = ("exchanges.jsonl", "conversation.json", "boxes.json")
        assert all((folder / name).read_bytes() == before[name] for name in kept)
    assert json.loads((folder / "photo.json").read_text())["things"].keys() == {"table_0"}


def test_a_hypothesis_is_read_back_from_its_data() -> None:
    drill = replace(shape("generic_box", (0.1, 0.2, 0.3)), entry=replace(CUP.entry, category="drill"))
    ajar = PoseHypothesis(TABLE.entry, 1.0, 2.0, 0.3, 0.0, (1.0, 0.6, 0.7)).with_parameters(top_thickness_m=0.03)
    for one in (drill, ajar):
        assert hypothesis_of(json.loads(json.dumps(one.to_json()))) == one


def test_photograph_outlines_and_scene_are_side_by_side() -> None:
    seen, (table, box) = seen_from_above(TABLE, BOWL)
    room = known(seen, (table, TABLE), (replace(box, label="bowl"), BOWL))
    picture = side_by_side(seen, room, scene_of(room, "drawn")[1].scene)
    assert picture.shape == (480, 1920, 3)
    photograph, outlined, drawn = np.split(picture.astype(int), 3, axis=1)
    assert 0.01 < (np.abs(outlined - photograph * 0.75).sum(axis=-1) > 60).mean() < 0.3
    assert np.abs(drawn - photograph).mean() > 5


def test_a_first_scene_is_there_at_once_and_ctrl_c_keeps_what_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    first: list[FittedRoom] = []
    room = known(seen, (boxes[0], TABLE))

    def fit(fitter: RoomFitter, index: int, bottoms_m: object, hidden_by: object) -> str:
        if index:
            raise KeyboardInterrupt
        return fitter.room.add_fit(0, room.things[0].fit)

    monkeypatch.setattr(RoomFitter, "fit", fit)
    said: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        reconstruct(seen, boxes, ())
    found = reconstruct(seen, boxes, (), Listener(said.append, first.append))
    assert [thing.fit.rough for thing in first[0].things] == [True, True] and not first[0].interrupted
    assert found.interrupted and [thing.fit.rough for thing in found.things] == [False, True]
    for thing, true in zip(found.things, (TABLE, BOWL), strict=True):
        assert math.dist((thing.fit.guess.x_m, thing.fit.guess.y_m), (true.x_m, true.y_m)) < 0.1
    assert first[0].things[1].fit.in_box > 0.5
    assert said[-1] == "fitting: porcelain_bowl, 2 of 2" or said[-1] == f"fitting: {boxes[1].label}, 2 of 2"


def raising(*_: Any, **__: Any) -> Any:
    """Press Ctrl-C."""
    raise KeyboardInterrupt


def test_ctrl_c_during_the_rough_fits_keeps_those_that_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    rough, first = RoomFitter.fit_roughly, list[FittedRoom]()
    fitted = known(seen, (boxes[0], TABLE)).things[0].fit

    def until_bowl(fitter: RoomFitter, index: int, bottoms_m: Any) -> None:
        if index:
            raise KeyboardInterrupt
        rough(fitter, index, bottoms_m)

    monkeypatch.setattr(RoomFitter, "fit", raising)
    with monkeypatch.context() as patched:
        patched.setattr(RoomFitter, "fit_roughly", until_bowl)
        found = reconstruct(seen, boxes, (), Listener(on_first=first.append))
        assert not first and found.interrupted and [thing.fit.rough for thing in found.things] == [True]
        assert [one.cause for one in found.unfitted] == [LostCause.NO_TIME]
        # The second Ctrl-C, among the rough fits of what was not fitted before the first one.
        found = reconstruct(seen, boxes, (), Listener(on_first=raising), kept={0: fitted})
        assert found.interrupted and [thing.fit for thing in found.things] == [fitted]
    found = reconstruct(seen, boxes, (), Listener(on_first=raising))
    assert found.interrupted and len(found.things) == 2


@pytest.mark.parametrize("step", ["scene_of", "variations_of"])
def test_ctrl_c_after_the_fits_keeps_them(folder: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    room = known(seen, (boxes[0], TABLE), (replace(boxes[1], label="bowl"), BOWL))
    given, kept = result_of(seen, room).given, list[PhotoResult]()
    monkeypatch.setattr("executor.photo.pipeline.reconstruct", lambda *_: room)
    monkeypatch.setattr(f"executor.photo.pipeline.{step}", raising)
    with pytest.raises(KeyboardInterrupt):
        reconstruct_scene(given)
    result = reconstruct_scene(given, on_first=kept.append, on_fitted=kept.append)
    assert result.found.interrupted and len(result.found.things) == 2 and result.varied == ()
    assert [len(one.found.things) for one in kept] == [2] and (result.made.scene is None) == (step == "scene_of")
    write_result(folder, result, {"picture": "drawn.png"})
    assert (folder / "scene.json").exists() == (step == "variations_of")
    assert sorted(read_earlier(folder).kept) == [0, 1]


def test_ctrl_c_before_anything_is_fitted_leaves_nothing_to_go_on_from(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, boxes = seen_from_above(TABLE)
    given = result_of(seen, known(seen, (boxes[0], TABLE))).given
    monkeypatch.setattr(RoomFitter, "fit_roughly", raising)
    with pytest.raises(KeyboardInterrupt):
        reconstruct_scene(given, on_first=lambda result: None)


def test_what_is_far_too_small_for_its_name_stands_where_it_is_measured() -> None:
    seen, (table, bowl) = seen_from_above(TABLE, BOWL)
    chair = replace(bowl, label="chair", category="chair")
    room = RoomEstimate(seen, (), (table, chair), 0.0)
    assert room.is_on_floor(0) and not room.is_on_floor(1)
    given = RoomEstimate(seen, (), (replace(table, on=1), replace(chair, on=FLOOR)), 0.0)
    assert not given.is_on_floor(0) and given.is_on_floor(1)


def write_photograph(folder: Path, seen: Observation, boxes: list[Detection]) -> list[str]:
    """Write a drawn picture as files, and return the words that reconstruct it."""
    Image.fromarray(seen.rgb).save(folder / "room.png")
    np.save(folder / "depth.npy", seen.z_m)
    K = [[seen.K.fx, 0.0, seen.K.cx], [0.0, seen.K.fy, seen.K.cy], [0.0, 0.0, 1.0]]
    (folder / "camera.json").write_text(json.dumps({"K": K}))
    things = [{"label": one.label, "box": list(one.box_px)} for one in boxes]
    (folder / "boxes.json").write_text(json.dumps({"source": "the test", "things": things}))
    words = ["photo", folder / "room.png", "--depth", folder / "depth.npy", "--camera", folder / "camera.json"]
    return [*map(str, words), "--boxes", str(folder / "boxes.json"), "--out", str(folder / "out")]


@pytest.mark.slow
@pytest.mark.physics
def test_a_reconstruction_goes_on_after_ctrl_c_and_after_corrections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words, out = write_photograph(tmp_path, *seen_from_above(TABLE, BOWL)), tmp_path / "out"
    real = RoomFitter.fit

    def until(index: int) -> Callable[..., str]:
        def fit(fitter: RoomFitter, at: int, *more: Any, **named: Any) -> str:
            if at == index:
                raise KeyboardInterrupt
            return real(fitter, at, *more, **named)

        return fit

    with monkeypatch.context() as patched:
        patched.setattr(RoomFitter, "fit", until(1))
        assert run(words) == 130
    told = capsys.readouterr()
    assert "1 of 2 things fitted, the others roughly" in told.err and f"photo --again {out}" in told.err
    assert "first scene of 2 rough fits" in told.err
    assert load_scene(out / "scene.json").objects.keys() >= {"table_0", "bowl_0"}
    monkeypatch.chdir("/")
    assert run(["photo", "--again", str(out)]) == 0
    assert "on table_0" in capsys.readouterr().out
    before = json.loads((out / "photo.json").read_text())["things"]
    assert not before["bowl_0"]["rough"] and before["bowl_0"]["model"] == "porcelain_bowl"
    corrected(out, bowl_0={"label": "dog dish", "size_m": [0.2, 0.2, 0.08]})
    assert run(["photo", "--again", str(out), "--json"]) == 0
    after = json.loads(capsys.readouterr().out)["things"]
    assert after["table_0"]["fit"] == before["table_0"]["fit"]
    assert after["dog_dish_0"]["size_m"] == [0.2, 0.2, 0.08] and after["dog_dish_0"]["stands_on"] == "table_0"
    scene = load_scene(out / "scene.json")
    assert scene.objects["dog_dish_0"].bbox_extent == pytest.approx((0.2, 0.2, 0.08))
    assert scene.robot.name == "panda-lift"
    assert run(["photo", "--again", str(out), "--boxes", "b.json"]) == 2 and run(["photo", "--out", str(out)]) == 2
