"""Makes this checkout ready to run: an environment in `.venv`, the libraries, and a renderer for the cameras.

`make demo` and `make test` call it; a second call finds its stamp and returns at once. It downloads from the
package registries that pip and apt are set up for, and installs nothing outside the checkout; pip keeps its own cache.

Environment variables: `SCENE2DEMO_TORCH_INDEX` names a package index to take PyTorch from.
"""

from __future__ import annotations

import hashlib
import platform
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
EXTRAS = "all,dev"


class SetUpFailed(RuntimeError):
    """Raised with a sentence for the person who runs the set-up."""


def say(words: str) -> None:
    """Writes one line for the person who runs the set-up."""
    sys.stdout.write(f"[set-up] {words}\n")
    sys.stdout.flush()


def fingerprint() -> str:
    """Returns a hash of all that decides what is installed; another value means another set-up."""
    digest = hashlib.sha256(f"{ROOT}\n{sys.version_info[:2]}\n".encode())
    for path in [ROOT / "pyproject.toml", CONSTRAINTS, *sorted((ROOT / "scripts").glob("*.py"))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def run(command: list[str], what: str) -> None:
    """Runs one command of the set-up.

    Raises:
        SetUpFailed: when it fails; its own words stand on the terminal by then.
    """
    done = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, check=False)
    if done.returncode != 0:
        raise SetUpFailed(f"{what} failed (exit status {done.returncode}); the lines above say why")


def pip(*arguments: str) -> list[str]:
    """Returns the command line of the environment's pip."""
    return [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments]


def usable() -> bool:
    """Tells whether `.venv` was made here, for this Python, and has pip; then only what changed is installed."""
    described = ENVIRONMENT / "pyvenv.cfg"
    if not described.is_file() or f" {ENVIRONMENT}\n" not in described.read_text(encoding="utf-8"):
        return False
    version = f"(python {sys.version_info[0]}.{sys.version_info[1]})"
    done = subprocess.run(pip("--version"), capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.rstrip().endswith(version)


def make_environment() -> None:
    """Makes an empty environment with pip in `.venv`."""
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


def set_up() -> None:
    """Does all steps in order and leaves the stamp.

    Raises:
        SetUpFailed: when a step that everything needs has failed.
    """
    began = time.monotonic()
    if usable():
        say("bringing .venv up to date")
    else:
        say(f"making .venv with Python {platform.python_version()} (about 2.5 GB with PyTorch and SAPIEN)")
        make_environment()
    say(install_torch(PYTHON, CONSTRAINTS))
    say(f"installing the project with its extras [{EXTRAS}]")
    packages = ["--constraint", str(CONSTRAINTS), "--editable", f".[{EXTRAS}]"]
    run(pip("install", "-qq", "--progress-bar", "off", *packages), "installing the packages")
    run([str(PYTHON), "scripts/setup_libraries.py"], "seeing to the shared libraries")
    run([str(PYTHON), "scripts/setup_renderer.py", "--optional"], "seeing to the renderer")
    STAMP.write_text(fingerprint() + "\n", encoding="utf-8")
    say(f"done in {time.monotonic() - began:.0f} s")


def main() -> int:
    """Returns 0 when the checkout is ready, 2 when it cannot be made ready here."""
    if PYTHON.exists() and STAMP.is_file() and STAMP.read_text(encoding="utf-8").strip() == fingerprint():
        return 0
    try:
        set_up()
    except SetUpFailed as error:
        say(str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
