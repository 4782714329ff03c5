"""Settings for all tests: how hard hypothesis tries, and what to leave out where the machine cannot do it."""

from __future__ import annotations

import importlib.util
import os

import hypothesis
import pytest

from executor.system import vulkan

# "default" suits every change; "thorough" is for a night: HYPOTHESIS_PROFILE=thorough make test.
hypothesis.settings.register_profile("default", deadline=None, max_examples=50)
hypothesis.settings.register_profile("ci", deadline=None, max_examples=30, derandomize=True)
hypothesis.settings.register_profile("thorough", deadline=None, max_examples=2000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci" if os.environ.get("CI") else "default"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skips, with the reason, tests that need a simulator or a renderer which this machine does not have."""
    marked = {name for item in items for name in ("physics", "render") if item.get_closest_marker(name)}
    reasons: dict[str, str] = {}
    if marked and importlib.util.find_spec("sapien") is None:
        reasons = dict.fromkeys(marked, "SAPIEN is not installed: make setup")
    elif "render" in marked and not (renderer := vulkan.find_renderer()):
        reasons["render"] = f"{renderer.why}: make repair"
    for item in items:
        for name, reason in reasons.items():
            if item.get_closest_marker(name):
                item.add_marker(pytest.mark.skip(reason=reason))
