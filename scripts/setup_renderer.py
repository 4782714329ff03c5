"""Sees to a Vulkan driver that SAPIEN can draw with; changes nothing on the system.

When the machine has none, a recent Mesa lavapipe (a software renderer) is fetched as packages of the
distribution, its backports included, and unpacked beside the Python environment, with the libraries that the
machine lacks. Run it with the environment's own Python: `.venv/bin/python scripts/setup_renderer.py`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from linked_libraries import library_folders, linked, loading_order, missing
from private_apt import AptUnavailable, PrivateApt, unpack

from executor.system import doctor, vulkan

PACKAGE = "mesa-vulkan-drivers"
DRIVER = "libvulkan_lvp.so"


def say(words: str) -> None:
    """Write one line for the person who runs the set-up."""
    sys.stdout.write(f"[renderer] {words}\n")
    sys.stdout.flush()


def fetch_driver(apt: PrivateApt, into: Path) -> str:
    """Unpack lavapipe and what it needs; returns the driver's version.

    Raises:
        AptUnavailable: when no source has a recent enough version.
    """
    apt.refresh()
    seen = []
    for suite in (None, f"{apt.sources.codename}-backports"):
        version = apt.candidate(PACKAGE, suite)
        if version is None:
            continue
        upstream = version.split(":")[-1].split("-")[0]
        if vulkan.version_tuple(upstream) >= vulkan.LAVAPIPE_MINIMUM:
            packages = apt.fetch((PACKAGE,), suite)
            size_mb = sum(path.stat().st_size for path in packages) / 1e6
            say(f"fetched {PACKAGE} {version} and {len(packages) - 1} other packages, {size_mb:.0f} MB")
            unpack(packages, into)
            return upstream
        seen.append(version)
    wanted = ".".join(map(str, vulkan.LAVAPIPE_MINIMUM))
    offered = f"the sources offer only {', '.join(seen)}" if seen else "the sources do not have it"
    raise AptUnavailable(f"{PACKAGE} >= {wanted} is needed and {offered}")


def keep_what_is_needed(unpacked: Path, prefix: Path, version: str) -> None:
    """Copy the driver and its private libraries to `prefix`, and writes both manifests.

    Args:
        unpacked: The unpacked packages.
        prefix: Where to; replaced as a whole.
        version: The driver's version.

    Raises:
        AptUnavailable: when a library is still missing, with its name.
    """
    folders = library_folders(unpacked)
    driver = next(iter(unpacked.rglob(DRIVER)), None)
    icd_source = next(iter(sorted(unpacked.rglob("lvp_icd*.json"))), None)
    if driver is None or icd_source is None:
        raise AptUnavailable(f"{PACKAGE} {version} has no {DRIVER}")
    if lost := missing(driver, folders):
        raise AptUnavailable(f"the driver needs libraries that no fetched package has: {', '.join(lost)}")
    own = {name: path for name, path in linked(driver, folders).items() if path and path.is_relative_to(unpacked)}

    fresh = prefix.with_name(prefix.name + ".new")
    shutil.rmtree(fresh, ignore_errors=True)
    (fresh / "lib").mkdir(parents=True)
    for name, path in {**own, DRIVER: driver}.items():
        shutil.copyfile(path.resolve(), fresh / "lib" / name)
    for note in unpacked.glob("usr/share/doc/*/copyright"):
        if note.is_file():
            (fresh / "copyright").mkdir(exist_ok=True)
            shutil.copyfile(note, fresh / "copyright" / f"{note.parent.name}.txt")
    ordered = loading_order(tuple(fresh / "lib" / name for name in own), (fresh / "lib",))

    icd = json.loads(icd_source.read_text(encoding="utf-8"))
    icd["ICD"]["library_path"] = str(prefix / "lib" / DRIVER)
    (fresh / "lvp_icd.json").write_text(json.dumps(icd, indent=2) + "\n", encoding="utf-8")
    manifest = {
        "icd": "lvp_icd.json",
        "version": version,
        "preload": [f"lib/{path.name}" for path in ordered],
    }
    (fresh / vulkan.MANIFEST_NAME).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    shutil.rmtree(prefix, ignore_errors=True)
    fresh.rename(prefix)


def install(prefix: Path, state: Path) -> None:
    """Installs the private driver.

    Args:
        prefix: Where it will stand.
        state: Folder for apt's private state, removed at the end.

    Raises:
        AptUnavailable: when it cannot be had here; nothing is left behind.
    """
    if sys.platform != "linux":
        raise AptUnavailable(f"the private driver exists for Linux only, not for {sys.platform}")
    unpacked = prefix.with_name("unpacked")
    apt = PrivateApt(state)
    try:
        keep_what_is_needed(unpacked, prefix, fetch_driver(apt, unpacked))
    finally:
        apt.close()
        shutil.rmtree(unpacked, ignore_errors=True)


def drawing_problem() -> str:
    """Return why nothing can be drawn, or "" when a picture was drawn."""
    found = vulkan.find_renderer()
    if not found:
        return found.why
    problem = doctor.problem_with("drawing")
    return f"{found.why}, and drawing fails: {problem}" if problem else ""


def main() -> int:
    """Return 0 when pictures can be drawn, 1 otherwise; `--optional` makes that 0 too."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--force", action="store_true", help="install the private driver in any case")
    parser.add_argument("--optional", action="store_true", help="go on without cameras when there is no driver")
    options = parser.parse_args()
    prefix = vulkan.private_prefix()
    problem = "" if options.force else drawing_problem()
    if not options.force and not problem:
        say(f"draws with {vulkan.find_renderer().why}")
        return 0
    say(f"{problem or 'asked for'}: fetching Mesa lavapipe into {prefix}")
    try:
        install(prefix, prefix.with_name("apt"))
        problem = drawing_problem()
        if not problem:
            say(f"draws with {vulkan.find_renderer().why}")
            return 0
        say(problem)
    except AptUnavailable as error:
        say(str(error))
    say("without a driver everything but the cameras works: planning, proofs, physics and datasets of states")
    say("with root rights a driver comes with: apt-get install mesa-vulkan-drivers (version 24.3 or newer)")
    return 0 if options.optional else 1


if __name__ == "__main__":
    sys.exit(main())
