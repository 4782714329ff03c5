"""Versions of the program and of libraries that decide whether stored results count."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib import metadata

from executor.system.files import content_key, json_text

OUTCOME_VERSION = 1
"""Raised by hand where a change alters how an episode goes; frozen outcomes (`make golden`) fail where it was not."""
UNORDERED_VERSION = 6
"""Raised by hand where a change alters only how episodes of T7, or of robots that keep no order, go in a benchmark."""
SURFACES_VERSION = 2
"""Raised by hand where a change alters only pictures of varied surfaces without a home; 1 had no number in ids."""
EVALUATION_VERSION = 1
"""Raised by hand whenever a change alters how a policy is evaluated or what a trained one does."""
LIBRARIES = ("sapien", "numpy", "scipy", "trimesh", "example-robot-data")
"""Libraries that affect episodes."""


def scene_version(keeps_order: bool) -> str:
    """Return `outcome_version` for answers of one scene, by whether its robot keeps the order of searches."""
    return outcome_version() if keeps_order else outcome_version(f"unordered {UNORDERED_VERSION}")


@cache
def outcome_version(*more: object) -> str:
    """Return 16 hexadecimal digits that change when a stored result may not be repeated exactly.

    Args:
        more: Further constants that decide a measurement, and not an episode's outcome.
    """
    versions = [f"{library} {version}" for library, version in library_versions(LIBRARIES).items()]
    return content_key(json_text([OUTCOME_VERSION, *more, *versions]))


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the installed version of each library, or "missing"."""
    found = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found
