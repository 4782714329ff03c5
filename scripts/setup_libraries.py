"""Sees to the shared libraries that SAPIEN needs and that a bare machine may lack, such as libX11.

They are fetched as packages of the distribution and laid into the folder of libraries that came with the
SAPIEN wheel, where it looks first; nothing on the system changes. Run it with the environment's own Python.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

from linked_libraries import library_folders, linked, missing
from private_apt import AptUnavailable, PrivateApt, unpack

PACKAGES = {
    "libX11.so.6": "libx11-6",
    "libxcb.so.1": "libxcb1",
    "libstdc++.so.6": "libstdc++6",
    "libgcc_s.so.1": "libgcc-s1",
    "libgomp.so.1": "libgomp1",
}


def say(words: str) -> None:
    """Write one line for the person who runs the set-up."""
    sys.stdout.write(f"[libraries] {words}\n")
    sys.stdout.flush()


def import_problem(module: str) -> str:
    """Return why a module cannot be imported in a fresh process, or ""."""
    command = [sys.executable, "-W", "ignore", "-c", f"import {module}"]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["the process died"])[-1]


def lay_beside(site_packages: Path, state: Path) -> tuple[str, ...]:
    """Fetches what SAPIEN's libraries lack and lays it beside them; returns the names of the libraries.

    Args:
        site_packages: The folder that SAPIEN is installed in.
        state: Folder for apt's private state, removed at the end.

    Raises:
        AptUnavailable: when the libraries cannot be had here.
    """
    own = site_packages / "sapien.libs"
    extension = next((site_packages / "sapien").glob("pysapien.cpython-*.so"), None)
    lacking = missing(extension) if extension else ()
    packages = tuple(PACKAGES[name] for name in lacking if name in PACKAGES)
    if extension is None or not packages or not own.is_dir():
        raise AptUnavailable("none of the libraries that may be fetched is missing")
    unpacked = state.with_name("unpacked")
    apt = PrivateApt(state)
    try:
        apt.refresh()
        unpack(apt.fetch(packages), unpacked)
        found = linked(extension, (own, *library_folders(unpacked)))
        laid = {name: path for name, path in found.items() if path and path.is_relative_to(unpacked)}
        for name, path in laid.items():
            shutil.copyfile(path.resolve(), own / name)
    finally:
        apt.close()
        shutil.rmtree(unpacked, ignore_errors=True)
    return tuple(sorted(laid))


def main() -> int:
    """Return 0 when SAPIEN can be imported, 1 otherwise."""
    problem = import_problem("sapien")
    spec = importlib.util.find_spec("sapien")
    if not problem or spec is None or spec.origin is None:
        return 0 if not problem else 1
    say(f"SAPIEN cannot be imported yet: {problem}")
    site_packages = Path(spec.origin).parent.parent
    try:
        laid = lay_beside(site_packages, Path(sys.prefix) / "share" / "scene2demo" / "apt")
        say(f"laid {', '.join(laid)} beside SAPIEN's own libraries, in {site_packages / 'sapien.libs'}")
    except AptUnavailable as error:
        say(str(error))
    problem = import_problem("sapien")
    if problem:
        say(f"SAPIEN still cannot be imported: {problem}")
        say(f"with root rights, on Debian or Ubuntu: apt-get install {' '.join(PACKAGES.values())}")
    return 1 if problem else 0


if __name__ == "__main__":
    sys.exit(main())
