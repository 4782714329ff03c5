"""The plan before anything moved: verdict, certificate in words, findings."""

from __future__ import annotations

from textwrap import dedent

from bddl.visible import counted
from executor.results.report.html import badge, bullets, card, fold, soft, table, text
from oag import Diagnostic, Grade, Obligation, Report, Verdict, recheck
from oag.progression.progress import producer_place
from oag.task.task import step_place, subtask_place

_TONES = {Verdict.PROVED: "good", Verdict.CONDITIONAL: "warn", Verdict.REFUTED: "bad"}
_GRADES = {Grade.HOLDS: "good", Grade.POSSIBLE: "warn", Grade.FAILS: "bad"}
_MEANING = {
    Verdict.PROVED: "From every state that agrees with what is known, each step's precondition holds when the step "
    "begins, each subtask ends in its goal, and the last state satisfies the task goal.",
    Verdict.CONDITIONAL: "The plan reaches its goal if what is listed as unknown below turns out to hold.",
    Verdict.REFUTED: "There is a state that agrees with everything known from which this plan fails.",
}


def verdict_badge(report: Report) -> str:
    """Returns the verdict as a label."""
    return badge(report.verdict.value.lower(), _TONES[report.verdict])


def plan_section(report: Report) -> str:
    """Returns the section about the plan: what was decided, on what it rests, and why each step may run."""
    held = sum(obligation.grade is Grade.HOLDS for obligation in report.obligations)
    total = len(report.obligations)
    counts = f"{held} of {counted(total, 'obligation')} hold" if total else "the plan is not well formed"
    goal = (
        f"<span class='soft'>Task goal, {text(report.goal_source)}</span> <code>{text(report.to_json()['goal'])}</code>"
    )
    parts = [f'<div class="row">{verdict_badge(report)}<span>{counts}</span></div>']
    parts += [f"<p>{text(_MEANING[report.verdict])}</p>", f"<p>{goal}</p>"]
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
    """Returns the certificate in words: what is needed where, and who sees to it."""
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
