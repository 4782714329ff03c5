"""Files that options name: those to write, and tasks with their scenes."""

from __future__ import annotations

from pathlib import Path

from executor.cli.errors import BadOption, check
from executor.cli.output import tell_notes
from executor.scenes.file import load_with_notes
from executor.scenes.library import load_in_words
from oag import Scene, Task, TaskError
from oag.model.codec import load
from oag.model.domain import BUILT_IN, Domain
from oag.model.robots import FULL_SIZE, chosen_robot


def refuse_existing(path: Path, *, force: bool, option: str = "--out") -> None:
    """Refuse to replace a file, unless forced."""
    if path.is_dir():
        raise BadOption(option, path, "a file, not a folder")
    if path.exists() and not force:
        raise BadOption(option, path, "a file that does not exist yet; --force replaces it")


def domain_in(path: Path | None) -> Domain:
    """Return the domain of a TOML file; raises DomainError for what is not as documented."""
    return BUILT_IN if path is None else Domain.from_toml(path)


def task_and_scene(
    task_path: Path, scene: str | None, domain: Domain = BUILT_IN, *, is_built: bool = True
) -> tuple[Task, Scene]:
    """Return a task file's task and its scene, both in a domain.

    Args:
        task_path: The task's file.
        scene: Name or file of the scene; without one, `<task>_scene.json` or `scene.json` in the task's folder.
        is_built: Whether the scene needs geometry; else one of categories and facts alone is taken as it is.
    """
    Task.from_json(task_path)  # A broken task is reported before a missing scene.
    source = scene if scene is not None else _default_scene(task_path)
    in_words = None if is_built else load_in_words(source, domain)
    if in_words is not None:
        return Task.from_json(task_path, scene=in_words), in_words
    found = load_with_notes(source, domain)
    tell_notes(found.notes)
    return Task.from_json(task_path, scene=found.scene), found.scene


def robot_asked_for(name: str | None, *, full_size: bool) -> str:
    """Return the name of the robot that options choose; empty where none does.

    Raises:
        BadOption: They choose two.
    """
    check(not full_size or name in (None, FULL_SIZE.name), "--full-size", "is given", f"none with --robot {name}")
    return chosen_robot(name or "", full_size=full_size)


def query_in(task_path: Path) -> str:
    """Return the sentence that a task file was planned from, as proposals have it; empty where there is none."""
    query = load(task_path, TaskError).at().get("query", "")
    return query if isinstance(query, str) else ""


def _default_scene(task_path: Path) -> Path:
    for candidate in (task_path.with_name(f"{task_path.stem}_scene.json"), task_path.with_name("scene.json")):
        if candidate.is_file():
            return candidate
    raise BadOption("--scene", "is missing", f"a scene's name or file, since none lies in the folder of {task_path}")
