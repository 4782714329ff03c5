"""The scenes and phrasings that the tests of `llm` share."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import bddl
import llm
from oag import Scene
from oag.sizes import planned_resizings

HERE = Path(__file__).resolve().parent
GOLDEN = HERE.parent / "golden"
SCENES = {
    name: Scene.from_json(data) for name, data in json.loads((HERE / "scenes.json").read_text(encoding="utf-8")).items()
}
# A household with several things of a kind, colours, drawers above each other and things that stand on others.
SCENES["flat"] = Scene.from_json(HERE / "flat.json")


def noted(proposal: llm.Proposal) -> tuple[str, ...]:
    """Return what a proposal notes beside the sizes that it changes."""
    sizes = (
        set(map(str, planned_resizings(proposal.task.scales, proposal.task.scene))) if proposal.task.scene else set()
    )
    return tuple(note for note in proposal.notes if note not in sizes)


@dataclass(frozen=True, slots=True)
class Phrasing:
    """A query with what it should lead to: a goal G, or a refusal.

    `held_out` marks every third one of a family, by its place in the file: they were not looked at while the grammar
    was written.
    """

    scene: str
    query: str
    held_out: bool
    goal: str | None = None
    refuse: str | None = None
    family: str = "first_words"

    @property
    def wanted(self) -> frozenset[str] | str:
        """The conjuncts of the goal, whose order does not matter, or the code of the refusal."""
        return conjuncts(bddl.parse_formula(self.goal)) if self.goal is not None else str(self.refuse)


def conjuncts(goal: bddl.Formula) -> frozenset[str]:
    """Return the conjuncts of a goal as texts."""
    return frozenset(map(bddl.format, bddl.conjuncts(goal)))


def mostly_slow(phrasings: Iterable[Phrasing], every: int) -> list[Any]:
    """Return parameters of a test, all of them slow but for one of so many."""
    return [pytest.param(one, marks=pytest.mark.slow if k % every else ()) for k, one in enumerate(phrasings)]


def outcome(phrasing: Phrasing) -> frozenset[str] | str:
    """Return the conjuncts of the goal that a query leads to, or the code of its refusal."""
    try:
        proposal = llm.propose(phrasing.query, SCENES[phrasing.scene])
    except llm.QueryError as error:
        return error.code
    return conjuncts(proposal.task.goal)


def _families(paths: Iterable[Path]) -> Iterator[Phrasing]:
    """Yield the phrasings of the tables, family by family."""
    for path in paths:
        with path.open(encoding="utf-8", newline="") as lines:
            for row in csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE):
                expected = {"goal" if row["expected"].startswith("(") else "refuse": row["expected"]}
                yield Phrasing(row["scene"], row["query"], row["held_out"] == "yes", **expected, family=path.stem)


FIRST_WORDS = tuple(Phrasing(**entry) for entry in json.loads((HERE / "phrasings.json").read_text(encoding="utf-8")))
FAMILIES = tuple(_families(sorted((HERE / "phrasings").glob("*.tsv"))))
PHRASINGS = FIRST_WORDS + FAMILIES
# Written when the grammar stood, to see how far it carries; some of them are understood by people only.
LATER = tuple(_families([HERE / "phrasings_later.tsv"]))
# Of people who did not know the grammar; it was extended by what they said.
STRANGERS = tuple(_families([HERE / "phrasings_strangers.tsv"]))
# Ordinary wishes, written before the planner could read them.
ORDINARY = tuple(_families([HERE / "phrasings_ordinary.tsv"]))
