"""Examine this machine: what works, what is missing, and what to do about it.

The result is data; the command line prints it. Nothing heavy is imported here: versions are read from the
installed packages' metadata, and the simulator is tried in processes of its own.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
from dataclasses import asdict, dataclass
from typing import Literal

from executor.system import extras, self_check, vulkan

Status = Literal["ok", "note", "problem"]

# Only whether they are set is ever looked at, and no value leaves this module.
MODEL_KEY_VARIABLES = ("OPENAI_API_KEY", "OPENAI_BASE_URL")
_REPORTED_VERSIONS = ("numpy", "scipy", "networkx", "lark")
_REPAIR = "In the checkout, run: make repair"
_OLDEST_PYTHON, _TOO_NEW_PYTHON = (3, 11), (3, 14)


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one examination.

    Attributes:
        topic: What, in a word or two.
        status: "ok", "note" (works, worth knowing) or "problem" (something will not work).
        detail: What was found, in one sentence.
        remedy: What to do; empty when there is nothing to do.
    """

    topic: str
    status: Status
    detail: str
    remedy: str = ""

    def to_json(self) -> dict[str, str]:
        """Return the finding as plain data."""
        return asdict(self)


def examine() -> tuple[Finding, ...]:
    """Return all findings, in a fixed order; dropping and drawing a box takes several seconds."""
    return (
        _python(),
        _core(),
        *(_extra(name) for name in extras.EXTRAS),
        _physics(),
        _rendering(),
        _model_key(),
        *_hazards(),
    )


def healthy(findings: tuple[Finding, ...]) -> bool:
    """Return whether no finding is a problem."""
    return all(finding.status != "problem" for finding in findings)


def _versions(distributions: tuple[str, ...]) -> str:
    return ", ".join(f"{name} {version}" for name in distributions if (version := extras.installed_version(name)))


def _python() -> Finding:
    detail = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, "
    detail += f"{os.cpu_count()} cores, in {sys.prefix}"
    if _OLDEST_PYTHON <= sys.version_info[:2] < _TOO_NEW_PYTHON:
        return Finding("python", "ok", detail)
    return Finding("python", "problem", detail, "Use Python 3.11, 3.12 or 3.13.")


def _core() -> Finding:
    own = extras.installed_version("scene2demo")
    detail = f"scene2demo {own or 'not installed'}; {_versions(_REPORTED_VERSIONS)}"
    if own is None:
        return Finding("packages", "note", detail, "In the checkout, run: make setup")
    return Finding("packages", "ok", detail)


def _extra(extra: str) -> Finding:
    """Return whether an extra's libraries are installed; a missing one hinders only what needs it."""
    missing = extras.missing(extra)
    if not missing:
        return Finding(f"extra {extra}", "ok", _versions(extras.EXTRAS[extra]))
    return Finding(f"extra {extra}", "note", f"not installed: {', '.join(missing)}", _install(extra))


def _install(extra: str) -> str:
    return f"In the checkout, run: {extras.install_command(extra)}"


def _physics() -> Finding:
    if "sapien" in extras.missing("sim"):
        return Finding("physics", "problem", "SAPIEN is not installed", _install("sim"))
    problem = self_check.problem_with("physics")
    if problem:
        return Finding("physics", "problem", f"SAPIEN does not run: {problem}", _REPAIR)
    return Finding("physics", "ok", "SAPIEN steps, and a box falls to the ground")


def _rendering() -> Finding:
    """Return how pictures are drawn; physics and planning do without."""
    renderer = vulkan.find_renderer()
    if not renderer:
        return Finding("rendering", "problem", renderer.why, renderer.remedy)
    if "sapien" in extras.missing("sim"):
        return Finding("rendering", "problem", "SAPIEN is not installed", _install("sim"))
    problem = self_check.problem_with("drawing")
    if problem:
        return Finding("rendering", "problem", f"{renderer.why}, and drawing fails: {problem}", _REPAIR)
    return Finding("rendering", "ok", renderer.why)


def _model_key() -> Finding:
    """Return which variables for a model are set, by name only."""
    present = [name for name in MODEL_KEY_VARIABLES if os.environ.get(name)]
    if present:
        return Finding("model", "ok", f"{' and '.join(present)} set; --model openai:NAME uses it")
    return Finding("model", "ok", "no key is set and none is needed: the offline planner serves")


def _hazards() -> tuple[Finding, ...]:
    """Return what is known to go wrong with packages that this environment happens to have."""
    found = []
    numpy = extras.installed_version("numpy") or ""
    mplib = extras.installed_version("mplib")
    if mplib and not numpy.startswith("1."):
        detail = f"mplib {mplib} with numpy {numpy}: its planner ends the process on numpy 2"
        found.append(Finding("mplib", "note", detail, "Nothing here uses it; pip uninstall mplib"))
    if importlib.util.find_spec("pinocchio") is not None:
        detail = "pinocchio can be imported: SAPIEN then solves inverse kinematics with it, about ten times slower"
        found.append(Finding("pinocchio", "note", detail, "pip uninstall pin"))
    found.append(_own_bddl())
    return tuple(found)


def _own_bddl() -> Finding:
    if other := extras.installed_version("bddl"):
        detail = f"another distribution named bddl ({other}) is installed; this project's own is found first"
        return Finding("bddl", "note", detail, "pip uninstall bddl")
    return Finding("bddl", "ok", "this project's own package is found")
