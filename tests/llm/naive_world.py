"""A tiny world apart from the planner: it carries out steps one by one, and says where things are.

It knows nothing of formulas, flows or the planner's own model of a scene, so that it can judge plans.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import bddl
from oag import Scene, SimpleTask


class Impossible(Exception):
    """A step that the world does not allow."""


@dataclass
class World:
    """Where things are and which doors are open; `moments` has the state after each step, the start first."""

    where: dict[str, tuple[str, str]]
    is_open: dict[str, bool]
    hand: str | None = None
    moments: list[tuple[dict[str, tuple[str, str]], dict[str, bool], str | None]] = field(default_factory=list)

    @classmethod
    def of(cls, scene: Scene) -> World:
        """Return the world at the start of a scene that states everything."""
        world = cls({}, {})
        for fact in scene.facts:
            atom = fact.operands[0] if isinstance(fact, bddl.Not) else fact
            assert isinstance(atom, bddl.Atom)
            if atom.predicate == "open":
                world.is_open[atom.args[0]] = atom is fact
            elif atom.args[1] == "gripper":
                world.hand = atom.args[0]
            else:
                world.where[atom.args[0]] = (atom.predicate, atom.args[1])
        world._remember()
        return world

    def do(self, step: SimpleTask) -> None:
        """Carries out one simple task, told by its name and roles only."""
        if step.name.startswith(("open_", "close_")):
            self._need(self.hand is None, f"the hand holds {self.hand}")
            opening = step.name.startswith("open_")
            self._need(self.is_open.get(step.target, False) is not opening, f"{step.target} is so already")
            self.is_open[step.target] = opening
        elif step.name.startswith("pick_up_"):
            self._need(self.hand is None, f"the hand holds {self.hand}")
            self._reach(step.target)
            self._need(self.where.pop(step.target)[1] == step.support_init, f"{step.target} is elsewhere")
            self.hand = step.target
        else:
            self._need(self.hand == step.target, f"{step.target} is not in the hand")
            relation = "inside" if "_into_" in step.name else "ontop"
            assert step.support_goal is not None
            self._reach(step.support_goal)
            if relation == "inside":
                self._need(self.is_open.get(step.support_goal, True), f"{step.support_goal} is closed")
            self.where[step.target] = (relation, step.support_goal)
            self.hand = None
        self._remember()

    def _reach(self, thing: str) -> None:
        """Nothing that stands in something closed can be reached."""
        while thing in self.where:
            relation, thing = self.where[thing]
            self._need(relation == "ontop" or self.is_open.get(thing, True), f"{thing} is closed")

    def _need(self, holds: bool, problem: str) -> None:
        if not holds:
            raise Impossible(problem)

    def _remember(self) -> None:
        self.moments.append((dict(self.where), dict(self.is_open), self.hand))
