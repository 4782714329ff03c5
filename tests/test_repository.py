"""What does not belong into the repository is not in it, and its few lists agree with each other."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from executor.system import extras
from tests.source_tree import ROOT, files

MESHES_AND_MEDIA = {".stl", ".dae", ".obj", ".glb", ".gltf", ".ply", ".usd", ".mp4", ".h5", ".hdf5", ".parquet"}
WHEELS_AND_BINARIES = {".so", ".whl", ".deb", ".pyc", ".pkl", ".npz"}
LARGEST_KB = 1500
# Written in pieces, so that this file does not find itself.
REGISTRY_HOSTS = [
    "py" + "pi.org", "python" + "hosted.org", "download.py" + "torch.org", "deb.deb" + "ian.org",
    "registry.np" + "mjs.org", "anaconda" + ".org",
]  # fmt: skip
# Notes of the planning, which no reader of the repository has.
PLANNING_NOTES = re.compile("planning" + r"\s+anchor|\banchors" + "/", re.IGNORECASE)
MACHINE_PATH = re.compile(r"(?<![\w.~$}{-])/(?:root|home|work|mnt|Users)/\w")


def texts() -> dict[Path, str]:
    """Return path -> text of every text file of the repository."""
    found = {}
    for path in files():
        try:
            found[path.relative_to(ROOT)] = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
    return found


def test_no_absolute_path_of_a_machine() -> None:
    found = [str(path) for path, text in texts().items() if MACHINE_PATH.search(text)]
    assert not found


def test_no_package_registry_is_named() -> None:
    found = [str(path) for path, text in texts().items() if any(host in text for host in REGISTRY_HOSTS)]
    assert not found


def test_no_planning_note_is_cited() -> None:
    assert PLANNING_NOTES.search("Source: planning" + " anchor 3.2") and PLANNING_NOTES.search("see anchors" + "/3.md")
    assert not [str(path) for path, text in texts().items() if PLANNING_NOTES.search(text)]


def test_no_meshes_binaries_or_large_files() -> None:
    unwanted = MESHES_AND_MEDIA | WHEELS_AND_BINARIES
    assert not [str(path.relative_to(ROOT)) for path in files() if path.suffix.lower() in unwanted]
    assert not [str(path.relative_to(ROOT)) for path in files() if path.stat().st_size > LARGEST_KB * 1024]


def test_the_table_of_extras_agrees_with_pyproject() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {
        extra: tuple(re.split(r"[<>=!~\[ ]", requirement)[0] for requirement in requirements)
        for extra, requirements in project["optional-dependencies"].items()
        if extra not in ("dev", "all")
    }
    assert declared == dict(extras.EXTRAS)
    # Recordings for a viewer take 790 MB; a cluster, or a model in a file, is for whoever has one.
    usual = [extra for extra in extras.EXTRAS if extra not in ("rerun", "ray", "local")]
    assert project["optional-dependencies"]["all"] == [f"scene2demo[{','.join(usual)}]"]


def test_every_requirement_is_pinned_for_the_set_up() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in lines if "==" in line}
    wanted = [*project["dependencies"]]
    for extra in (*(extra for extra in extras.EXTRAS if extra not in ("ray", "local")), "dev"):
        wanted += project["optional-dependencies"][extra]
    names = {re.split(r"[<>=!~\[ ]", requirement)[0].lower() for requirement in wanted}
    assert names <= pinned


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert "\n## Unreleased\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_make_help_lists_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony is not None
    described = re.findall(r"^([a-z-]+):.*## ", makefile, re.MULTILINE)
    assert phony[1].split() == described


def test_every_document_that_is_named_exists() -> None:
    named = {(str(path), page) for path, text in texts().items() for page in re.findall(r"docs/[\w/-]+\.md", text)}
    assert not sorted((path, page) for path, page in named if not (ROOT / page).is_file())
