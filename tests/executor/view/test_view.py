"""The viewer through its doors: tables of all kinds of folders, details, the server, and the command."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executor.cli.app import run
from executor.reports.episode import episode_section
from executor.reports.html import script_json
from executor.reports.run_folder import RunFolder
from executor.reports.series import MOST_POINTS, motion_plots
from executor.rollouts.run_record import RunRecord
from executor.scenes import library
from executor.system.files import read_json, write_json
from executor.view.page import link_from, listing_of, viewer_page
from executor.view.records import Listing, NothingToView
from executor.view.scene_view import scene_page
from executor.view.server import ViewServer
from executor.view.stores import INDEX, StoreListing
from oag import Task, compose
from tests.executor.recordings import invented_rollout

WRITTEN = Path(__file__).parents[2] / "data" / "written_by_0_1_0" / "store"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return shutil.copytree(WRITTEN, tmp_path / "store")


@pytest.fixture
def finished_run(tmp_path: Path) -> Path:
    rollout = invented_rollout(failed=True)
    graph = compose(rollout.task, scene=rollout.scene)
    folder = RunFolder.prepare(tmp_path / "run")
    folder.write_rollout(RunRecord(graph, graph.verify(), rollout=rollout))
    folder.write_episode(rollout, None)
    return folder.path


@contextmanager
def served(listing: Listing | None, page: str = "page") -> Iterator[ViewServer]:
    with ViewServer({"/": lambda: page}, listing) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join(10)


def get(server: ViewServer, path: str, **headers: str) -> tuple[HTTPResponse, bytes]:
    connection = HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def links_of(section: str) -> dict[str, str]:
    """Return the links of an episode's files by their names."""
    _, _, files = section.partition("<p class='row files'>")
    return {name: address for address, name in re.findall(r"<a href='([^']*)'>([^<]*)</a>", files)}


def test_a_store_s_table_is_read_once_and_again_where_it_changed(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = StoreListing(store).rows()
    assert [row.ended for row in first] == ["succeeded"] and first[0].task and first[0].steps and first[0].bytes
    lines = (store / INDEX).read_text().splitlines()
    assert [json.loads(line)["row"]["name"] for line in lines] == [row.name for row in first]
    with monkeypatch.context() as patch:
        patch.setattr("executor.view.stores.row_of", lambda episode: pytest.fail("read again"))
        assert StoreListing(store).rows() == first
    unit = store / "units" / first[0].name
    meta = read_json(unit / "unit.json")
    write_json(unit / "unit.json", meta | {"ended": "failed", "failure": {"kind": "slipped", "message": "x"}})
    assert [(row.ended, row.failure) for row in StoreListing(store).rows()] == [("failed", "slipped")]
    shutil.rmtree(unit)
    assert StoreListing(store).rows() == () and (store / INDEX).read_text() == ""


@pytest.mark.parametrize("content", ["{", "[]\n", '{"name": 3}\n', '{"modified_ns": 1}\n', "\0\n"])
def test_a_damaged_index_is_written_again(store: Path, content: str) -> None:
    expected = StoreListing(store).rows()
    (store / INDEX).write_text(content)
    assert StoreListing(store).rows() == expected
    assert StoreListing(store).rows() == expected and json.loads((store / INDEX).read_text().splitlines()[0])


def test_details_have_steps_with_their_proof_and_curves(store: Path) -> None:
    listing = listing_of(store)
    row = listing.rows()[0]
    detail = listing.detail(row.name)
    assert detail.row == row and detail.verdict == "proved" and detail.plots is not None and detail.scene is not None
    steps = [step for part in detail.subtasks for step in part.steps]
    assert len(steps) == row.steps and all(step.end_s is not None for step in steps)
    # Every grasp needs an approach before it, and the proof names the step that brings it.
    assert any(needs for step in steps for needs in step.needs)
    times = detail.plots.time_s
    assert len(times) == len(detail.plots.base_m) <= MOST_POINTS
    assert all(len(line) == len(times) for plot in detail.plots.plots for line in plot.lines.values())
    assert "samples.xz" in {file.name for file in detail.files}


@pytest.mark.parametrize("name", ["nothing", "..", ".", "", "../units", "/etc/passwd", "a/b"])
def test_an_episode_that_is_not_there_is_named(store: Path, name: str) -> None:
    with pytest.raises(NothingToView):
        listing_of(store).detail(name)


def test_a_failed_run_shows_where_it_failed(finished_run: Path) -> None:
    listing = listing_of(finished_run)
    (row,) = listing.rows()
    assert (row.ended, row.name) == ("failed", "run") and row.failure
    detail = listing.detail("run")
    failed = [step for part in detail.subtasks for step in part.steps if step.failure is not None]
    assert [step.failure[0] for step in failed if step.failure] == [row.failure] and detail.message
    assert detail.plots is not None


def test_a_damaged_run_hides_no_other(finished_run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(finished_run, folder / "seed_00000")
    (folder / "seed_00001").mkdir()
    (folder / "seed_00001" / "rollout.json").write_text('{"task": "a')
    assert [row.ended for row in listing_of(folder).rows()] == ["failed", "unreadable"]


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NothingToView, match=r"dataset\.json \(a store\)"):
        listing_of(tmp_path)


@given(st.data())
def test_distances_are_those_of_brute_force(data: st.DataObject) -> None:
    scene = library.load("kitchen_t1")
    parts: list[dict[str, Any]] = [
        {"target": "glass_0", "support_init": "table_0", "support_goal": "refrigerator_0"},
        {"target": "refrigerator_0", "support_init": None, "support_goal": None},
    ]
    described = {"task_activity_name": "a", "task_detail_message": "b", "goal": "(open refrigerator_0)"}
    made = {"task_activity_name": "c", "task_detail_message": "d", "init": "(open refrigerator_0)"}
    task = Task.from_json(
        {**described, "sub_tasks": [{**made, "goal": "(open refrigerator_0)", **part} for part in parts]}, scene=scene
    )
    count = data.draw(st.integers(1, 5))
    numbers = st.floats(-3, 3, width=32)
    points = np.array(data.draw(st.lists(st.tuples(*[numbers] * 6), min_size=count, max_size=count)), np.float32)
    running = np.array(data.draw(st.lists(st.integers(0, 1), min_size=count, max_size=count)), np.int32)
    arrays: dict[str, Any] = {
        "time_s": np.arange(count) / 10,
        "subtask": running,
        "robot_qpos": np.zeros((count, 12)),
        "robot_qvel": np.zeros((count, 12)),
        "robot_target": np.zeros((count, 12)),
        "eef_pose": np.hstack([points[:, :3], np.zeros((count, 4))]),
        "object_poses": np.hstack([points[:, 3:], np.zeros((count, 4))]),
        "joint_positions": np.zeros((count, 0)),
    }
    lines = motion_plots(arrays, task, scene, ["glass_0"], []).plots[0].lines
    for row in range(count):
        glass = points[row, 3:].tolist()
        at = glass if running[row] == 0 else list(scene["refrigerator_0"].position)
        assert lines["hand to target"][row] == pytest.approx(math.dist(points[row, :3].tolist(), at), abs=1e-3)
        if "target to its goal" not in lines:
            assert running.all()
        elif running[row]:
            assert lines["target to its goal"][row] is None
        else:
            # The refrigerator of this scene stands along the axes, or turned by a right angle.
            thing = scene["refrigerator_0"]
            w, _, _, z = thing.orientation
            x, y, height = thing.extent_m
            half = (x / 2, y / 2) if abs(w * z) < 0.1 else (y / 2, x / 2)
            gaps = [abs(a - b) - h for a, b, h in zip(glass, thing.position, (*half, height / 2), strict=True)]
            expected = math.hypot(*[max(gap, 0.0) for gap in gaps])
            assert lines["target to its goal"][row] == pytest.approx(expected, abs=1e-3)


def test_the_server_gives_the_page_details_and_parts_of_files(store: Path) -> None:
    listing = listing_of(store)
    (row,) = listing.rows()
    with served(listing, viewer_page(listing, [row])) as server:
        answer, body = get(server, "/")
        assert answer.status == 200 and row.name in body.decode()
        assert "connect-src" not in answer.headers["Content-Security-Policy"]
        answer, body = get(server, f"/episode/{row.name}")
        assert answer.status == 200 and row.name in body.decode()
        links = links_of(body.decode())
        content = (store / "units" / row.name / "samples.xz").read_bytes()
        assert get(server, links["samples.xz"])[1] == content
        answer, body = get(server, links["samples.xz"], Range="bytes=5-9")
        assert (answer.status, body) == (206, content[5:10])
        assert answer.headers["Content-Range"] == f"bytes 5-9/{len(content)}"
        assert get(server, links["samples.xz"], Range="bytes=7-")[1] == content[7:]
        assert get(server, links["samples.xz"], Range=f"bytes={len(content)}-")[1] == content
        answer, body = get(server, f"/scene/{row.name}")
        assert answer.status == 200 and b"<html" in body[:300].lower()


@pytest.mark.parametrize(
    "path",
    [
        "/episode/nothing",
        "/file/{name}/0/dataset.json",
        "/file/{name}/99/samples.xz",
        "/file/{name}/0/..%2f..%2fdataset.json",
        "/file/..%2f..%2f/x",
        "/file/{name}/0/%2fetc%2fpasswd",
        "/elsewhere",
        "/scene/",
        "//etc/passwd",
    ],
)
def test_the_server_gives_nothing_else(store: Path, path: str) -> None:
    listing = listing_of(store)
    with served(listing) as server:
        answer, body = get(server, path.format(name=listing.rows()[0].name))
        assert answer.status == 404 and b"root:" not in body


def test_only_this_machine_s_names_are_answered(store: Path) -> None:
    with served(listing_of(store)) as server:
        assert server.server_address[0] == "127.0.0.1"
        assert get(server, "/", Host="example.org")[0].status == 404
        assert get(server, "/", Host="localhost:1")[0].status == 200


def test_a_damaged_episode_does_not_end_the_server(store: Path) -> None:
    listing = listing_of(store)
    (row,) = listing.rows()
    (store / "units" / row.name / "samples.xz").write_bytes(b"no samples")
    with served(listing) as server:
        answer, body = get(server, f"/episode/{row.name}")
        assert answer.status == 500 and b"samples" in body
        assert get(server, "/")[0].status == 200


def test_words_of_a_store_cannot_end_the_script(store: Path) -> None:
    assert "<" not in script_json({"task": "</script><script>alert(1)</script>", "b": "<!--"})
    listing = listing_of(store)
    (row,) = listing.rows()
    unit = store / "units" / row.name / "unit.json"
    write_json(unit, read_json(unit) | {"query": "</script><b>x"})
    page = viewer_page(listing, listing_of(store).rows())
    assert "</script><b>" not in page and "http://" not in page.replace("http://www.w3.org/2000/svg", "")


def test_a_page_links_files_from_where_it_lies(store: Path, tmp_path: Path) -> None:
    listing = listing_of(store)
    (row,) = listing.rows()
    links = links_of(episode_section(listing.detail(row.name), link_from(tmp_path / "pages" / "a.html")))
    assert links["samples.xz"] == f"../store/units/{row.name}/samples.xz"


def test_an_episode_s_section_opens_what_failed_alone(finished_run: Path) -> None:
    section = episode_section(listing_of(finished_run).detail("run"), link_from(finished_run / "page.html"))
    opened = re.findall(r"<details class='step' id='(step-[0-9-]+)' open>", section)
    assert opened == ["step-1-3"] and section.index("Why it failed") < section.index("class='watching'")
    assert "&lt;where&gt;" in section and "<where>" not in section


def test_a_scene_is_a_page_of_its_own() -> None:
    page = scene_page(library.load("kitchen_t1"))
    assert "<html" in page[:300].lower() and "src='http" not in page and 'src="http' not in page


def test_the_command_writes_pages(store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    assert run(["view", str(store), "--out", str(page)]) == 0
    name = listing_of(store).rows()[0].name
    assert name in page.read_text()
    assert run(["view", str(store), "--out", str(page)]) == 2
    assert "--force" in capsys.readouterr().err
    assert run(["view", "kitchen_t1", "--out", str(tmp_path / "scene.html"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{empty}"], "has nothing to view"),
        (["kitchen_t9"], "there is no scene 'kitchen_t9'"),
        (["kitchen_t1", "--port", "70000"], "--port"),
        (["kitchen_t1", "--rerun"], "a folder with episodes"),
        (["{empty}", "--episode", "a"], "--out or --rerun with it"),
    ],
)
def test_what_cannot_be_viewed_is_one_message(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["view", *(word.format(empty=tmp_path) for word in words)]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_some_episodes_of_a_folder_are_written(store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (name,) = (row.name for row in listing_of(store).rows())
    for count in range(3):
        shutil.copytree(store / "units" / name, store / "units" / f"{name}{count}")
    page = tmp_path / "page.html"
    assert run(["view", str(store), "--out", str(page), "--episode", f"{name}1"]) == 0
    assert f"{name}1" in page.read_text() and f"{name}2" not in page.read_text()
    assert run(["view", str(store), "--out", str(page), "--episode", "nothing", "--force"]) == 2
    assert f"such as {name}," in " ".join(capsys.readouterr().err.split())


def test_a_recording_without_rerun_names_its_extra(
    store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert run(["view", str(store), "--rerun"]) == 2
    assert "pip install -e '.[rerun]'" in " ".join(capsys.readouterr().err.split())


def test_a_recording_is_written(store: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra is not installed by the set-up")
    assert run(["view", str(store), "--rerun", "--out", str(tmp_path / "a.rrd")]) == 0
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"
    assert run(["view", str(store), "--rerun", "--out", str(tmp_path / "a.rrd")]) == 2
