"""The formal core: scenes, tasks, object-action graphs, and the decision whether a plan reaches its goal.

scene = oag.Scene.from_json("scene.json")
task = oag.Task.from_json("task.json", scene=scene)
report = oag.compose(task).verify()
print(report)                      # verdict and diagnostics
oag.recheck(report.certificate)    # an independent check
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# First of all: a foreign `bddl` package ends here, in one sentence.
from oag import model as model  # isort: skip
from oag.certificate.check import RecheckResult
from oag.certificate.recheck import recheck
from oag.certificate.write import Certificate
from oag.flows import Completion, complete
from oag.graph import Edge, Node, ObjectActionGraph, compose, feasible, to_dot, to_drawing, to_graphml, to_mermaid
from oag.model.actions import Action, ActionFlow, flow_from_json, flow_to_json
from oag.model.diagnostics import (
    CODES,
    Diagnostic,
    EvidenceError,
    FixError,
    FlowError,
    HistoryFull,
    InputError,
    MissingScene,
    NoSuchSubtask,
    OagError,
    RecordError,
    SceneError,
    TaskError,
)
from oag.model.scene import RobotPose, Scene, SceneObject
from oag.model.symbols import Kind, ParameterKind, Primitive, applicable, kind_of, parameter_kind, parameter_problem
from oag.progression import Grade, Obligation
from oag.task import SimpleTask, Task
from oag.verify.edits import Fix
from oag.verify.verify import Report, Verdict

if TYPE_CHECKING:
    from oag.measurements import clopper_pearson
    from oag.normal_form import canonical, canonical_digest
    from oag.planning import NoPlan, Planned, plan, repair
    from oag.revision import (
        Admission,
        Attempt,
        Critique,
        Hindsight,
        History,
        Iteration,
        Revision,
        Tolerance,
        admissible,
        change_between,
        same_flow,
    )

__all__ = [
    "CODES",
    "Action",
    "ActionFlow",
    "Admission",
    "Attempt",
    "Certificate",
    "Completion",
    "Critique",
    "Diagnostic",
    "Edge",
    "EvidenceError",
    "Fix",
    "FixError",
    "FlowError",
    "Grade",
    "Hindsight",
    "History",
    "HistoryFull",
    "InputError",
    "Iteration",
    "Kind",
    "MissingScene",
    "NoPlan",
    "NoSuchSubtask",
    "Node",
    "OagError",
    "ObjectActionGraph",
    "Obligation",
    "ParameterKind",
    "Planned",
    "Primitive",
    "RecheckResult",
    "RecordError",
    "Report",
    "Revision",
    "RobotPose",
    "Scene",
    "SceneError",
    "SceneObject",
    "SimpleTask",
    "Task",
    "TaskError",
    "Tolerance",
    "Verdict",
    "admissible",
    "applicable",
    "canonical",
    "canonical_digest",
    "change_between",
    "clopper_pearson",
    "complete",
    "compose",
    "feasible",
    "flow_from_json",
    "flow_to_json",
    "kind_of",
    "parameter_kind",
    "parameter_problem",
    "plan",
    "recheck",
    "repair",
    "same_flow",
    "to_dot",
    "to_drawing",
    "to_graphml",
    "to_mermaid",
]

# What verifying a plan does not need is loaded when it is first asked for.
_PLACES = {
    name: module
    for module, names in {
        "oag.measurements": "clopper_pearson",
        "oag.normal_form": "canonical canonical_digest",
        "oag.planning": "NoPlan Planned plan repair",
        "oag.revision": "Admission Attempt Critique Hindsight History Iteration Revision Tolerance admissible "
        "change_between same_flow",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'oag' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
