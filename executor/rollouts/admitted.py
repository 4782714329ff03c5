"""Which of the wishes that a scene admits are feasible: each plan is gone through by geometry, within a time limit."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from bddl.errors import Scene2DemoError
from executor.records import Event
from executor.rollouts.feasibility import feasible
from executor.system.files import content_key, json_text, plain
from oag import Scene, compose
from oag.wish_list import AdmittedTask


@dataclass(frozen=True, slots=True)
class Judged:
    """A wish with the answer whether it is feasible.

    Attributes:
        found: The wish with its plan.
        feasible: The answer; None where it was not found within the limit.
        reason: Why the plan is not feasible, or why there is no answer; empty where it is feasible.
        cpu_s: CPU time of the question.
    """

    found: AdmittedTask
    feasible: bool | None
    reason: str
    cpu_s: float

    def to_json(self) -> dict[str, Any]:
        """Return the wish with the answer as plain data."""
        answer = {"feasible": self.feasible, "reason": self.reason, "cpu_s": round(self.cpu_s, 3)}
        return {**self.found.to_json(), **answer}


class NotAnswers(Scene2DemoError, ValueError):
    """A file has something else than answers."""


class _TimeUp(Exception):
    pass


def judged(found: AdmittedTask, scene: Scene, seed: int, limit_s: float) -> Judged:
    """Ask whether a wish is feasible.

    Args:
        found: The wish with its plan.
        scene: The scene.
        seed: Seed of the planning; the scene is taken as it is.
        limit_s: CPU time after which no further step of the plan is begun.
    """
    began = time.process_time()

    def spent_s() -> float:
        return time.process_time() - began

    def listen(event: Event) -> None:
        if event.kind == "step-start" and spent_s() > limit_s:
            raise _TimeUp

    try:
        answer = feasible(compose(found.task, scene=scene), scene, seed, listen=listen, vary=False)
    except _TimeUp:
        return Judged(found, None, f"no answer within {limit_s:g} s of CPU time", spent_s())
    except Scene2DemoError as problem:
        return Judged(found, False, str(problem), spent_s())
    return Judged(found, answer.feasible if answer.decided else None, answer.reason, spent_s())


class Answers:
    """Answers of a scene in a file of JSON lines, so that a list that was interrupted goes on where it ended.

    Args:
        path: The file; None keeps nothing.
        scene: The scene; answers about another one do not count.
        seed: Seed of the planning.
        version: Of what decides the answers; those of another one do not count.

    Raises:
        NotAnswers: The file has something else.
    """

    def __init__(self, path: Path | None, scene: Scene, seed: int, version: str = "") -> None:
        self._path, self._scene, self._seed = path, scene, seed
        self._key = content_key(json_text(scene.to_json()), str(seed), version)
        self._known: dict[tuple[str, str], dict[str, Any]] = {}
        if path is not None and path.is_file():
            text = path.read_text(encoding="utf-8", errors="replace")
            lines = text.splitlines()
            if lines and _read(lines[0]) is None and not lines[0].startswith('{"key"'):
                raise NotAnswers(f"{path} has something else than answers; choose another file with --out")
            if not text.endswith("\n"):
                # What was interrupted within a line must not swallow the next one.
                path.write_text(f"{text}\n", encoding="utf-8")
            for line in lines:
                kept = _read(line)
                if kept is not None and kept.get("key") == self._key:
                    self._known[kept["sentence"], kept["goal"]] = kept

    def of(self, tasks: Iterable[AdmittedTask], limit_s: float) -> Iterator[Judged]:
        """Yield the answer for each wish, those that are known at once; new ones are kept in the file."""
        for found in tasks:
            data = found.to_json()
            kept = self._known.get((str(data["sentence"]), str(data["goal"])))
            # What had no answer in less time is asked again; equal sentences may have plans of other sizes.
            if (
                kept is not None
                and kept.get("task") == plain(data.get("task"))
                and (kept["feasible"] is not None or float(kept.get("limit_s", 0.0)) >= limit_s)
            ):
                yield Judged(found, kept["feasible"], kept["reason"], kept["cpu_s"])
                continue
            answer = judged(found, self._scene, self._seed, limit_s)
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": self._key, "limit_s": limit_s, **answer.to_json()}) + "\n")
            yield answer


def in_turn(tasks: Iterable[AdmittedTask]) -> Iterator[AdmittedTask]:
    """Yield one wish of each kind, then the next of each, so that the first of them are of all kinds."""
    by_kind: dict[str, list[AdmittedTask]] = {}
    for found in tasks:
        by_kind.setdefault(found.wish.kind, []).append(found)
    for turn in zip_longest(*by_kind.values()):
        yield from filter(None, turn)


def _read(line: str) -> dict[str, Any] | None:
    """Return the answer of a line; None for one that was not written to its end."""
    try:
        value = json.loads(line)
        return (
            value
            if isinstance(value, dict) and {"sentence", "goal", "feasible", "reason", "cpu_s"} <= value.keys()
            else None
        )
    except ValueError:
        return None
