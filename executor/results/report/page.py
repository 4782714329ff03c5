"""The report of a run as one HTML file that needs no network: styles, pictures, graph and video are inside."""

from __future__ import annotations

import platform
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from bddl.visible import counted
from executor.pictures.frames import Frames
from executor.pictures.video import SPEED
from executor.records.captions import peaks_words, readable
from executor.records.rollout import Rollout
from executor.results.report.evolution import evolution_section
from executor.results.report.graph_picture import graph_picture
from executor.results.report.html import badge, bullets, card, document, facts, fold, soft, style, table, text, video
from executor.results.report.plan import plan_section, verdict_badge
from executor.results.report.steps import failure_section, steps_section
from executor.results.run_record import RunRecord
from llm.answers.spending import Spending

_OUTCOMES = {
    "succeeded": ("succeeded in simulation", "good"),
    "failed": ("failed in simulation", "bad"),
    "interrupted": ("interrupted", "warn"),
    "not-run": ("not executed", "quiet"),
}
_SEEK = """
document.querySelectorAll("button.seek").forEach(function(button){button.addEventListener("click",function(event){
event.preventDefault();var video=document.querySelector("video");if(!video)return;
video.currentTime=parseFloat(button.dataset.at);video.play();video.scrollIntoView({behavior:"smooth",block:"center"})})});
"""
_DISTRIBUTIONS = ("scene2demo", "sapien", "numpy", "scipy", "example-robot-data", "av")


def report_page(record: RunRecord, frames: Frames | None = None, mp4: Path | None = None) -> str:
    """Returns the whole page as text.

    Args:
        record: What the run has to tell.
        frames: Pictures of its samples, when there are any.
        mp4: The video to embed, when there is one.
    """
    rollout = record.rollout
    heading = record.query or readable(record.graph.task.name)
    body = [_header(record, heading)]
    if rollout is not None and not record.interrupted:
        body.append(failure_section(rollout, frames))
    if record.evolution is not None:
        body.append(evolution_section(record.evolution, record.attempts))
    if mp4 is not None:
        body += ["<h2>Video</h2>", video(mp4)]
        body.append(soft(f"Overview, head and wrist cameras, {SPEED:g} times real time."))
    elif record.pictures and rollout is not None:
        body.append(f"<h2>Video</h2>{card(f'<p>No pictures: {text(record.pictures)}</p>')}")
    body.append(f"<h2>The object-action graph</h2>{card(graph_picture(record.graph, rollout), kind='graph')}")
    of_what = "What was proved before anything moved" if rollout is None else "What is proved of the plan that ran"
    body.append(f"<h2>{of_what}</h2>{_detours(rollout)}{plan_section(record.report)}")
    if rollout is not None:
        body.append(f"<h2>What happened</h2>{steps_section(rollout, frames)}")
        body.append(f"<h2>The most that was asked of the robot</h2>{_asked(rollout)}")
    if record.spending is not None:
        body.append(f"<h2>What the model took</h2>{_spent(record.spending)}")
    body.append(f"<h2>Repeat it</h2>{_reproduce(record)}")
    return document(heading, body, style("page", "graph"), _SEEK)


def _header(record: RunRecord, heading: str) -> str:
    words, tone = _OUTCOMES[record.outcome]
    detours = () if record.rollout is None else record.rollout.detour_notes
    notes = dict.fromkeys((*record.notes, *map(str, record.sizes), *detours))
    return (
        f"<header><h1>{text(heading)}</h1><p class='lead'>{text(record.graph.task.detail)}</p>"
        f"<div class='row'>{verdict_badge(record.report)}{badge(words, tone)}</div>"
        f"{bullets(notes) if notes else ''}{_figures(record)}</header>"
    )


def _detours(rollout: Rollout | None) -> str:
    if rollout is None or not rollout.detours:
        return ""
    asked = counted(len(rollout.asked_for.subtasks), "subtask")
    words = f"The plan that was asked for has {asked}, and was proved before anything moved."
    return f"{soft(words)}{bullets(rollout.detour_notes)}"


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


def _asked(rollout: Rollout) -> str:
    rows = [(part, text(words)) for part, words in peaks_words(asdict(rollout.peaks))]
    return card(facts(rows), soft("Of the arm's torques, that of joints 1 to 4 and that of joints 5 to 7."))


def _spent(spending: Spending) -> str:
    """Returns the rounds in which a model was asked, with seconds, tokens and cost, and the whole."""
    rows = ((text(value) for value in row) for row in spending.rows())
    head = ("asked by", "round", "time", "tokens in + out", "cost")
    return card(table(rows, head), soft(text(spending.total())))


def versions() -> str:
    """Returns names and installed versions of everything that a run's numbers depend on."""
    found = {"python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(f"{name} {version}" for name, version in found.items())


def _reproduce(record: RunRecord) -> str:
    """Returns the block that says how to repeat the run and how to see that it was the same one."""
    rollout = record.rollout
    rows: list[tuple[str, str]] = [("scene", text(record.graph.scene.name))]
    checkpoints = ""
    if rollout is not None:
        rows += [
            ("seed", text(rollout.seed)),
            ("recorded samples", text(len(rollout.trajectory.time_s))),
            ("state hash (SHA-256)", f"<code>{text(rollout.state_hash)}</code>"),
        ]
        hashes = [
            (f"{number}. {text(subtask.name)}", f"<code>{text(subtask.state_hash[:16])}</code>")
            for number, subtask in enumerate(rollout.subtasks, start=1)
        ]
        head = "<span class='soft'>State hash at the end of each subtask</span>"
        checkpoints = fold(head, table(hashes)) if hashes else ""
    if record.pictures:
        rows.append(("pictures", text(record.pictures)))
    rows += [(f"wall time, {part}", f"{seconds:.1f} s") for part, seconds in record.wall_s.items()]
    return card(
        "<p>Equal scene, plan and seed give the same states bit by bit on this kind of machine; the state hash says "
        "whether they were.</p>",
        f"<pre>{text(record.command)}</pre>" if record.command else "",
        facts(rows),
        checkpoints,
        soft(text(versions())),
    )
