"""SAPIEN is imported in one place, and what it says of the machine's Vulkan loader reaches no user."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.source_tree import ROOT

ITS_IMPORT = re.compile(r"^\s*(?:import|from) sapien\b", re.MULTILINE)
SCRIPT = """
import warnings
from executor.system import vulkan
from executor.scenes.room import *
from executor.scenes import library
from executor.sim.world import World
with World(library.load("kitchen_t1")) as world:
    world.step()
assert "libvulkan" not in str(warnings.filters), "a user's filters are the user's"
"""


def test_nobody_imports_it_by_himself() -> None:
    files = [*ROOT.glob("executor/**/*.py"), *ROOT.glob("examples/*.py")]
    found = [str(path.relative_to(ROOT)) for path in files if ITS_IMPORT.search(path.read_text(encoding="utf-8"))]
    assert not found, "executor.system.extras.load_sapien imports it"


@pytest.mark.physics
@pytest.mark.parametrize("warn", ["default", "error"])
def test_a_users_script_says_nothing_that_is_not_its_own(warn: str) -> None:
    done = subprocess.run([sys.executable, "-W", warn, "-c", SCRIPT], capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
