"""Who may propose: nobody named (offline), or any object with the method."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

import llm
import oag
from tests.llm.kitchens import SCENES


class Repeater:
    """Proposes the same thing whatever it is asked."""

    def __init__(self, answer: llm.Proposal) -> None:
        self.answer = answer
        self.asked: list[tuple[str, oag.Scene]] = []

    def propose(self, query: str, scene: oag.Scene) -> llm.Proposal:
        """Return the one answer."""
        self.asked.append((query, scene))
        return self.answer


def test_another_proposer_is_asked_with_query_and_scene() -> None:
    scene = SCENES["kitchen_t1"]
    repeater = Repeater(llm.propose("open the fridge", scene))
    assert llm.propose("make breakfast", scene, model=repeater) is repeater.answer
    assert repeater.asked == [("make breakfast", scene)]


def test_the_offline_planner_is_a_proposer() -> None:
    scene = SCENES["kitchen_t1"]
    assert isinstance(llm.OfflinePlanner(), llm.Proposer)
    assert llm.propose("open the fridge", scene, model=llm.OfflinePlanner()) == llm.propose("open the fridge", scene)


@pytest.mark.parametrize("model", [7, object(), Repeater])
def test_anything_else_is_refused_in_a_sentence(model: object) -> None:
    with pytest.raises(
        llm.LlmError,
        match=r"model is None \(the offline planner\), a configuration string .* or an object with propose",
    ) as caught:
        llm.propose("open the fridge", SCENES["kitchen_t1"], model=model)  # type: ignore[arg-type]
    assert isinstance(caught.value, TypeError)


def test_importing_llm_leaves_the_grammar_library_alone() -> None:
    code = "import sys, llm; print(sorted({'lark', 'yaml', 'openai', 'networkx', 'pydantic'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("given", ["kitchen_t1", None, {}])
@pytest.mark.parametrize("model", [None, llm.OfflinePlanner()])
def test_what_is_no_scene_is_refused(given: object, model: object) -> None:
    untyped: Any = llm
    with pytest.raises(oag.SceneError, match=r"expected a Scene, got .* \(oag\.Scene\.from_json reads one"):
        untyped.propose("open the fridge", given, model)


def test_a_query_is_text() -> None:
    untyped: Any = llm
    with pytest.raises(llm.QueryError, match="expected a sentence in English, got 5"):
        untyped.propose(5, SCENES["kitchen_t1"])
