"""Installs PyTorch, in the build for the CPU where one can be had: a tenth the size of the one for GPUs.

The project uses PyTorch for kinematics on the CPU only.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import tempfile
from pathlib import Path

INDEX_VARIABLE = "SCENE2DEMO_TORCH_INDEX"


def install_torch(python: Path, constraints: Path) -> str:
    """Installs PyTorch into the environment of `python`; returns a sentence that says from where.

    Tried in turn: an index that the user names, a wheel on this machine (pip's find-links), PyTorch's own index
    of CPU builds, which the installer uv knows by the name "cpu". Where none of them serves, pip takes what it is
    set up for, together with the project. Dependencies come then too, so a failed way leaves nothing behind.

    Args:
        python: The environment's interpreter.
        constraints: File with the line `torch==VERSION`.
    """
    wanted = _pinned("torch", constraints)
    pip = [str(python), "-m", "pip", "--disable-pip-version-check", "--no-input"]
    install = [*pip, "install", "--quiet", "--no-deps", "--progress-bar", "off"]
    index = os.environ.get(INDEX_VARIABLE)
    if index and _succeeds([*install, "--index-url", index, wanted]):
        return f"{wanted} comes from the index named in {INDEX_VARIABLE}"
    if _succeeds([*install, "--no-index", wanted]):
        return f"{wanted} comes from a wheel on this machine"
    if platform.system() != "Linux":
        return f"{wanted} comes with the project"
    with tempfile.TemporaryDirectory() as folder:
        uv = Path(folder) / "bin" / "uv"
        fetch = [*install, "--target", folder, _pinned("uv", constraints)]
        choose_cpu = ["--python", str(python), "--no-deps", "--torch-backend", "cpu", "--quiet", wanted]
        if _succeeds(fetch) and _succeeds([str(uv), "pip", "install", *choose_cpu]):
            return f"{wanted} comes from PyTorch's index of CPU builds"
    return (
        f"no CPU build of {wanted} can be had here: pip takes the default build, about 3 GB with its CUDA "
        f"packages (set {INDEX_VARIABLE} to an index with CPU builds to avoid that)"
    )


def _succeeds(command: list[str]) -> bool:
    """Tell whether a command ends well; its output is of no interest, since another way is tried then."""
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    return done.returncode == 0


def _pinned(name: str, constraints: Path) -> str:
    """Return the line of the constraints file that pins a package.

    Raises:
        ValueError: when there is none.
    """
    match = re.search(rf"^{name}==\S+", constraints.read_text(encoding="utf-8"), re.MULTILINE)
    if match is None:
        raise ValueError(f"{constraints} pins no version of {name}")
    return match.group()
