"""The plan before anything moved: verdict, certificate in words, findings."""

from __future__ import annotations

from textwrap import dedent

from bddl.visible import counted
from executor.results.report.html import badge, text
from oag import Diagnostic, Grade, Obligation, Report, Verdict, recheck
from oag.progression.progress import producer_place
from oag.task.task import step_place, subtask_place

_TONES = {Verdict.PROVED: "good", Verdict.CONDITIONAL: "warn", Verdict.REFUTED: "bad"}
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
    parts = [f'<div class="card"><div class="row">{verdict_badge(report)}<span>{_counts(report)}</span></div>']
    parts.append(f"<p>{text(_MEANING[report.verdict])}</p>")
    parts.append(f"<p><span class='soft'>Task goal, {text(report.goal_source)}</span> <code>{_goal(report)}</code></p>")
    if report.assumptions:
        rests = "".join(f"<li>{text(line)}</li>" for line in report.assumptions)
        parts.append(f"<p class='soft'>It rests on the scene's facts and on:</p><ul>{rests}</ul>")
    if report.certificate is not None:
        checked = recheck(report.certificate)
        tone = "good" if checked else "bad"
        words = "confirmed by the independent checker" if checked else "not confirmed by the independent checker"
        parts.append(f"<p>{badge(words, tone)} <span class='soft'>{text(checked.reason)}</span></p>")
    parts.append("</div>")
    parts += [_finding(finding) for finding in report.diagnostics]
    if report.obligations:
        parts.append(_reasons(report))
    return "".join(parts)


def _counts(report: Report) -> str:
    held = sum(obligation.grade is Grade.HOLDS for obligation in report.obligations)
    total = len(report.obligations)
    return f"{held} of {counted(total, 'obligation')} hold" if total else "the plan is not well formed"


def _goal(report: Report) -> str:
    return text(report.to_json()["goal"])


def _finding(finding: Diagnostic) -> str:
    tone = {"error": "bad", "warning": "warn"}.get(finding.severity, "quiet")
    words = dedent("\n".join(str(finding).splitlines()[1:]))
    state = " open" if finding.severity == "error" else ""
    return (
        f'<details class="card"{state}><summary>{badge(finding.severity, tone)} '
        f"<b>{text(finding.code)}</b> <span class='soft'>{text(finding.place)}</span></summary>"
        f"<pre>{text(words)}</pre></details>"
    )


def _reasons(report: Report) -> str:
    """Returns the certificate in words: what is needed where, and who sees to it."""
    rows = "".join(
        f"<tr><td>{text(_place(report, obligation))}</td><td>{_needs(obligation)}</td>"
        f"<td>{_by(report, obligation)}</td><td>{_grade(obligation)}</td></tr>"
        for obligation in report.obligations
    )
    return (
        "<details class='card'><summary><b>The certificate in words</b> <span class='soft'>what every step needs, and "
        "what sees to it</span></summary><div class='scroll'><table><thead><tr><th>Where</th><th>Needs</th>"
        f"<th>Because of</th><th></th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    )


def _place(report: Report, obligation: Obligation) -> str:
    if obligation.kind == "task-goal":
        return "the task goal"
    if obligation.kind == "precondition":
        return step_place(report.task, obligation.subtask, obligation.step)
    return f"{subtask_place(report.task, obligation.subtask)}, {'start' if obligation.kind == 'init' else 'goal'}"


def _needs(obligation: Obligation) -> str:
    return "<br>".join(text(link.condition.text()) for link in obligation.links) or "<span class='soft'>nothing</span>"


def _by(report: Report, obligation: Obligation) -> str:
    if report.trace is None:
        return ""
    return "<br>".join(text(producer_place(report.trace, link.producer)) for link in obligation.links)


def _grade(obligation: Obligation) -> str:
    tones = {Grade.HOLDS: "good", Grade.POSSIBLE: "warn", Grade.FAILS: "bad"}
    return badge(obligation.grade.value.lower(), tones[obligation.grade])
