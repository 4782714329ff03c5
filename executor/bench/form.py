"""The form of a unit's result, as far as table and report read it: others write into a benchmark's folder as well."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Amount = Annotated[float, Field(ge=0.0, le=1e12)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Count = Annotated[int, Field(ge=0, le=10**12)]
# What is read together.
_WITH = {
    "rss_mb": {"started_s", "worker", "peak_rss_mb"},
    "started_s": {"elapsed_s"},
    "revisions": {"succeeded_at_once"},
}


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Failure(_Form):
    kind: str
    message: str = ""
    measurements: dict[str, Any] = {}
    primitive: None = None


class _StepFailure(_Form):
    kind: str
    message: str
    measurements: dict[str, Any] = {}
    primitive: str
    action: int | dict[str, Number | list[Number] | None]
    subtask: Count
    subtask_name: str
    step: Count
    time_s: Amount


class _Reach(_Form):
    reachable: bool
    reason: str = ""


class _Subtask(_Form):
    succeeded: bool


class _Resizing(_Form):
    factors: Annotated[list[Number], Field(min_length=1)]


class _Penetration(_Form):
    p99_m: Number
    deepest_m: Number
    pair: list[str]


class _Result(_Form):
    name: str
    ended: str
    seed: Count
    index: Count | None = None
    query: str = ""
    failure: _StepFailure | _Failure | None = None
    reach: _Reach | None = None
    subtask_names: list[str] = []
    subtasks: list[_Subtask] = []
    scaled: list[_Resizing] = []
    penetration: _Penetration = _Penetration(p99_m=0.0, deepest_m=0.0, pair=[])
    revisions: Count = 0
    succeeded_at_once: bool = False
    started_s: Amount = 0.0
    elapsed_s: Amount = 0.0
    simulated_s: Amount = 0.0
    worker: Count = 0
    wall_s: dict[str, Amount] = {}
    rss_mb: Annotated[float, Field(gt=0.0, le=1e12)] = 1.0
    peak_rss_mb: Amount = 0.0
    traceback: list[str] = []


def is_result(value: object) -> bool:
    """Decides whether a file's content is a unit's result that can be counted."""
    try:
        _Result.model_validate(value)
    except (ValidationError, RecursionError):
        return False
    return isinstance(value, dict) and all(value.keys() >= needed for key, needed in _WITH.items() if key in value)
