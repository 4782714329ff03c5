"""The report: valid HTML that needs no network, escapes what comes from outside, and tells why a run failed."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import oag
from executor.cli.execution import summary_lines
from executor.learn.evaluation import FAILURES
from executor.records import FailureKind, Peaks, Rollout
from executor.reports.episode import FAILURE_MEANINGS
from executor.reports.graph_picture import graph_picture
from executor.reports.html import style, value_text
from executor.reports.page import report_page
from executor.reports.run_folder import RunFolder
from executor.rollouts.run_record import RunRecord
from executor.scenes import library
from executor.sim.render.frames import Frames
from oag.measurements import TargetDrive, Unplanned, measurements_json
from tests.executor.recordings import invented_rollout

VOID = {"meta", "img", "br", "input", "link", "hr"}


class Outline(HTMLParser):
    """Collects elements and checks that they close in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("style", "script"):
            self.words.append(data)


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    parsed.close()
    assert parsed.open == []
    return parsed


def record_of(rollout: Rollout | None, **fields: object) -> RunRecord:
    planned = rollout or invented_rollout()
    graph = oag.compose(planned.task, scene=planned.scene)
    return RunRecord(graph, graph.verify(), rollout=rollout, **fields)  # type: ignore[arg-type]


def grey_frames(rollout: Rollout) -> Frames:
    count = len(rollout.trajectory.time_s)
    overview = np.full((count, 64, 64, 3), 90, np.uint8)
    return Frames({"global": overview, "head": np.zeros((count, 32, 32, 3), np.uint8)}, (32, 32))


@pytest.mark.parametrize("failed", [False, True])
def test_it_is_well_formed_and_needs_no_network(failed: bool, tmp_path: Path) -> None:
    rollout = invented_rollout(failed=failed)
    video = tmp_path / "video.mp4"
    video.write_bytes(b"moving pictures")
    page = report_page(record_of(rollout, query="do it"), grey_frames(rollout), video, [Path("task.json"), video])
    parsed = outline(page)
    for tag, attributes in parsed.elements:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        for name in ("src", "poster", "data", "srcset"):
            assert (attributes.get(name) or "data:").startswith("data:")
    links = [str(attributes["href"]) for tag, attributes in parsed.elements if "href" in attributes]
    # Links lead to a place in the page, or to a file beside it.
    assert {link for link in links if not link.startswith("#step-")} == {"task.json", "video.mp4"}
    assert not re.search("http(?!-equiv)", re.sub(r"data:[^'\"]*", "", page).replace("http://www.w3.org/2000/svg", ""))
    assert not re.search(r"url\(\s*['\"]?(?!#)|@import", page)
    sources = [a["src"] for tag, a in parsed.elements if tag == "video"]
    assert base64.b64decode(str(sources[0]).partition(",")[2]) == b"moving pictures"


def test_words_from_outside_cannot_become_markup() -> None:
    rollout = invented_rollout(failed=True)
    page = report_page(record_of(rollout, query="<script>alert(1)</script>", notes=("<img src=x>",)))
    parsed = outline(page)
    scripts = [attributes.get("type") for tag, attributes in parsed.elements if tag == "script"]
    assert scripts == ["application/json", None, None]
    assert not [tag for tag, _ in parsed.elements if tag == "img"]
    assert "<script>alert(1)</script>" in "".join(parsed.words)
    assert "the fingers closed on nothing <where> the glass should be" in "".join(parsed.words)


def test_the_library_of_templates_is_loaded_with_the_first_page() -> None:
    code = "import sys, executor.reports.page, executor.bench.tables; print('jinja2' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_failure_is_told_first_with_its_numbers() -> None:
    parsed = outline(report_page(record_of(invented_rollout(failed=True))))
    words = " ".join(" ".join(parsed.words).split())
    assert words.index("Why it failed") < words.index("1. open refrigerator")
    story = words[words.index("Why it failed") : words.index("1. open refrigerator")]
    for part in ("GRASP failed at", "grasp-missed", "opening [m]", "0.0004", "step 4 of subtask", "after CONVERGE"):
        assert part in story
    opened = [found.get("id") for tag, found in parsed.elements if tag == "details" and "open" in found]
    assert "step-1-3" in opened and not {"step-0-0", "step-1-2"} & set(opened)


def test_a_success_has_no_failure_story_and_lists_every_step() -> None:
    parsed = outline(report_page(record_of(invented_rollout())))
    words = " ".join(parsed.words)
    assert "Why it failed" not in words
    assert words.count("planned in") == 12
    steps = [found for tag, found in parsed.elements if tag == "details" and str(found.get("id")).startswith("step-")]
    assert len(steps) == 12 and not any("open" in found for found in steps)


def test_what_failed_is_shown_by_at_most_six_pictures_a_view() -> None:
    """Everything else is in the video, one click away from its step."""
    for failed in (False, True):
        rollout = invented_rollout(failed=failed)
        page = report_page(record_of(rollout), grey_frames(rollout))
        strips = page.split('<div class="strip">')[1:]
        assert len(strips) == 2 * failed
        assert all(1 <= strip.count("<img") <= 6 for strip in strips)


def test_pictures_have_their_place_before_they_are_loaded() -> None:
    rollout = invented_rollout(failed=True)
    pictures = [
        attributes
        for tag, attributes in outline(report_page(record_of(rollout), grey_frames(rollout))).elements
        if tag == "img"
    ]
    assert pictures and all((found["width"], found["height"]) == ("32", "32") for found in pictures)
    assert re.search(r"\.strip img\{[^}]*height:auto", style("page"))


def test_what_was_handled_at_another_size_is_said_once() -> None:
    said = "glass_0 is scaled by 0.71, from 70 x 70 x 120 to 50 x 50 x 85 mm"
    rollout = invented_rollout()
    for record in (record_of(rollout), record_of(rollout, notes=(said,))):
        header = report_page(record).partition("</header>")[0]
        assert header.count(f"<li>{said}</li>") == 1
    planned = oag.compose(rollout.task, scene=library.load("kitchen_t1"))
    assert f"<li>{said}</li>" in report_page(RunRecord(planned, planned.verify()))


def test_one_is_singular() -> None:
    rollout = invented_rollout()
    alone = record_of(
        replace(rollout, task=replace(rollout.task, subtasks=rollout.task.subtasks[:1]), subtasks=rollout.subtasks[:1])
    )
    assert "1 of 1 subtask reached, 7 steps" in " ".join(report_page(alone).split())
    assert any("1 of 1 subtask," in line for line, _ in summary_lines(alone, RunFolder(Path("r"))))


def test_the_summary_says_what_was_scaled() -> None:
    lines = [line for line, _ in summary_lines(record_of(invented_rollout()), RunFolder(Path("r")))]
    assert "scaled      glass_0 by 0.71" in lines


def test_a_plan_that_did_not_run_still_has_a_report() -> None:
    words = " ".join(outline(report_page(record_of(None, query="never"))).words)
    assert "not executed" in words and "1. open refrigerator" not in words
    assert "goal/not-reached" in words  # Two of the four subtasks are missing from this task on purpose.


def test_the_certificate_is_there_in_words() -> None:
    words = " ".join(outline(report_page(record_of(invented_rollout()))).words)
    assert "confirmed by the independent checker" in words
    assert "T1 step 1 NAVIGATE_TO_TARGET" in words


def test_the_reproduction_block_has_command_seed_hash_and_versions() -> None:
    rollout = invented_rollout()
    words = " ".join(outline(report_page(record_of(rollout, command="scene2demo run 'x'"))).words)
    for part in ("scene2demo run 'x'", rollout.state_hash, "numpy", "python"):
        assert part in words


def test_every_kind_of_failure_has_its_meaning() -> None:
    assert set(FAILURE_MEANINGS) == {kind.value for kind in FailureKind} | set(FAILURES)


def test_the_graph_has_a_box_a_step_and_an_arrow_an_edge() -> None:
    rollout = invented_rollout(failed=True)
    graph = oag.compose(rollout.task, scene=rollout.scene)
    svg = ET.fromstring(graph_picture(graph, rollout))
    boxes = svg.findall(".//rect")
    assert len(boxes) == len(graph.nodes) == 12
    assert [box.get("class") for box in boxes].count("node failed") == 1
    assert [box.get("class") for box in boxes].count("node done") == 10
    arrows = [path.get("class") or "" for path in svg.findall("./path")]
    assert len(arrows) == len(graph.edges)
    assert sum("transfer" in names for names in arrows) == 1


def test_boxes_do_not_overlap_and_stay_inside() -> None:
    rollout = invented_rollout()
    svg = ET.fromstring(graph_picture(oag.compose(rollout.task, scene=rollout.scene)))
    _, _, width, height = map(float, str(svg.get("viewBox")).split())
    places = [tuple(float(str(box.get(k))) for k in ("x", "y", "width", "height")) for box in svg.findall(".//rect")]
    for index, (x, y, w, h) in enumerate(places):
        assert x >= 0 and x + w <= width and y >= 0 and y + h <= height
        for x2, y2, w2, h2 in places[:index]:
            assert x >= x2 + w2 or x2 >= x + w or y >= y2 + h2 or y2 >= y + h


def test_the_page_tells_what_was_asked_of_the_robot() -> None:
    asked = Peaks(
        base_n=312.0, base_m_s=0.5, base_m_s2=2.4, shoulder_nm=18.25, wrist_nm=2.5, arm_rad_s=1.1, finger_n=30.0
    )
    words = " ".join(outline(report_page(record_of(replace(invented_rollout(), peaks=asked)))).words)
    assert "The most that was asked of the robot" in words
    assert "312 N, 0.50 m/s, 2.4 m/s2" in words and "18.2 and 2.5 N m, 1.1 rad/s" in words
    assert "asked of the robot" not in "".join(outline(report_page(record_of(None))).words)


@pytest.mark.parametrize("lost", [float("inf"), float("-inf"), float("nan")])
def test_no_number_that_is_none_gets_into_files_or_the_page(lost: float) -> None:
    record = TargetDrive(base_x_m=lost, base_y_m=0.25, base_yaw_deg=lost, joint_margin_deg=1.0, legs=2)
    assert measurements_json((record,)) == {"base_y_m": 0.25, "joint_margin_deg": 1.0, "legs": 2}
    assert measurements_json((Unplanned(residual_m=lost, near=("a",)),)) == {"near": ["a"]}
    assert value_text(lost) == "none" and value_text([1.0, lost]) == "1, none"
