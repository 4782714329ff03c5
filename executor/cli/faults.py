"""Faults as they are typed, such as `pose:glass_0,size_m=0.02`, `navigation:left_m=0.15` or `grip:force_n=0.5`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING

from bddl.errors import Scene2DemoError

if TYPE_CHECKING:
    from executor.sim.faults import Fault

_OBJECT = "object_id"
_DRAWN_SIZE = "size_m"
_DRAWN = ("pose", "navigation")


class BadFault(Scene2DemoError, ValueError):
    """The typed fault cannot be made."""

    def __init__(self, text: str, problem: str) -> None:
        super().__init__(f"--fault {text!r}: {problem}; {FORMS}")


FORMS = (
    "faults are pose:OBJECT,size_m=N (its direction drawn by the seed) or pose:OBJECT,dx_m=N,dy_m=N; "
    "scale:OBJECT,factor=N; door:OBJECT,fraction=N; navigation:size_m=N or navigation:forward_m=N,left_m=N,yaw_deg=N; "
    "grip:force_n=N"
)


@dataclass(frozen=True, slots=True)
class FaultOption:
    """A fault as typed, before a seed draws what it leaves open.

    Attributes:
        text: As typed.
        kind: The kind's word.
        object_id: Its object; None for kinds without one.
        numbers: Its numbers by name.
    """

    text: str
    kind: str
    object_id: str | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> FaultOption:
        """Parse a fault."""
        from bddl import near_names
        from executor.sim.faults import KINDS

        kind, _, rest = text.partition(":")
        if kind not in KINDS:
            near = near_names(kind, sorted(KINDS))
            hint = f", did you mean {' or '.join(near)}?" if near else ""
            raise BadFault(text, f"there is no kind {kind!r}{hint}")
        known = {f.name: f for f in fields(KINDS[kind])}
        object_id, numbers = None, {}
        for word in filter(None, (part.strip() for part in rest.split(","))):
            name, equals, value = word.partition("=")
            if not equals and _OBJECT in known and object_id is None:
                object_id = word
            elif name in known or (name == _DRAWN_SIZE and kind in _DRAWN):
                numbers[name] = _number(text, name, value)
            else:
                legal = ", ".join(n for n in known if n != _OBJECT)
                raise BadFault(text, f"{word!r} is not one of its numbers, which are {legal}")
        words = cls(text, kind, object_id, numbers)
        words.drawn(0)
        return words

    def drawn(self, seed: int) -> Fault:
        """Return the fault of an episode."""
        from executor.sim.faults import KINDS, NavigationOffset, PoseError

        made = KINDS[self.kind]
        if _OBJECT in {f.name for f in fields(made)} and self.object_id is None:
            raise BadFault(self.text, "it is about an object, such as glass_0")
        if _DRAWN_SIZE in self.numbers:
            if len(self.numbers) > 1:
                raise BadFault(self.text, f"{_DRAWN_SIZE} leaves the direction to the seed; give it alone")
            size_m = self.numbers[_DRAWN_SIZE]
            if self.kind == "navigation":
                return NavigationOffset.drawn(size_m, seed)
            return PoseError.drawn(self.object_id or "", size_m, seed)
        given: dict[str, object] = {} if self.object_id is None else {_OBJECT: self.object_id}
        given.update(self.numbers)
        if self.kind == "navigation":
            given = {"forward_m": 0.0, "left_m": 0.0, **given}
        if self.kind == "pose" and self.numbers:
            given = {"dx_m": 0.0, "dy_m": 0.0, **given}
        missing = [f.name for f in fields(made) if f.name not in given and f.default is MISSING]
        if missing:
            raise BadFault(self.text, f"it needs {' and '.join(missing)}")
        try:
            return made(**given)  # type: ignore[arg-type]
        except ValueError as problem:
            raise BadFault(self.text, str(problem)) from problem


def _number(text: str, name: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        raise BadFault(text, f"{name} is a number, not {value!r}") from None
    if not -1e3 < number < 1e3:
        raise BadFault(text, f"{name} is a number of metres, degrees, newtons or a fraction, not {value}")
    return number
