"""What a model sees in a picture: boxes in any form are read right, and bad answers are not taken."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from llm.client.budget import Metered
from llm.client.profiles import BoxForm, find_profile
from llm.client.recording import Recorder, Replay
from llm.client.transport import ChatReply, Image
from llm.errors import ModelError, ReplayMissing
from llm.structured.conversation import AnswersRefused, Conversation
from llm.vision import (
    FORMS,
    LEAST_OVERLAP,
    MOST_THINGS,
    RECTANGLES_PX,
    SIZE_PX,
    Rectangles,
    Spotted,
    agreement,
    box_px,
    draw_pattern,
    overlap,
    spot,
)
from tests.llm.scripted import Scripted
from tests.llm.vision.spotter import pattern_answer, written

SIZE = (840, 616)
PICTURE = Image(b"\xff\xd8\xff any picture", "image/jpeg")
CUP = (100.0, 200.0, 160.0, 280.0)
TABLE = (60.0, 250.0, 700.0, 600.0)


def thing(number: int, label: str, box: tuple[float, ...], form: BoxForm = "thousandths xyxy", **more: Any) -> Any:
    """Return one thing of an answer."""
    x0, y0, x1, y1 = box
    return {"number": number, "label": label, "box": written((x0, y0, x1, y1), form, SIZE), **more}


def right(form: BoxForm = "thousandths xyxy") -> dict[str, Any]:
    """Return the answer that is right: a cup on a table."""
    return {"things": [thing(4, "cup", CUP, form, on=9), thing(9, "table", TABLE, form, doors=0, drawers=2, on=0)]}


def spotted(*answers: object, form: BoxForm = "thousandths xyxy", boxes: BoxForm | None = None) -> tuple[Spotted, Any]:
    """Return what is taken of a model's answers after the one to the pattern, and what it was asked."""
    script = Scripted(json.dumps(pattern_answer(form)), *(a if isinstance(a, str) else json.dumps(a) for a in answers))
    return look(Metered(script, boxes=boxes or form)), script


def look(model: Metered) -> Spotted:
    """Return what a model sees in the picture; cups and tables are known."""
    unknown = {"cupp": "there is no 'cupp'; near it: cup"}.get
    return spot(model, PICTURE, SIZE, ["cup", "table"], unknown, Conversation("m", "what is in it", "room"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("off_px", [0.0, 8.0])
def test_the_pattern_tells_every_form_from_the_others(form: BoxForm, off_px: float) -> None:
    shares = agreement(Rectangles.model_validate(pattern_answer(form, off_px)))
    (best, share), (_, next_share), *_ = shares.items()
    assert best == form and share > LEAST_OVERLAP and next_share < 0.25


def test_the_pattern_is_the_same_picture_every_time() -> None:
    assert draw_pattern().sha256 == draw_pattern().sha256 and draw_pattern().data.startswith(b"\x89PNG")
    assert all(box[2] <= SIZE_PX[0] and box[3] <= SIZE_PX[1] for box in RECTANGLES_PX.values())


@pytest.mark.parametrize("form", FORMS)
def test_boxes_are_read_in_the_form_that_the_pattern_shows(form: BoxForm) -> None:
    # It is asked for thousandths, and does what it was trained to.
    found, script = spotted(right(form), form=form, boxes="thousandths xyxy")
    assert found.form == form and found.agreement > 0.95
    assert [one.label for one in found.things] == ["cup", "table"]
    assert overlap(found.things[0].box_px, CUP) > 0.95 and overlap(found.things[1].box_px, TABLE) > 0.95
    assert (found.things[0].on, found.things[1].on, found.things[1].drawers) == (1, -1, 2)
    assert found.things[0].doors is None
    assert "thousandths of the picture" in script.asked[0].messages[0].parts[0]


def test_a_model_is_asked_for_the_form_of_its_profile() -> None:
    assert find_profile("gemini:gemini-2.5-pro").boxes == "thousandths yxyx"
    _, script = spotted(right("thousandths yxyx"), form="thousandths yxyx")
    assert all("[top, left, bottom, right]" in asked.messages[0].parts[0] for asked in script.asked)


def test_a_list_and_the_names_that_models_were_trained_on_are_read() -> None:
    trained = [{"number": 1, "label": "cup", "box_2d": written(CUP, "thousandths xyxy", SIZE)}]
    found, _ = spotted(f"```json\n{json.dumps(trained)}\n```")
    assert overlap(found.things[0].box_px, CUP) > 0.95


def outside(by: float) -> dict[str, Any]:
    """Return an answer whose cup is moved to the right by a share of the picture."""
    return {"things": [thing(1, "cup", (CUP[0] + by * SIZE[0], CUP[1], CUP[2] + by * SIZE[0], CUP[3]))]}


BAD = {
    "no JSON": ("I see a cup on a table.", "answer/no-json"),
    "cut off": (json.dumps(right())[:60], "answer/broken-json"),
    "outside": (outside(1.2), "answer/box"),
    "pixels all at once": (
        right("pixels xyxy") | {"things": [thing(1, "cup", (1100.0, 90.0, 1200.0, 300.0))]},
        "answer/box",
    ),
    "no width": ({"things": [thing(1, "cup", (100.0, 200.0, 100.0, 280.0))]}, "answer/box"),
    "three numbers": ({"things": [{"number": 1, "label": "cup", "box": [1, 2, 3]}]}, "answer/field"),
    "words for numbers": ({"things": [{"number": 1, "label": "cup", "box": ["1", "2", "3", "4"]}]}, "answer/field"),
    "one number twice": ({"things": [thing(1, "cup", CUP), thing(1, "table", TABLE)]}, "answer/numbering"),
    "endless": ({"things": [thing(1, "cup", CUP)] * (MOST_THINGS + 1)}, "answer/field"),
    "many doors": ({"things": [thing(1, "table", TABLE, doors=10**9)]}, "answer/field"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_answer_is_never_taken_and_asked_about(name: str) -> None:
    bad, code = BAD[name]
    found, script = spotted(bad, right())
    assert [one.label for one in found.things] == ["cup", "table"]
    assert code.partition("/")[2] and code in script.asked[2].messages[-1].parts[0]
    with pytest.raises(AnswersRefused, match="the spotter") as caught:
        spotted(bad)
    assert caught.value.findings[-1].code == code


@pytest.mark.parametrize(
    ("doubtful", "code"),
    [
        ({"things": [thing(1, "cupp", CUP)]}, "answer/label"),
        ({"things": [thing(1, "cup", CUP, on=7)]}, "answer/support"),
        ({"things": [thing(1, "cup", CUP, on=1)]}, "answer/support"),
        ({"things": []}, "answer/nothing"),
    ],
)
def test_what_is_doubtful_is_asked_about_once(doubtful: dict[str, Any], code: str) -> None:
    found, script = spotted(doubtful)
    assert len(script.asked) == 3 and code in script.asked[2].messages[-1].parts[0]
    assert len(found.things) == len(doubtful["things"]) and all(one.on is None for one in found.things)


@pytest.mark.parametrize(
    "answer",
    [
        {"things": []},
        {"things": [{"label": "red", "box": [1, 1, 9, 9]}]},
        {"things": [{"label": colour, "box": [10, 10, 20, 20]} for colour in RECTANGLES_PX]},
    ],
)
def test_a_model_that_does_not_find_the_rectangles_is_not_asked_for_things(answer: dict[str, Any]) -> None:
    script = Scripted(json.dumps(answer))
    with pytest.raises(AnswersRefused, match="the spotter"):
        look(Metered(script, boxes="pixels xyxy"))
    assert all("test pattern" in asked.messages[0].parts[0] for asked in script.asked)


def test_a_box_that_reaches_a_little_over_the_border_is_cut() -> None:
    found, _ = spotted({"things": [thing(1, "table", (-20.0, 250.0, 700.0, 630.0))]})
    assert found.things[0].box_px == pytest.approx((0.0, 250.0, 700.0, 616.0), abs=1.0)


def test_a_recording_is_replayed_without_knowing_whose_it_was(tmp_path: Path) -> None:
    script = Scripted(
        *(ChatReply(json.dumps(a), model="seer-1") for a in (pattern_answer("pixels yxyx"), right("pixels yxyx")))
    )
    live = Metered(Recorder(script, tmp_path / "r.jsonl"), boxes="pixels yxyx")
    found = look(live)
    replay = Metered(Replay(tmp_path / "r.jsonl"))
    assert look(replay) == found and replay.answered_by == live.answered_by == "seer-1"
    with pytest.raises(ReplayMissing):
        look(Metered(Replay(tmp_path / "r.jsonl"), boxes="shares xywh"))
    (tmp_path / "empty.jsonl").write_text("")
    with pytest.raises(ReplayMissing, match="empty"):
        look(Metered(Replay(tmp_path / "empty.jsonl")))


def test_a_model_that_does_not_answer_ends_it() -> None:
    with pytest.raises(ModelError, match="gone"):
        look(Metered(Scripted(ModelError("m", "it is gone")), boxes="pixels xyxy"))


def test_boxes_are_scaled_to_the_picture() -> None:
    assert box_px([500, 250, 750, 1000], "thousandths yxyx", (200, 100)) == pytest.approx((50.0, 50.0, 200.0, 75.0))
    assert box_px([0.5, 0.25, 0.25, 0.5], "shares xywh", (200, 100)) == pytest.approx((100.0, 25.0, 150.0, 75.0))
