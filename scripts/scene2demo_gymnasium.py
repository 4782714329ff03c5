"""Registers the environments of Scene2Demo when Gymnasium is imported; lies beside the packages in an installation.

Gymnasium has loaded no entry points since its version 1.0. So `scene2demo_gymnasium.pth` imports this module when
Python starts. It loads nothing then, and waits for the import of `gymnasium.envs`, after which it loads the entry
points of the group "gymnasium.envs" that this distribution has.
"""

import sys

_AFTER, _GROUP, _NAME = "gymnasium.envs", "gymnasium.envs", "scene2demo"


class _Awaiting:
    """A finder that finds nothing, and adds the registration to the import that it waits for."""

    def find_spec(self, name, path=None, target=None):
        if name != _AFTER:
            return None
        sys.meta_path.remove(self)
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def and_register(module):
                execute(module)
                _register()

            spec.loader.exec_module = and_register
        return spec


def _register():
    from importlib.metadata import entry_points
    from warnings import warn

    try:
        for point in entry_points(group=_GROUP, name=_NAME):
            point.load()()
    except Exception as problem:  # Whoever imports Gymnasium for other environments is not to fail for these.
        warn(f"the environments of {_NAME} are not registered: {type(problem).__name__}: {problem}", stacklevel=2)


sys.meta_path.insert(0, _Awaiting())
