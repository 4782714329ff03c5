"""The report of a run as one HTML file that needs no network: styles, pictures, graph and video are inside.

Sections: the plan (verdict, certificate in words, findings); subtasks and steps with evidence and pictures; the
failure; the evolution (attempts side by side, failed step, revision, outcome); peak loads, model usage, how to
repeat the run.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from difflib import SequenceMatcher
from importlib import metadata
from pathlib import Path
from textwrap import dedent

from bddl.terminal import pluralize
from executor.records import Failure, Rollout, StepRecord, action_text, describe_peaks, readable
from executor.reports.graph_picture import graph_picture
from executor.reports.html import (
    badge,
    bullets,
    card,
    document,
    facts,
    fold,
    jpeg,
    measurements,
    soft,
    strip,
    style,
    table,
    text,
    video,
)
from executor.rollouts.evolution_record import AttemptPictures, Evolution, SubtaskStory, shown_step
from executor.rollouts.run_record import RunRecord
from executor.sim.render.frames import SPEED, Frames, key_samples
from llm.structured.conversation import Spending
from oag import Action, ActionFlow, Attempt, Diagnostic, Grade, Obligation, Report, Revision, Verdict, recheck
from oag.measurements import GoalReading, measurements_json
from oag.progression import producer_place
from oag.task import step_place, subtask_place

_TONES = {Verdict.PROVED: "good", Verdict.CONDITIONAL: "warn", Verdict.REFUTED: "bad"}
_GRADES = {Grade.HOLDS: "good", Grade.POSSIBLE: "warn", Grade.FAILS: "bad"}
_VERDICT_MEANINGS = {
    Verdict.PROVED: "From every state that agrees with what is known, each step's precondition holds when the step "
    "begins, each subtask ends in its goal, and the last state satisfies the task goal.",
    Verdict.CONDITIONAL: "The plan reaches its goal if what is listed as unknown below turns out to hold.",
    Verdict.REFUTED: "There is a state that agrees with everything known from which this plan fails.",
}


def verdict_badge(report: Report) -> str:
    """Return the verdict as a label."""
    return badge(report.verdict.value.lower(), _TONES[report.verdict])


def plan_section(report: Report) -> str:
    """Return the section about the plan: the decision, its assumptions, and why each step may run."""
    held = sum(obligation.grade is Grade.HOLDS for obligation in report.obligations)
    total = len(report.obligations)
    counts = f"{held} of {pluralize(total, 'obligation')} hold" if total else "the plan is not well formed"
    goal = (
        f"<span class='soft'>Task goal, {text(report.goal_source)}</span> <code>{text(report.to_json()['goal'])}</code>"
    )
    parts = [f'<div class="row">{verdict_badge(report)}<span>{counts}</span></div>']
    parts += [f"<p>{text(_VERDICT_MEANINGS[report.verdict])}</p>", f"<p>{goal}</p>"]
    if report.assumptions:
        parts.append(f"{soft('It rests on the scene&#x27;s facts and on:')}{bullets(report.assumptions)}")
    if report.certificate is not None:
        checked = recheck(report.certificate)
        words = f"{'' if checked else 'not '}confirmed by the independent checker"
        label = badge(words, "good" if checked else "bad")
        parts.append(f"<p>{label} <span class='soft'>{text(checked.reason)}</span></p>")
    reasons = _reasons(report) if report.obligations else ""
    return f"{card(*parts)}{''.join(map(_finding, report.diagnostics))}{reasons}"


def _finding(finding: Diagnostic) -> str:
    tone = {"error": "bad", "warning": "warn"}.get(finding.severity, "quiet")
    words = dedent("\n".join(str(finding).splitlines()[1:]))
    head = (
        f"{badge(finding.severity, tone)} <b>{text(finding.code)}</b> <span class='soft'>{text(finding.place)}</span>"
    )
    return fold(head, f"<pre>{text(words)}</pre>", kind="card", unfolded=finding.severity == "error")


def _reasons(report: Report) -> str:
    """Return the certificate in words: each condition, where it is needed, and its producer."""
    rows = (
        (
            text(_place(report, obligation)),
            "<br>".join(text(link.condition.text()) for link in obligation.links)
            or "<span class='soft'>nothing</span>",
            "<br>".join(text(producer_place(report.trace, link.producer)) for link in obligation.links)
            if report.trace is not None
            else "",
            badge(obligation.grade.value.lower(), _GRADES[obligation.grade]),
        )
        for obligation in report.obligations
    )
    head = "<b>The certificate in words</b> <span class='soft'>what every step needs, and what sees to it</span>"
    shown = table(rows, ("Where", "Needs", "Because of", ""))
    return fold(head, f"<div class='scroll'>{shown}</div>", kind="card")


def _place(report: Report, obligation: Obligation) -> str:
    if obligation.kind == "task-goal":
        return "the task goal"
    if obligation.kind == "precondition":
        return step_place(report.task, obligation.subtask, obligation.step)
    return f"{subtask_place(report.task, obligation.subtask)}, {'start' if obligation.kind == 'init' else 'goal'}"


def steps_section(rollout: Rollout, frames: Frames | None) -> str:
    """Return one card a subtask, those that never ran included."""
    records = {record.index: record for record in rollout.subtasks}
    parts = []
    for index, subtask in enumerate(rollout.task.subtasks):
        record, described = records.get(index), subtask.to_json()
        if record is None:
            state, happened = badge("not run", "quiet"), ""
        else:
            state = badge("reached", "good") if record.succeeded else badge("failed", "bad")
            steps = (_step(rollout, step, len(record.flow), frames) for step in record.steps)
            happened = f"{readings_list(record.readings)}{''.join(steps)}"
        added = badge("inserted on the way", "quiet") if index in rollout.inserted else ""
        parts.append(
            card(
                f'<div class="row"><h3>{index + 1}. {text(readable(subtask.name))}</h3>{state}{added}</div>',
                soft(text(subtask.detail)),
                f"<p><span class='soft'>from</span> <code>{text(described['init'])}</code> ",
                f"<span class='soft'>to</span> <code>{text(described['goal'])}</code></p>",
                happened,
            )
        )
    if rollout.goal_readings:
        parts.append(card("<h3>Task goal</h3>", readings_list(rollout.goal_readings)))
    return "".join(parts)


def readings_list(readings: Sequence[GoalReading]) -> str:
    """Return the detectors' readings of each literal of a goal, with the numbers behind them."""
    rows = []
    for reading in readings:
        mark = '<span class="tick">&#10003;</span>' if reading.satisfied else '<span class="cross">&#10007;</span>'
        rows.append(f"<li>{mark} <code>{text(reading)}</code>{measurements(reading.measurements.to_json())}</li>")
    return f'<ul class="plain">{"".join(rows)}</ul>' if rows else ""


def _step(rollout: Rollout, step: StepRecord, length: int, frames: Frames | None) -> str:
    failure = step.failure
    name = f"{step.step + 1}/{length} {action_text(step.primitive, step.action)}"
    label = badge(failure.kind.value, "bad") if failure else ""
    seek = f'<button class="seek" data-at="{step.start_s / SPEED:.2f}">play</button>' if frames else ""
    times = f"{step.start_s:.1f} to {step.end_s:.1f} s, planned in {step.planning_wall_s:.2f} s"
    return fold(
        f'<span class="name">{text(name)}</span>{label}{seek}<span class="time">{times}</span>',
        f"<p>{text(failure.message)}</p>{measurements(measurements_json(failure.measurements))}" if failure else "",
        measurements(measurements_json(step.measurements)),
        frame_strips(rollout, step, frames),
        kind="step",
        unfolded=bool(failure or frames),
    )


def frame_strips(rollout: Rollout, step: StepRecord, frames: Frames | None) -> str:
    """Return one row of pictures a view, at most six each, in the order of time; empty without pictures."""
    samples = [index for index in key_samples(rollout.trajectory, step) if index < frames.count] if frames else []
    if frames is None or not samples:
        return ""
    times = rollout.trajectory.time_s
    rows = (
        strip(
            view,
            [
                (jpeg(frames.at_size(view, slice(index, index + 1))[0]), f"{view} view at {times[index]:.1f} s")
                for index in samples
            ],
        )
        for view in frames.views
    )
    return f'<div class="strips">{"".join(rows)}</div>'


_FAILURE_MEANINGS = {
    "unreachable": "No posture of the robot brings the hand where the step needs it.",
    "timeout": "The step took longer than a primitive may.",
    "no-collision-free-path": "The goal of the motion can be reached, but every path found touches something.",
    "grasp-missed": "The fingers closed without holding the target.",
    "too-wide-for-gripper": "The target does not fit between the fingers.",
    "slipped": "What was gripped slid out of the fingers while the robot moved.",
    "stalled": "The robot did not arrive where it was sent: something held it back.",
    "dropped": "The object left the hand before it was to be let go.",
    "unexpected-contact": "Something touched that was not to touch.",
    "side-effect": "The step changed something that was not its to change.",
    "precondition": "The step began in a state in which it cannot work.",
    "goal-not-reached": "All steps ran, but the state afterwards is not the goal.",
}


def failure_section(rollout: Rollout, frames: Frames | None) -> str:
    """Return the card about the failure that ended a rollout; empty for a success."""
    if rollout.succeeded:
        return ""
    failed = next((s for subtask in rollout.subtasks for s in subtask.steps if s.failure is not None), None)
    short = next((r for r in rollout.subtasks if not all(reading.satisfied for reading in r.readings)), None)
    if failed is not None and failed.failure is not None:
        story = _step_story(rollout, failed, failed.failure, frames)
    elif short is not None:
        name = readable(rollout.task.subtasks[short.index].name)
        head = f"<h3>Subtask {short.index + 1}, {text(name)}, did not reach its goal</h3>"
        story = f"{head}{readings_list(short.readings)}"
    elif any(not reading.satisfied for reading in rollout.goal_readings):
        story = f"<h3>The task goal does not hold at the end</h3>{readings_list(rollout.goal_readings)}"
    else:
        done, total = len(rollout.subtasks), pluralize(len(rollout.task.subtasks), "subtask")
        story = f"<h3>The rollout ended after {done} of {total}</h3><p>What was done until then is below.</p>"
    return f'<h2 id="failure">Why it failed</h2>{card(story, kind="bad")}'


def _step_story(rollout: Rollout, step: StepRecord, failure: Failure, frames: Frames | None) -> str:
    before = [s for s in rollout.subtasks[step.subtask].steps if s.step < step.step]
    context = f"It came after {text(action_text(before[-1].primitive, before[-1].action))}. " if before else ""
    reached = f"{sum(r.succeeded for r in rollout.subtasks)} of {pluralize(len(rollout.task.subtasks), 'subtask')}"
    where = f"step {step.step + 1} of subtask {step.subtask + 1}, {readable(rollout.task.subtasks[step.subtask].name)}"
    explained = f"{_FAILURE_MEANINGS[failure.kind.value]} {context}It is {text(where)}; {reached} had reached the goal."
    return (
        f"<h3>{text(action_text(step.primitive, step.action))} failed at {step.end_s:.1f} s</h3>"
        f"<p>{badge(failure.kind.value, 'bad')} {text(failure.message)}</p>{soft(explained)}"
        f"{measurements(measurements_json(failure.measurements))}{frame_strips(rollout, step, frames)}"
    )


def evolution_section(evolution: Evolution, pictures: AttemptPictures) -> str:
    """Return the section about an episode's revisions; empty when there were none and nothing was given up.

    Args:
        evolution: The episode.
        pictures: Pictures of its attempts.
    """
    stories = [story for story in evolution.stories if len(story.records) > 1 or story.gave_up is not None]
    if not stories:
        return ""
    ended = "reached its goal" if evolution.succeeded else "was given up"
    took = pluralize(evolution.revisions, "revision")
    parts = [soft(f"After {took} the task {ended}. Every attempt began from the same restored state.")]
    if evolution.faults:
        parts.append(f"{soft('Wrong on purpose:')}{bullets(evolution.faults)}")
    if not pictures.drawn:
        parts.append(soft(f"No pictures: {text(pictures.problem)}."))
    parts += [_story(evolution, story, pictures) for story in stories]
    return f"<h2 id='evolution'>How it evolved</h2>{''.join(parts)}"


def _story(evolution: Evolution, story: SubtaskStory, pictures: AttemptPictures) -> str:
    index = story.history.subtask
    name = readable(evolution.original.subtasks[index].name)
    state = badge("solved", "good") if story.solved else badge("not solved", "bad")
    attempts, before = [], None
    for number, (attempt, revision) in enumerate(story.history.iterations):
        drawn = pictures.drawn.get((index, number), {})
        attempts.append(_attempt(index, number, attempt, revision, before, drawn))
        before = attempt.flow
    gave_up = ""
    if story.gave_up is not None:
        reason = f"<p>{badge('gave up', 'bad')} {text(story.gave_up.reason)}</p>"
        gave_up = f"{reason}{_refused(story.gave_up.refused)}"
    title = f"<div class='row'><h3>{index + 1}. {text(name)}</h3>{state}</div>"
    return card(title, f"<div class='attempts'>{''.join(attempts)}</div>", gave_up)


def _attempt(
    index: int,
    number: int,
    attempt: Attempt,
    revision: Revision | None,
    before: ActionFlow | None,
    drawn: Mapping[str, Sequence[bytes]],
) -> str:
    won = attempt.succeeded
    label = badge("succeeded", "good") if won else badge(attempt.failure, "bad")
    flow = "".join(_flow(attempt.flow, before, None if won else shown_step(attempt)))
    message = f"<p>{text(attempt.message)}</p>" if attempt.message else ""
    faulty = (
        soft(f"<b>Step {critique.step + 1}.</b> {text(critique.text)}")
        for critique in attempt.critiques
        if critique.finds_fault and not won
    )
    rows = (
        strip(view, [(data, f"{view} view, picture {count}") for count, data in enumerate(pictures, start=1)])
        for view, pictures in drawn.items()
    )
    strips = f"<div class='strips'>{''.join(rows)}</div>" if drawn else ""
    return (
        f"<div class='attempt {'won' if won else 'lost'}'><div class='row'><b>Attempt {number + 1}</b>{label}</div>"
        f"<ol class='flow'>{flow}</ol>{message}{''.join(faulty)}{strips}{_therefore(index, attempt, revision)}</div>"
    )


def _flow(flow: ActionFlow, before: ActionFlow | None, at_fault: int | None) -> Iterator[str]:
    """Yield the flow's lines, with additions and removals marked against the flow before it."""
    old = list(before) if before is not None else list(flow)
    for tag, a0, a1, b0, b1 in SequenceMatcher(None, old, list(flow), autojunk=False).get_opcodes():
        if tag in ("delete", "replace"):
            yield from (f"<li class='gone'>{text(_action_line(action))}</li>" for action in old[a0:a1])
        for step in range(b0, b1):
            kinds = [*(["new"] if tag != "equal" else []), *(["at-fault"] if step == at_fault else [])]
            yield f"<li class='{' '.join(kinds)}'>{step + 1}. {text(_action_line(flow[step]))}</li>"


def _action_line(action: Action) -> str:
    return action_text(action.primitive.name, action.to_json())


def _therefore(index: int, attempt: Attempt, revision: Revision | None) -> str:
    if revision is None:
        return ""
    back = revision.subtask is not None and revision.subtask < index
    if back and attempt.succeeded:
        words = f"Undone: subtask {(revision.subtask or 0) + 1} was revised, for the sake of a later one."
        return f"<p class='therefore soft'>{words}</p>"
    where = badge(f"back to subtask {(revision.subtask or 0) + 1}", "warn") if back else badge(revision.change, "quiet")
    return f"<div class='therefore'>{where}{_refused(revision.refused)}<p>{text(revision.explanation)}</p></div>"


def _refused(answers: Sequence[str]) -> str:
    """Return the inadmissible answers, collapsed."""
    were = "1 answer was" if len(answers) == 1 else f"{len(answers)} answers were"
    head = f"{were} refused before anything moved"
    return fold(head, bullets(answers, tag="ol"), kind="soft") if answers else ""


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
    """Return the whole page as text.

    Args:
        record: The run's record.
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
    asked = pluralize(len(rollout.asked_for.subtasks), "subtask")
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
    rows = [(part, text(words)) for part, words in describe_peaks(asdict(rollout.peaks))]
    return card(facts(rows), soft("Of the arm's torques, that of joints 1 to 4 and that of joints 5 to 7."))


def _spent(spending: Spending) -> str:
    """Return the table of model rounds with seconds, tokens and cost, and the total."""
    rows = ((text(value) for value in row) for row in spending.rows())
    head = ("asked by", "round", "time", "tokens in + out", "cost")
    return card(table(rows, head), soft(text(spending.total())))


def versions() -> str:
    """Return names and installed versions of everything that a run's numbers depend on."""
    found = {"python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(f"{name} {version}" for name, version in found.items())


def _reproduce(record: RunRecord) -> str:
    """Return the section about how to repeat the run and how to check that it was the same."""
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
