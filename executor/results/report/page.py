"""The report of a run as one HTML file that needs no network: styles, pictures, graph and video are inside."""

from __future__ import annotations

import platform
from importlib import metadata
from pathlib import Path

from executor.pictures.frames import Frames
from executor.pictures.video import SPEED
from executor.records.captions import readable
from executor.results.report.evolution import evolution_section
from executor.results.report.graph_picture import graph_picture
from executor.results.report.html import SCRIPT, STYLE, badge, facts, text, video_uri
from executor.results.report.plan import plan_section, verdict_badge
from executor.results.report.steps import failure_section, steps_section
from executor.results.run_record import RunRecord, filled_task
from oag import compose

_OUTCOMES = {
    "succeeded": ("succeeded in simulation", "good"),
    "failed": ("failed in simulation", "bad"),
    "interrupted": ("interrupted", "warn"),
    "not-run": ("not executed", "quiet"),
}


def report_page(record: RunRecord, frames: Frames | None = None, video: Path | None = None) -> str:
    """Returns the whole page as text.

    Args:
        record: What the run has to tell.
        frames: Pictures of its samples, when there are any.
        video: The MP4 to embed, when there is one.
    """
    rollout = record.rollout
    heading = record.query or readable(record.graph.task.name)
    body = [_header(record, heading)]
    if rollout is not None and not record.interrupted:
        body.append(failure_section(rollout, frames))
    if record.evolution is not None:
        body.append(evolution_section(record.evolution, record.attempts))
    if video is not None:
        body.append(
            f"<h2>Video</h2><video controls muted playsinline preload='metadata' src='{video_uri(video)}'></video>"
            f"<p class='soft'>Overview, head and wrist cameras, {SPEED:g} times real time.</p>"
        )
    elif record.pictures and rollout is not None:
        body.append(f"<h2>Video</h2><div class='card'><p>No pictures: {text(record.pictures)}</p></div>")
    graph = record.graph if rollout is None else compose(filled_task(rollout), scene=record.graph.scene)
    body.append(f"<h2>The object-action graph</h2><div class='card graph'>{graph_picture(graph, rollout)}</div>")
    body.append(f"<h2>What was proved before anything moved</h2>{plan_section(record.report)}")
    if rollout is not None:
        body.append(f"<h2>What happened</h2>{steps_section(rollout, frames)}")
    body.append(f"<h2>Repeat it</h2>{reproduce_section(record)}")
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{text(heading)}</title><style>{STYLE}</style></head>"
        f"<body><main>{''.join(body)}<footer>Written by scene2demo.</footer></main>"
        f"<script>{SCRIPT}</script></body></html>\n"
    )


def _header(record: RunRecord, heading: str) -> str:
    words, tone = _OUTCOMES[record.outcome]
    said = dict.fromkeys((*record.notes, *map(str, record.sizes)))
    notes = "".join(f"<li>{text(note)}</li>" for note in said)
    return (
        f"<header><h1>{text(heading)}</h1><p class='lead'>{text(record.graph.task.detail)}</p>"
        f"<div class='row'>{verdict_badge(record.report)}{badge(words, tone)}</div>"
        f"{f'<ul class=soft>{notes}</ul>' if notes else ''}{_figures(record)}</header>"
    )


def _figures(record: RunRecord) -> str:
    rollout = record.rollout
    if rollout is None:
        return ""
    total = len(rollout.task.subtasks)
    reached = sum(subtask.succeeded for subtask in rollout.subtasks)
    steps = sum(len(subtask.steps) for subtask in rollout.subtasks)
    figures = [
        (f"{reached} of {total}", "subtask reached" if total == 1 else "subtasks reached"),
        (str(steps), "step executed" if steps == 1 else "steps executed"),
        (f"{rollout.simulated_s:.1f} s", "simulated"),
        (f"{rollout.planning_wall_s:.1f} s", "motion planning"),
        (f"{rollout.simulation_wall_s:.1f} s", "physics"),
        (str(rollout.seed), "seed"),
    ]
    cells = "".join(f"<div><b>{text(value)}</b><span>{text(name)}</span></div>" for value, name in figures)
    return f"<div class='figures'>{cells}</div>"


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
