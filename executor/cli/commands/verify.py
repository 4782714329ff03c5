"""`scene2demo verify`: the verdict about a task file, its certificate, and the task repaired or completed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from executor.cli.errors import DONE, FAILED, BadOption
from executor.cli.options import CommonOptions, DomainFile, Maybe, OptionalScene, ReplaceFile, TaskFile
from executor.cli.output import print_json, say, tell
from executor.system.files import write_json

if TYPE_CHECKING:
    from oag import Fix, Report


@dataclass(frozen=True)
class Options(CommonOptions):
    """Decide whether a task's plan reaches its goal, without moving anything."""

    task: TaskFile
    scene: OptionalScene = None
    domain: DomainFile = None
    out: Maybe[Path] = None
    """File for the task: with a fix applied when the plan is refuted, else with the flows that were searched; its
    folder is made when absent."""
    apply: Maybe[int] = None
    """Which fix to apply, by its number; by default the first, which is the smallest that proves the plan."""
    certificate: Maybe[Path] = None
    """File for the certificate, which `recheck` checks; its folder is made when absent."""
    force: ReplaceFile = False


def execute(options: Options) -> int:
    """Print the verdict with its findings, and write the task and the certificate where requested.

    Returns:
        0 when the plan is proved, or a repaired one that is has been written; else 1.
    """
    from executor.cli.inputs import domain_in, query_in, refuse_existing, task_and_scene
    from llm.offline.rereading import other_readings
    from oag import Verdict, canonical_digest, compose

    if options.apply is not None and options.out is None:
        raise BadOption("--apply", options.apply, "--out with the file that the repaired task goes to")
    for name, path in (("--out", options.out), ("--certificate", options.certificate)):
        if path is not None:
            refuse_existing(path, force=options.force, option=name)
    task, scene = task_and_scene(options.task, options.scene, domain_in(options.domain), is_built=False)
    report = compose(task, scene=scene).verify()
    if report.trace is not None:
        # Sentences of a malformed task are compared with nothing.
        report = report.with_findings(other_readings(task, scene, query=query_in(options.task)))
    if options.apply is not None and report.verdict is not Verdict.REFUTED:
        raise BadOption("--apply", options.apply, f"no number: the plan is {report.verdict.value}, so it has no fixes")
    fix = _chosen(report, options.apply) if options.out is not None and report.verdict is Verdict.REFUTED else None
    if options.json:
        digest = canonical_digest(task, scene) if report else None
        print_json({"ok": bool(report), **report.to_json(), "canonical": digest})
    else:
        say(str(report))
    if options.certificate is not None:
        _write_certificate(report, options.certificate)
    if options.out is None or (fix is None and report.verdict is Verdict.REFUTED):
        return DONE if report else FAILED
    if fix is None:
        write_json(options.out, report.task.to_json())
        tell(f"\nwritten to {options.out}: the task as it was verified, {_describe_flows(report)}")
        return DONE if report else FAILED
    write_json(options.out, fix.apply(report.task).to_json())
    tell(f"\nwritten to {options.out}: {fix}")
    return DONE if fix.proves else FAILED


def _write_certificate(report: Report, path: Path) -> None:
    """Write the certificate, or print why there is none."""
    if report.certificate is None:
        tell(f"\n{path} is not written: there is no certificate; what is said above cannot be listed step by step")
        return
    write_json(path, report.certificate.to_json())
    tell(f"\ncertificate written to {path}: scene2demo recheck {path}")


def _describe_flows(report: Report) -> str:
    """Return the note about searched flows in the written task."""
    count = sum(finding.code == "flow/searched" for finding in report.diagnostics)
    return f"{count} of its flows searched" if count else "unchanged"


def _chosen(report: Report, number: int | None) -> Fix | None:
    """Return the fix of a number, counted from 1; None when none is offered and none was named."""
    if number is None and not report.fixes:
        tell("no fix was found, so nothing is written")
        return None
    index = 0 if number is None else number - 1
    if not 0 <= index < len(report.fixes):
        count = len(report.fixes)
        raise BadOption("--apply", number, f"a number from 1 to {count}" if count else "nothing: no fix was found")
    fix = report.fixes[index]
    if fix.assumption:
        tell("the fix states a fact of the scene: add it to the scene's file if it is so; nothing is written")
        return None
    return fix
