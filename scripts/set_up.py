"""Makes this checkout ready to run: an environment in `.venv`, the libraries, and a renderer for the cameras.

`make` calls it with a level: `demo` is what `scene2demo run` needs, `all` every extra, `test` the developer's tools
as well. It finds in its stamp what is installed, and returns at once when that is enough. It downloads from the
package registries that pip and apt are set up for, and installs nothing outside the checkout; pip keeps its own cache.

Environment variables: `SCENE2DEMO_TORCH_INDEX` names a package index to take PyTorch from.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from private_apt import AptUnavailable, PrivateApt, unpack
from torch_cpu import install_torch

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = ROOT / ".venv"
PYTHON = ENVIRONMENT / "bin" / "python"
STAMP = ENVIRONMENT / "scene2demo-set-up"
CONSTRAINTS = ROOT / "constraints.txt"
EXTRAS = {"demo": "sim,data", "all": "all", "test": "all,dev"}
"""What is installed at each level; each has all of those before it."""

SIZES = {"demo": "1.5 GB", "all": "2.5 GB", "test": "2.8 GB"}
LEVELS = tuple(EXTRAS)
_LAST_LINES = 20  # Of pip's, shown where it fails.


class SetUpFailed(RuntimeError):
    """Raised with a sentence for the person who runs the set-up."""


def say(words: str) -> None:
    """Write one line for the person who runs the set-up."""
    sys.stdout.write(f"[set-up] {words}\n")
    sys.stdout.flush()


def fingerprint() -> str:
    """Return a hash of all that decides what is installed; another value means another set-up."""
    digest = hashlib.sha256(f"{ROOT}\n{sys.version_info[:2]}\n".encode())
    for path in [ROOT / "pyproject.toml", CONSTRAINTS, *sorted((ROOT / "scripts").glob("*.py"))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def installed() -> str:
    """Return the level that is installed, whatever has changed since then; empty where there is none."""
    words = STAMP.read_text(encoding="utf-8").split() if STAMP.is_file() and PYTHON.exists() else []
    return words[1] if len(words) == 2 and words[1] in LEVELS else ""


def enough(level: str) -> bool:
    """Decide whether what is installed is of today's files, and of this level or a later one."""
    if not installed() or LEVELS.index(installed()) < LEVELS.index(level):
        return False
    return STAMP.read_text(encoding="utf-8").split()[0] == fingerprint()


def run(command: list[str], what: str) -> None:
    """Run one command of the set-up.

    Raises:
        SetUpFailed: when it fails; its own words stand on the terminal by then.
    """
    done = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, check=False)
    if done.returncode != 0:
        raise SetUpFailed(f"{what} failed (exit status {done.returncode}); the lines above say why")


def pip(*arguments: str) -> list[str]:
    """Return the command line of the environment's pip."""
    return [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments]


def usable() -> bool:
    """Tell whether `.venv` was made here, for this Python, and has pip; then only what changed is installed."""
    described = ENVIRONMENT / "pyvenv.cfg"
    if not described.is_file() or f" {ENVIRONMENT}\n" not in described.read_text(encoding="utf-8"):
        return False
    version = f"(python {sys.version_info[0]}.{sys.version_info[1]})"
    done = subprocess.run(pip("--version"), capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.rstrip().endswith(version)


def make_environment() -> None:
    """Make an empty environment with pip in `.venv`."""
    shutil.rmtree(ENVIRONMENT, ignore_errors=True)
    plain = [sys.executable, "-m", "venv", str(ENVIRONMENT)]
    done = subprocess.run(plain, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    if done.returncode == 0:
        return
    # Debian and Ubuntu ship Python without the part of venv that brings pip along (package python3-venv).
    say("this Python cannot bring pip into an environment (python3-venv is not installed)")
    shutil.rmtree(ENVIRONMENT, ignore_errors=True)
    run([*plain, "--without-pip"], "making an environment")
    say("fetching pip as the distribution's package python3-pip-whl and unpacking it inside .venv only")
    state, unpacked = ENVIRONMENT / "apt", ENVIRONMENT / "unpacked"
    try:
        apt = PrivateApt(state)
        apt.refresh()
        unpack(apt.fetch(("python3-pip-whl",)), unpacked)
        wheel = next(unpacked.rglob("pip-*.whl"))
        run([str(PYTHON), f"{wheel}/pip", "install", "--quiet", "--no-index", str(wheel)], "installing pip")
    except (AptUnavailable, StopIteration) as error:
        remedy = "install it with root rights and start again: apt-get install python3-venv"
        raise SetUpFailed(f"pip cannot be had without python3-venv ({error}); {remedy}") from error
    finally:
        shutil.rmtree(state, ignore_errors=True)
        shutil.rmtree(unpacked, ignore_errors=True)


def install(packages: list[str]) -> None:
    """Installs packages, and shows what pip is at: one moving line on a terminal, else a line a package.

    Raises:
        SetUpFailed: when pip fails; its own words stand on the terminal by then.
    """
    moves, last, count = sys.stdout.isatty(), list[str](), 0
    command = pip("install", "--progress-bar", "off", *packages)
    at_once, said = {**os.environ, "PYTHONUNBUFFERED": "1"}, subprocess.PIPE
    with subprocess.Popen(
        command, cwd=ROOT, env=at_once, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT, text=True
    ) as process:
        for line in process.stdout or ():
            last = [*last, line][-_LAST_LINES:]
            what = re.match(r"(?:Downloading|Using cached) (?:\S*/)?([^/\s]+)\.(?:whl|tar\.gz) (\(.*\))", line.strip())
            count += what is not None
            if what is not None:
                shown = f"[set-up]   {count}: {what[1]} {what[2]}"
            elif line.startswith("Installing collected packages"):
                shown = f"[set-up]   writing {line.count(',') + 1} packages into .venv"
            else:
                continue
            sys.stdout.write(f"\r\x1b[K{shown[:100]}" if moves else f"{shown}\n")
            sys.stdout.flush()
    if moves:
        sys.stdout.write("\r\x1b[K")
    if process.returncode != 0:
        sys.stdout.writelines(last)
        raise SetUpFailed(f"installing the packages failed (exit status {process.returncode}); the lines above say why")


def set_up(level: str) -> None:
    """Do all steps in order and leaves the stamp.

    Args:
        level: What is to be installed at least; what is there already stays.

    Raises:
        SetUpFailed: when a step that everything needs has failed.
    """
    began = time.monotonic()
    if usable():
        level = max(level, installed() or level, key=LEVELS.index)
        say("bringing .venv up to date")
    else:
        python = platform.python_version()
        say(f"making .venv with Python {python}: about {SIZES[level]}, and one to three minutes near a mirror")
        make_environment()
    if level != "demo":
        say("fetching PyTorch, about 200 MB in its build for the CPU")
        say(install_torch(PYTHON, CONSTRAINTS))
    say(f"installing the project with its extras [{EXTRAS[level]}]")
    install(["--constraint", str(CONSTRAINTS), "--editable", f".[{EXTRAS[level]}]"])
    say("looking for shared libraries that the simulator needs")
    run([str(PYTHON), "scripts/setup_libraries.py"], "seeing to the shared libraries")
    say("looking for a renderer, and drawing a picture with it; where there is none, 20 to 60 MB are fetched")
    run([str(PYTHON), "scripts/setup_renderer.py", "--optional"], "seeing to the renderer")
    STAMP.write_text(f"{fingerprint()} {level}\n", encoding="utf-8")
    say(f"done in {time.monotonic() - began:.0f} s")


def main(arguments: list[str]) -> int:
    """Return 0 when the checkout is ready at a level, by default `all`; 2 when it cannot be made ready here."""
    level = arguments[0] if arguments else "all"
    try:
        if level not in LEVELS:
            raise SetUpFailed(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
        if not enough(level):
            set_up(level)
    except SetUpFailed as error:
        say(str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
