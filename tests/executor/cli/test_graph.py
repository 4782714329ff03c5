"""`scene2demo graph`: every format to standard output or a file, and what it refuses."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tests.executor.cli.conftest import ROOT, Command

T1 = ROOT / "tests" / "data" / "T1.json"
BROKEN = ROOT / "tests" / "data" / "invalid" / "dropped_converge.json"


def test_the_picture_shows_every_step_and_needs_no_page(command: Command) -> None:
    answer = command("graph", T1)
    assert answer.code == 0 and answer.err == ""
    picture = ElementTree.fromstring(answer.out)
    assert picture.tag == "{http://www.w3.org/2000/svg}svg"
    boxes = [box for box in picture.iter("{http://www.w3.org/2000/svg}rect") if "node" in box.attrib["class"]]
    assert len(boxes) == 20
    assert "var(--" not in answer.out


@pytest.mark.parametrize(
    ("form", "beginning"),
    [("mermaid", "flowchart LR"), ("dot", "digraph {"), ("graphml", "<?xml"), ("json", "{")],
)
def test_a_file_in_each_other_form(command: Command, tmp_path: Path, form: str, beginning: str) -> None:
    target = tmp_path / "graph.txt"
    answer = command("graph", T1, "--format", form, "--out", target)
    assert answer.code == 0 and answer.out == "" and str(target) in answer.err.replace("\n", "")
    assert target.read_text().startswith(beginning)


def test_json_is_one_object(command: Command) -> None:
    drawing = command("graph", T1, "--json").data
    assert len(drawing["nodes"]) == 20 and len(drawing["edges"]) == 19


def test_a_wrong_plan_has_a_graph_that_shows_where_it_breaks(command: Command) -> None:
    answer = command("graph", BROKEN, "--scene", T1.with_name("T1_scene.json"), "--format", "dot")
    assert answer.code == 0
    assert "color=red" in answer.out


def test_a_file_is_not_replaced_unasked(command: Command, tmp_path: Path) -> None:
    target = tmp_path / "graph.svg"
    target.write_text("mine")
    answer = command("graph", T1, "--out", target)
    assert answer.code == 2 and "--force" in answer.err and target.read_text() == "mine"
    assert command("graph", T1, "--out", target, "--force").code == 0
    assert target.read_text().startswith("<svg")
    assert command("graph", T1, "--out", tmp_path).code == 2


@pytest.mark.parametrize(
    ("ending", "beginning"),
    [("svg", "<svg"), ("mmd", "flowchart LR"), ("dot", "digraph {"), ("graphml", "<?xml"), ("json", "{")],
)
def test_the_ending_of_a_file_says_its_form(command: Command, tmp_path: Path, ending: str, beginning: str) -> None:
    target = tmp_path / f"graph.{ending}"
    assert command("graph", T1, "--out", target).code == 0
    assert target.read_text().startswith(beginning)


def test_an_ending_that_says_nothing_is_refused(command: Command, tmp_path: Path) -> None:
    target = tmp_path / "graph.png"
    answer = command("graph", T1, "--out", target)
    assert answer.code == 2 and "ends in .svg, .mmd" in answer.err and "--format" in answer.err
    assert not target.exists()
    assert command("graph", T1, "--out", target, "--format", "svg").code == 0
