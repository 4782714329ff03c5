"""What a file goes through: read, composed, verified, told, written, checked again, and opened by commands."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import oag
from executor.cli.app import run
from oag.graph import to_dot, to_mermaid
from tests.hostile_files import Mutant


class WentWrong(AssertionError):
    """The program said something of a file that is not so, or nothing that a person could use."""


def write(mutant: Mutant, folder: Path) -> tuple[Path, Path]:
    """Return the files of a mutant: the task and the scene."""
    paths = folder / "task.json", folder / "scene.json"
    for path, text in zip(paths, (mutant.task, mutant.scene), strict=True):
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return paths


def read_through(mutant: Mutant, folder: Path) -> str:
    """Return what became of a mutant: a verdict, or the name of the typed error.

    Raises:
        WentWrong: What was written cannot be read back, or the certificate does not stand.
        Exception: Anything else that is no `OagError` is a crash.
    """
    task_path, scene_path = write(mutant, folder)
    try:
        scene = oag.Scene.from_json(scene_path)
        _require(oag.Scene.from_json(_again(scene.to_json())) == scene, "the scene is another after it was written")
        task = oag.Task.from_json(task_path, scene=scene)
        _require(oag.Task.from_json(_again(task.to_json()), scene=scene) == task, "the task is another after it")
        graph = oag.compose(task)
        report = graph.verify()
        _require(bool(str(report)) and bool(_again(report.to_json())), "nothing is said")
        _again(graph.task.to_json())
        to_mermaid(graph), to_dot(graph)
        for fix in report.fixes:
            fix.apply(report.task), fix.apply_to_scene(report.scene)
        wrong = report.verdict is oag.Verdict.REFUTED
        _require(bool(report.errors) == wrong, f"{report.verdict.value} with {len(report.errors)} errors")
        if report.certificate is not None:
            result = oag.recheck(_again(report.certificate.to_json()))
            _require(bool(result), f"the certificate does not stand: {result.reason}")
    except oag.OagError as error:
        _require(bool(str(error)), "an error without words")
        return type(error).__name__
    return report.verdict.value


def typed(mutant: Mutant, folder: Path) -> None:
    """Open the files of a mutant by the commands that read them.

    Raises:
        WentWrong: A command ended otherwise than by 0, 1 or 2, or without a word.
        Exception: A command crashed; `--debug` lets that through.
    """
    task, scene = map(str, write(mutant, folder))
    certificate = folder / "certificate.json"
    certificate.unlink(missing_ok=True)
    commands = [
        ["verify", task, "--scene", scene, "--certificate", str(certificate)],
        ["graph", task, "--scene", scene, "--format", "mermaid"],
        ["scenes", scene],
        ["recheck", task],
        ["recheck", str(certificate), "--json"],
    ]
    for command in commands:
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = run([*command, "--debug"])
        _require(code in (0, 1, 2) and bool(out.getvalue() + err.getvalue()), f"{command[0]} ended with {code}")


def _again(value: object) -> dict[str, object]:
    """Return JSON data as it is after it was written and read."""
    found: dict[str, object] = json.loads(json.dumps(value, allow_nan=False))
    return found


def _require(met: bool, said: str) -> None:
    if not met:
        raise WentWrong(said)
