"""Whoever judges the steps of an attempt: from measurements, or with a model that looks at pictures."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from llm.evolution.observation import AttemptSeen
from oag import Critique


@runtime_checkable
class Inspector(Protocol):
    """Judges executed steps one by one.

    Source: the paper's Robotic Safety Inspector, m_(tau, j).
    """

    def inspect(self, seen: AttemptSeen, step: int) -> Critique:
        """Returns the critique of one step that ran.

        Args:
            seen: The whole attempt, so that the steps before can be looked back at.
            step: Index into `seen.steps`.
        """
        ...
