"""Actions and action flows, and the paper's JSON form of them: `[18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]`.

Names are read in the place of IDs as well: `["GRASP", {"LIFT_EEF_UP": 0.2}]`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import bddl
from oag.model.codec import as_number, shown
from oag.model.diagnostics import FlowError
from oag.model.domain import BUILT_IN, Domain, own_of
from oag.model.symbols import Parameter, ParameterKind, Primitive, parameter_kind

JsonAction = int | str | dict[str, float | list[float] | None]

# Zeros before an ID do no harm, but Python refuses to read thousands of digits.
_MOST_DIGITS = 20
_IDS = range(min(Primitive), max(Primitive) + 1)


@dataclass(frozen=True, slots=True)
class Action:
    """One primitive with its parameter.

    Attributes:
        parameter: Metres, degrees or joint limits, by `parameter_kind`. None for a primitive that takes none, and for
            one whose number the executor's geometric planner fills in later.
    """

    primitive: Primitive
    parameter: Parameter = None

    @property
    def unfilled(self) -> bool:
        """True when the primitive takes a number and none is given."""
        return self.parameter is None and parameter_kind(self.primitive) is not ParameterKind.NONE

    def __str__(self) -> str:
        if self.parameter is None:
            return self.primitive.name
        values = self.parameter if isinstance(self.parameter, tuple) else (self.parameter,)
        return f"{self.primitive.name}({', '.join(f'{value:g}' for value in values)})"

    def to_json(self) -> JsonAction:
        """Return the paper's form: a bare ID, or `{"ID": parameter}` (null for an unfilled one); own ones by name."""
        own = own_of(self.primitive) is not None
        if parameter_kind(self.primitive) is ParameterKind.NONE and self.parameter is None:
            return self.primitive.name if own else int(self.primitive)
        value = list(self.parameter) if isinstance(self.parameter, tuple) else self.parameter
        return {self.primitive.name if own else str(int(self.primitive)): value}


ActionFlow = tuple[Action, ...]


def flow_to_json(flow: Iterable[Action]) -> list[JsonAction]:
    """Return a flow in the paper's JSON form."""
    return [action.to_json() for action in flow]


def flow_from_json(items: object, domain: Domain = BUILT_IN) -> ActionFlow:
    """Return the flow that a JSON list describes; parameters out of range are kept, since `verify` reports them.

    Own primitives of a domain stand by their names.

    Raises FlowError when the value is no list, an item has another form, or an ID is unknown.
    """
    if not isinstance(items, list):
        raise FlowError(f"expected a list such as [17, 1, 2, 3], got {shown(items)}", code="flow/parameter")
    return tuple(action_from_json(item, index, domain) for index, item in enumerate(items))


def action_from_json(item: object, index: int | None = None, domain: Domain = BUILT_IN) -> Action:
    """Return the action that one JSON item describes; `index` is only for the message of a FlowError."""
    if isinstance(item, dict):
        if len(item) != 1:
            problem = f'expected one primitive a mapping, such as {{"15": 0.3}}, got {shown(item)}'
            raise FlowError(problem, code="flow/parameter", index=index)
        key, value = next(iter(item.items()))
        primitive = _primitive(key, index, domain)
        return Action(primitive, _parameter(primitive, value, index))
    return Action(_primitive(item, index, domain))


def _primitive(identifier: object, index: int | None, domain: Domain) -> Primitive:
    number = identifier
    if isinstance(identifier, str):
        own = domain.primitive(identifier) if identifier.strip() and domain.rows else None
        if own is not None:
            return own
        digits = identifier.strip()
        number = int(digits) if digits.isdecimal() and len(digits) <= _MOST_DIGITS else identifier
        named = Primitive.__members__.get(_name(identifier))
        if named is not None:
            return named
    if isinstance(number, int) and not isinstance(number, bool) and number in _IDS:
        return Primitive(number)
    legal = f"primitives are the integers {_IDS.start} to {_IDS.stop - 1}, or their names"
    legal += f", or those of the domain {domain.name}: {', '.join(domain.rows)}" if domain.rows else ""
    problem, meant = f"unknown primitive {shown(identifier)}; {legal}", _near_primitives(identifier)
    raise FlowError(problem, code="flow/unknown-primitive", index=index, meant=meant)


def _near_primitives(identifier: object) -> dict[int, str]:
    if not isinstance(identifier, str):
        return {}
    names = {primitive.name: primitive for primitive in Primitive}
    wanted = _name(identifier)
    near = bddl.near_names(wanted, tuple(names))
    from difflib import SequenceMatcher

    # Of names that share a word, the one that has more of the letters: LIFT_UP is no LIFT_EEF_DOWN.
    likely = sorted(near, key=lambda name: -SequenceMatcher(None, wanted, name).ratio())
    return {int(names[name]): name for name in likely}


def _name(identifier: str) -> str:
    return identifier.strip().upper().replace(" ", "_").replace("-", "_")


def _parameter(primitive: Primitive, value: object, index: int | None) -> Parameter:
    if value is None:
        return None
    number = as_number(value)
    if number is not None and not _beyond_floats(value):
        return number
    if isinstance(value, list | tuple) and len(value) == 2 and not any(map(_beyond_floats, value)):
        low, high = map(as_number, value)
        if low is not None and high is not None:
            return (low, high)
    problem = f"{primitive.name} takes {parameter_kind(primitive).value}, got {shown(value)}"
    raise FlowError(problem, code="flow/parameter", index=index)


def _beyond_floats(value: object) -> bool:
    """True for an integer that no float comes near: written as one, it would be another number."""
    return isinstance(value, int) and math.isinf(as_number(value) or 0.0)
