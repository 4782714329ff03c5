"""`scene2demo assets`: the library as text and as JSON."""

from __future__ import annotations

import json

from executor.assets.library import LIBRARY
from tests.executor.cli.conftest import Command


def test_every_model_is_listed_with_its_category(command: Command) -> None:
    answer = command("assets")
    assert answer.code == 0 and answer.err == ""
    for model, entry in LIBRARY.items():
        line = next(line for line in answer.out.splitlines() if line.split(" ")[0] == model)
        assert entry.category in line and entry.synset in line


def test_programs_get_ranges(command: Command) -> None:
    answer = command("assets", "--json")
    listed = {asset["model"]: asset for asset in json.loads(answer.out)["assets"]}
    assert answer.code == 0 and set(listed) == set(LIBRARY)
    drawers = listed["cabinet_drawers"]
    assert drawers["role"] == "A" and drawers["size"]["x"] == {"low": 0.56, "high": 0.66, "unit": "m"}
    assert {"name": "drawers", "low": 2, "high": 4, "default": 3, "whole": True} in drawers["parameters"]
    assert listed["mug"]["role"] == "B"
    assert {"name": "hinge", "words": ["left", "right"], "default": "left"} in listed["fridge_one_door"]["parameters"]
