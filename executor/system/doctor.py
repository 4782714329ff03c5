"""Examine this machine: what works, what is missing, and what to do about it.

The result is data; the command line prints it. Nothing heavy is imported here: versions are read from the
installed packages' metadata, and the simulator is tried in processes of its own, since a broken library can end its
process: `python -m executor.system.doctor physics` lets a box fall to the ground; `... drawing` draws one and looks for
it in the picture. Exit status 0 means that it worked. Otherwise the last line of standard error has the reason.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
from dataclasses import asdict, dataclass
from typing import Any, Literal

from executor.system import extras, vulkan

Status = Literal["ok", "note", "problem"]
Check = Literal["physics", "drawing"]

_TIMEOUT_S = 300.0
_BOX_HALF_M = 0.2
_DROP_M = 0.1
_REST_TOLERANCE_M = 0.01
_STEPS = 250
_SIZE_PX = 64
_VISIBLE_STEP = 0.05

# Only whether they are set is ever looked at, and no value leaves this module.
MODEL_KEY_VARIABLES = ("OPENAI_API_KEY", "OPENAI_BASE_URL")
_REPORTED_VERSIONS = ("numpy", "scipy", "networkx", "lark")
_REPAIR = "In the checkout, run: make repair"
_OLDEST_PYTHON, _TOO_NEW_PYTHON = (3, 11), (3, 14)


@dataclass(frozen=True, slots=True)
class DoctorFinding:
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


def examine() -> tuple[DoctorFinding, ...]:
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


def healthy(findings: tuple[DoctorFinding, ...]) -> bool:
    """Return whether no finding is a problem."""
    return all(finding.status != "problem" for finding in findings)


def _versions(distributions: tuple[str, ...]) -> str:
    return ", ".join(f"{name} {version}" for name in distributions if (version := extras.installed_version(name)))


def _python() -> DoctorFinding:
    detail = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, "
    detail += f"{os.cpu_count()} cores, in {sys.prefix}"
    if _OLDEST_PYTHON <= sys.version_info[:2] < _TOO_NEW_PYTHON:
        return DoctorFinding("python", "ok", detail)
    return DoctorFinding("python", "problem", detail, "Use Python 3.11, 3.12 or 3.13.")


def _core() -> DoctorFinding:
    own = extras.installed_version("scene2demo")
    detail = f"scene2demo {own or 'not installed'}; {_versions(_REPORTED_VERSIONS)}"
    if own is None:
        return DoctorFinding("packages", "note", detail, "In the checkout, run: make setup")
    return DoctorFinding("packages", "ok", detail)


def _extra(extra: str) -> DoctorFinding:
    """Return whether an extra's libraries are installed; a missing one hinders only what needs it."""
    missing = extras.missing(extra)
    if not missing:
        return DoctorFinding(f"extra {extra}", "ok", _versions(extras.EXTRAS[extra]))
    return DoctorFinding(f"extra {extra}", "note", f"not installed: {', '.join(missing)}", _install(extra))


def _install(extra: str) -> str:
    return f"In the checkout, run: {extras.install_command(extra)}"


def _physics() -> DoctorFinding:
    if "sapien" in extras.missing("sim"):
        return DoctorFinding("physics", "problem", "SAPIEN is not installed", _install("sim"))
    problem = problem_with("physics")
    if problem:
        return DoctorFinding("physics", "problem", f"SAPIEN does not run: {problem}", _REPAIR)
    return DoctorFinding("physics", "ok", "SAPIEN steps, and a box falls to the ground")


def _rendering() -> DoctorFinding:
    """Return how pictures are drawn; physics and planning do without."""
    renderer = vulkan.find_renderer()
    if not renderer:
        return DoctorFinding("rendering", "problem", renderer.why, renderer.remedy)
    if "sapien" in extras.missing("sim"):
        return DoctorFinding("rendering", "problem", "SAPIEN is not installed", _install("sim"))
    problem = problem_with("drawing")
    if problem:
        return DoctorFinding("rendering", "problem", f"{renderer.why}, and drawing fails: {problem}", _REPAIR)
    return DoctorFinding("rendering", "ok", renderer.why)


def _model_key() -> DoctorFinding:
    """Return which variables for a model are set, by name only."""
    present = [name for name in MODEL_KEY_VARIABLES if os.environ.get(name)]
    if present:
        return DoctorFinding("model", "ok", f"{' and '.join(present)} set; --model openai:NAME uses it")
    return DoctorFinding("model", "ok", "no key is set and none is needed: the offline planner serves")


def _hazards() -> tuple[DoctorFinding, ...]:
    """Return what is known to go wrong with packages that this environment happens to have."""
    found = []
    numpy = extras.installed_version("numpy") or ""
    mplib = extras.installed_version("mplib")
    if mplib and not numpy.startswith("1."):
        detail = f"mplib {mplib} with numpy {numpy}: its planner ends the process on numpy 2"
        found.append(DoctorFinding("mplib", "note", detail, "Nothing here uses it; pip uninstall mplib"))
    if importlib.util.find_spec("pinocchio") is not None:
        detail = "pinocchio can be imported: SAPIEN then solves inverse kinematics with it, about ten times slower"
        found.append(DoctorFinding("pinocchio", "note", detail, "pip uninstall pin"))
    found.append(_own_bddl())
    return tuple(found)


def _own_bddl() -> DoctorFinding:
    if other := extras.installed_version("bddl"):
        detail = f"another distribution named bddl ({other}) is installed; this project's own is found first"
        return DoctorFinding("bddl", "note", detail, "pip uninstall bddl")
    return DoctorFinding("bddl", "ok", "this project's own package is found")


def problem_with(check: Check) -> str:
    """Return why a check fails in a process of its own; "" when it works."""
    command = [sys.executable, "-m", "executor.system.doctor", check]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"it took longer than {_TIMEOUT_S:.0f} s"
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"the process died (exit status {done.returncode})"])[-1]


def _resting_height_m(sapien: Any) -> float:
    """Return the height of a box's centre above the ground after it fell for a second."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.add_ground(0.0, render=False)
    builder = scene.create_actor_builder()
    builder.add_box_collision(half_size=[_BOX_HALF_M] * 3)
    builder.initial_pose = sapien.Pose([0.0, 0.0, _BOX_HALF_M + _DROP_M])
    box = builder.build(name="box")
    scene.set_timestep(1.0 / _STEPS)
    for _ in range(_STEPS):
        scene.step()
    return float(box.pose.p[2])


def _centre_contrast(sapien: Any) -> float:
    """Return how much brighter the picture's centre, where a lit box stands, is than its corner."""
    scene = sapien.Scene()
    scene.set_ambient_light([0.5, 0.5, 0.5])
    scene.add_directional_light([1, 0, -1], [1, 1, 1])
    builder = scene.create_actor_builder()
    builder.add_box_visual(half_size=[_BOX_HALF_M] * 3, material=[1.0, 1.0, 1.0])
    builder.initial_pose = sapien.Pose([1.0, 0.0, 0.0])
    builder.build_kinematic(name="box")
    camera = scene.add_camera("check", _SIZE_PX, _SIZE_PX, fovy=1.0, near=0.01, far=10.0)
    scene.step()
    scene.update_render()
    camera.take_picture()
    picture = camera.get_picture("Color")[..., :3]
    middle = _SIZE_PX // 2
    return float(picture[middle, middle].mean() - picture[0, 0].mean())


def main(arguments: list[str]) -> int:
    """Return 0 when the named check works, 1 when it gives a wrong result, 2 when there is no such check."""
    if arguments == ["physics"]:
        sapien = extras.load_sapien()

        height_m = _resting_height_m(sapien)
        if abs(height_m - _BOX_HALF_M) < _REST_TOLERANCE_M:
            return 0
        sys.stderr.write(f"a box that fell rests at {height_m:.3f} m instead of {_BOX_HALF_M} m\n")
        return 1
    if arguments == ["drawing"]:
        vulkan.activate()
        sapien = extras.load_sapien()

        contrast = _centre_contrast(sapien)
        if contrast > _VISIBLE_STEP:
            return 0
        sys.stderr.write(f"the box is not to be seen in the picture (contrast {contrast:.3f})\n")
        return 1
    sys.stderr.write('name one check: "physics" or "drawing"\n')
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
