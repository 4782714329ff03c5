"""Exceptions that can be sent to another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping


class Portable(Exception):
    """An exception that another process gets as it was, whatever its constructor takes.

    Python makes a copy by calling the constructor with the message, which is not what most of ours take.
    """

    def __reduce__(self) -> tuple[Callable[..., Portable], tuple[object, ...]]:
        """Returns what makes a copy: the class, the message, and what else it has."""
        return _as_it_was, (type(self), self.args, self.__dict__)


def _as_it_was(kind: type[Portable], args: tuple[object, ...], attributes: Mapping[str, object]) -> Portable:
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error
