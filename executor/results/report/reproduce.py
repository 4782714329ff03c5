"""What is needed to get the same run again: command, seed, hashes, versions."""

from __future__ import annotations

import platform
from importlib import metadata

from executor.results.report.html import facts, text
from executor.results.run_record import RunRecord

_DISTRIBUTIONS = ("scene2demo", "sapien", "numpy", "scipy", "example-robot-data", "av")


def versions() -> dict[str, str]:
    """Returns distribution -> installed version of everything that a run's numbers depend on."""
    found = {"python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def reproduce_section(record: RunRecord) -> str:
    """Returns the block that says how to repeat the run and how to see that it was the same one."""
    rollout = record.rollout
    rows: list[tuple[str, str]] = [("scene", text(record.graph.scene.name))]
    if rollout is not None:
        rows += [
            ("seed", text(rollout.seed)),
            ("recorded samples", text(len(rollout.trajectory.time_s))),
            ("state hash (SHA-256)", f"<code>{text(rollout.state_hash)}</code>"),
        ]
    if record.pictures:
        rows.append(("pictures", text(record.pictures)))
    rows += [(f"wall time, {part}", f"{seconds:.1f} s") for part, seconds in record.wall_s.items()]
    listed = ", ".join(f"{name} {version}" for name, version in versions().items())
    command = f"<pre>{text(record.command)}</pre>" if record.command else ""
    checkpoints = ""
    if rollout is not None and rollout.subtasks:
        lines = "".join(
            f"<tr><td>{index + 1}. {text(subtask.name)}</td><td><code>{text(subtask.state_hash[:16])}</code></td></tr>"
            for index, subtask in enumerate(rollout.subtasks)
        )
        checkpoints = (
            "<details><summary class='soft'>State hash at the end of each subtask</summary>"
            f"<table>{lines}</table></details>"
        )
    return (
        f'<div class="card"><p>Equal scene, plan and seed give the same states bit by bit on this kind of machine; the '
        f"state hash says whether they were.</p>{command}{facts(rows)}{checkpoints}"
        f"<p class='soft'>{text(listed)}</p></div>"
    )
