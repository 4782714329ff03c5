"""The base of this package's errors, apart from those that only the verifier raises."""

from bddl.errors import Scene2DemoError


class OagError(Scene2DemoError):
    """Every exception that this package raises on purpose."""
