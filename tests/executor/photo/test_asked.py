"""A vision-language model in place of a file of boxes, over the wire: what it says becomes things, or a clear end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.assets.library import LIBRARY
from executor.cli.app import run
from executor.cli.commands.photo import read_photograph
from executor.cli.options import PhotoInputs
from executor.photo.fitting.refinement import with_parts
from executor.photo.inputs.annotations import FLOOR
from executor.photo.perception import FoundBox, model_detector, sent_picture, to_detections
from executor.photo.pipeline import PhotoInput
from executor.photo.room.reconstruct import reconstruct
from llm import Conversation, connect
from llm.client.profiles import BoxForm
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.llm.live import KEY, KEY_VARIABLE, hurry
from tests.llm.model_server import Act, ModelServer, fails, replies
from tests.llm.vision.spotter import Spotter, pattern_answer

MODEL = "openai-compatible:seer"
SIZE = (320, 240)
THINGS = [
    ("cup", (0.4, 0.3, 0.5, 0.5), {"on": 2}),
    ("couch", (0.2, 0.4, 0.9, 0.9), {"on": 0, "doors": 0, "drawers": 1}),
    ("sofa", (0.21, 0.4, 0.9, 0.9), {}),
    ("plant", (0.0, 0.0, 0.2, 0.5), {}),
]


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A picture of nothing but a floor, 1.4 m under a camera that looks straight ahead."""
    Image.new("RGB", SIZE, (90, 120, 60)).save(tmp_path / "room.png")
    width, height = SIZE
    focal_px = width / 2 / np.tan(np.radians(30.0))
    below_px = np.arange(height) + 0.5 - height / 2
    depth_m = np.where(below_px > height / 4, 1.4 * focal_px / np.maximum(below_px, 1.0), 0.0)
    np.save(tmp_path / "depth.npy", np.tile(depth_m[:, None], (1, width)))
    return tmp_path / "room.png"


def point_to(server: ModelServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make this process talk to a server on this machine."""
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    hurry(monkeypatch)


def read(picture: Path, model: str, record: Path | None = None) -> PhotoInput:
    """Return what is read of the picture when a model finds the things."""
    beside = PhotoInputs(depth=picture.with_name("depth.npy"), camera="hfov=60")
    return read_photograph(picture, beside, model_detector(connect(model, record=record), Conversation(model, "", "")))


@pytest.mark.parametrize("form", ["thousandths yxyx", "pixels xywh"])
def test_what_a_model_sees_is_the_same_in_every_form_and_replayed(
    picture: Path, monkeypatch: pytest.MonkeyPatch, form: BoxForm
) -> None:
    recording = picture.with_name("exchanges.jsonl")
    with ModelServer(decide=Spotter(THINGS, form), key=KEY) as server:
        point_to(server, monkeypatch)
        given = read(picture, MODEL, recording)
        assert len(server.seen) == 3, "the pattern, the picture, and once more since it has no word for a plant"
    cup, couch = given.detections
    assert (cup.category, couch.category) == ("cup", "sofa"), "two names of one thing are one thing"
    assert cup.box_px == pytest.approx((128, 72, 160, 120), abs=1.0)
    assert (cup.on, couch.on, couch.drawers, cup.drawers) == (1, FLOOR, 1, None)
    assert cup.source.startswith("seer, boxes in ") and form in cup.source
    assert [(one.label, "nothing of the category" in one.reason) for one in given.left_out] == [("plant", True)]
    assert read(picture, f"replay:{recording}").sha256 == given.sha256
    assert KEY not in recording.read_text()


def photo(picture: Path, *more: str) -> int:
    """Run the command on the picture and returns its exit code."""
    words = [
        "--depth",
        str(picture.with_name("depth.npy")),
        "--camera",
        "hfov=60",
        "--out",
        str(picture.parent / "out"),
    ]
    return run(["photo", str(picture), *words, *more])


ENDS = {
    "no JSON": ([replies("I would rather not.")], 1, "the spotter"),
    "cut off": (
        [replies("{", fields={"choices": [{"message": {"content": '{"things": ['}, "finish_reason": "length"}]})],
        1,
        "limit of tokens",
    ),
    "too long": ([Act(body=b'{"choices": "' + b"x" * 4_100_000)], 1, "longer than 4000000 bytes"),
    "not on the pattern": (
        [
            replies(
                json.dumps({"things": [{"label": c, "box": [1, 1, 9, 9]} for c in ("red", "green", "blue", "black")]})
            )
        ],
        1,
        "not on the rectangles",
    ),
    "nothing seen": (
        [replies(json.dumps(pattern_answer("pixels xyxy"))), replies('{"things": []}')],
        2,
        "nothing in it was recognised",
    ),
    "only strange things": (
        [
            replies(json.dumps(pattern_answer("pixels xyxy"))),
            replies(json.dumps({"things": [{"number": 1, "label": "aquarium", "box": [9, 9, 90, 90]}]})),
        ],
        2,
        "aquarium: the library has nothing",
    ),
    "wrong form": (
        [
            replies(json.dumps(pattern_answer("shares xyxy"))),
            replies(json.dumps({"things": [{"number": 1, "label": "cup", "box": [90, 90, 190, 190]}]})),
        ],
        1,
        "not in the picture",
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_an_answer_that_cannot_be_used_ends_in_one_message(
    picture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    acts, code, words = ENDS[name]
    with ModelServer(*acts, key=KEY) as server:
        point_to(server, monkeypatch)
        assert photo(picture, "--model", MODEL) == code
    said = " ".join(capsys.readouterr().err.split())
    assert words in said and KEY not in said and "Traceback" not in said
    assert not (picture.parent / "out" / "scene.json").exists()
    story = json.loads((picture.parent / "out" / "conversation.json").read_text())
    assert story["query"] == "what is in room.png" and (picture.parent / "out" / "exchanges.jsonl").is_file()
    # The same end again, without a server.
    recording = f"replay:{picture.parent / 'out' / 'exchanges.jsonl'}"
    for _ in range(2):
        assert photo(picture, "--model", recording, "--force") == code
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_photograph_goes_on_with_what_was_answered_and_force_keeps_it(
    picture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    strange = replies(json.dumps({"things": [{"number": 1, "label": "aquarium", "box": [9, 9, 90, 90]}]}))
    pattern = replies(json.dumps(pattern_answer("pixels xyxy")))
    out = picture.parent / "out"
    with ModelServer(pattern, fails(400, "no"), strange, strange, pattern, strange, strange, key=KEY) as server:
        point_to(server, monkeypatch)
        assert photo(picture, "--model", MODEL) == 1
        told = capsys.readouterr().err
        assert "the spotter, round 1" in told and "price unknown" in told and "2 requests, 1 failed" in told
        assert photo(picture, "--model", MODEL) == 2 and "--resume" in capsys.readouterr().err
        assert photo(picture, "--model", MODEL, "--resume") == 2
        assert len(server.seen) == 4 and "paid" in capsys.readouterr().err
        before = (out / "exchanges.jsonl").read_bytes()
        assert photo(picture, "--model", MODEL, "--force") == 2
        assert len(server.seen) == 7
    assert (out / "exchanges_2.jsonl").read_bytes() == before
    assert f"kept in {out / 'exchanges_2.jsonl'}" in capsys.readouterr().err


def test_nothing_is_asked_before_all_else_has_been_read(
    picture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModelServer(key=KEY) as server:
        point_to(server, monkeypatch)
        assert photo(picture, "--model", MODEL, "--boxes", "b.json") == 2
        assert "one of --boxes, --detector and --model" in capsys.readouterr().err
        np.save(picture.with_name("depth.npy"), np.full((10, 10), 2.5))
        assert photo(picture, "--model", MODEL) == 2
        assert "10 x 10" in capsys.readouterr().err
        assert not server.seen and not (picture.parent / "out").exists()
    assert photo(picture, "--model", "opnai:gpt-5.2") == 2
    assert "openai" in capsys.readouterr().err


def test_a_picture_is_sent_small_enough_and_in_whole_patches() -> None:
    sent, size = sent_picture(np.zeros((3000, 4000, 3), np.uint8))
    assert size == (1568, 1176) and sent.media_type == "image/jpeg"
    assert sent_picture(np.zeros((100, 90, 3), np.uint8))[1] == (84, 112)


def test_of_boxes_of_one_thing_the_surest_stays() -> None:
    boxes = [
        FoundBox("cup", (10, 10, 50, 50), 0.5, on=2),
        FoundBox("bowl", (11, 10, 51, 50), 0.9, on=3),
        FoundBox("rug", (0, 0, 100, 20), 0.9),
        FoundBox("table", (-5, 30, 120, 90), 0.8),
        FoundBox("person", (60, 0, 80, 90), 0.7),
        FoundBox("mug", (99.0, 10, 140, 50), 0.7),
    ]
    found = to_detections(boxes, (100, 80), "the test")
    assert [one.label for one in found.things] == ["bowl", "table"]
    assert found.things[0].on == 1 and found.things[1].box_px == (0.0, 30.0, 100.0, 80.0)
    assert [one.label for one in found.left_out] == ["person"]
    assert replace(found.things[0], on=None).score == 0.9


def test_models_are_told_apart_by_how_many_doors_and_drawers_they_can_have() -> None:
    cabinets = [entry for entry in LIBRARY.values() if entry.category == "bottom_cabinet"]
    told = {
        (0, 3): ["cabinet_drawers"],
        (2, 0): ["cabinet_two_doors"],
        (2, 2): ["cabinet_drawers_doors"],
        (1, None): ["cabinet_one_door"],
        (9, 9): [entry.model for entry in cabinets],
        (None, None): [entry.model for entry in cabinets],
    }
    for (doors, drawers), models in told.items():
        assert [entry.model for entry in with_parts(cabinets, doors, drawers)] == models


@pytest.mark.slow
@pytest.mark.parametrize(("on", "bottom_m"), [(0, TABLE.size_m[2]), (FLOOR, 0.0)])
def test_without_depth_a_thing_is_sought_on_what_it_is_said_to_stand_on(on: int, bottom_m: float) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    flat = replace(seen, z_m=np.zeros_like(seen.z_m), heading_rad=TABLE.yaw_rad)
    found = reconstruct(flat, [boxes[0], replace(boxes[1], on=on)], ())
    assert found.things[1].fit.guess.bottom_m == pytest.approx(bottom_m, abs=0.15)


@pytest.mark.slow
@pytest.mark.physics
def test_a_room_is_reconstructed_from_what_a_model_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    width, height = seen.size_px
    Image.fromarray(seen.rgb).save(tmp_path / "room.png")
    np.save(tmp_path / "depth.npy", seen.z_m)
    K = [[seen.K.fx, 0.0, seen.K.cx], [0.0, seen.K.fy, seen.K.cy], [0.0, 0.0, 1.0]]
    (tmp_path / "camera.json").write_text(json.dumps({"K": K}))
    things = [
        (one.label, tuple(side / (width, height)[axis % 2] for axis, side in enumerate(one.box_px)), {"on": on})
        for one, on in zip(boxes, (0, 1), strict=True)
    ]
    words = ["photo", tmp_path / "room.png", "--depth", tmp_path / "depth.npy", "--camera", tmp_path / "camera.json"]
    command = [*map(str, words), "--json", "--out"]
    with ModelServer(decide=Spotter(things, "thousandths yxyx"), key=KEY) as server:
        point_to(server, monkeypatch)
        assert run([*command, str(tmp_path / "live"), "--model", MODEL]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["things"]["bowl_0"]["given"] == {"doors": None, "drawers": None, "on": "table_0", "size_m": None}
    assert told["things"]["table_0"]["model"] == "table_four_legs" and told["left_out"] == []
    scene = json.loads((tmp_path / "live" / "scene.json").read_text())
    assert "(ontop bowl_0 table_0)" in scene["facts"]
    assert scene["provenance"]["bowl_0"]["category"].startswith("seer, boxes in thousandths yxyx")
    recording = f"replay:{tmp_path / 'live' / 'exchanges.jsonl'}"
    assert run([*command, str(tmp_path / "again"), "--model", recording]) == 0
    assert (tmp_path / "again" / "scene.json").read_bytes() == (tmp_path / "live" / "scene.json").read_bytes()
