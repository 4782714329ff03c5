"""Kinds of options, and what the help says of them.

`Flag` is given or not, such as `--json`. `Maybe` may be left out and then has no value. `unless` is for what is on by
default and is taken back, such as `--no-video`: the help has to say what the option does, not what the field means.
"""

from __future__ import annotations

from typing import Annotated, TypeVar

import tyro

T = TypeVar("T")

# A flag's default, and a value that is not there, say nothing that the sentence does not say better.
_SAID = tyro.conf.arg(help_behavior_hint="")

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff, _SAID]
Maybe = Annotated[T | None, _SAID]


def unless(does: str) -> object:
    """Returns what makes a field that is true by default an option `--no-...`.

    Args:
        does: What the option does, as a sentence for the help.
    """
    return tyro.conf.arg(help=does, help_behavior_hint="")
