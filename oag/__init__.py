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
from oag.certificate.certificate import Certificate
from oag.certificate.certified import recheck
from oag.checker.recheck import RecheckResult
from oag.export import to_dot, to_drawing, to_graphml, to_mermaid
from oag.flows.completion import Completion, complete
from oag.graph import Edge, Node, ObjectActionGraph, compose, feasible
from oag.model.actions import Action, ActionFlow, flow_from_json, flow_to_json
from oag.model.categories import Kind, kind_of
from oag.model.diagnostic import CODES, Diagnostic
from oag.model.errors import (
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
from oag.model.primitives import ParameterKind, Primitive, applicable, parameter_kind, parameter_problem
from oag.model.scene import RobotPose, Scene, SceneObject
from oag.progression.obligations import Grade, Obligation
from oag.report import Report, Verdict
from oag.task.edits import Fix
from oag.task.task import SimpleTask, Task

if TYPE_CHECKING:
    from oag.normal_form.canonical import canonical, canonical_digest
    from oag.revision.admission import Admission, admissible
    from oag.revision.evidence import Conditioning, Count, Evidence, chain_evidence, clopper_pearson, pooled_evidence
    from oag.revision.history import History, Iteration
    from oag.revision.motion import Tolerance, same_flow
    from oag.revision.records import Attempt, Critique, Hindsight, Revision, change_between

__all__ = [
    "CODES",
    "Action",
    "ActionFlow",
    "Admission",
    "Attempt",
    "Certificate",
    "Completion",
    "Conditioning",
    "Count",
    "Critique",
    "Diagnostic",
    "Edge",
    "Evidence",
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
    "NoSuchSubtask",
    "Node",
    "OagError",
    "ObjectActionGraph",
    "Obligation",
    "ParameterKind",
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
    "chain_evidence",
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
    "pooled_evidence",
    "recheck",
    "same_flow",
    "to_dot",
    "to_drawing",
    "to_graphml",
    "to_mermaid",
]

# What verifying a plan does not need is loaded when it is first asked for.
_PLACES = {
    "Admission": "oag.revision.admission",
    "Attempt": "oag.revision.records",
    "Conditioning": "oag.revision.evidence",
    "Count": "oag.revision.evidence",
    "Critique": "oag.revision.records",
    "Evidence": "oag.revision.evidence",
    "Hindsight": "oag.revision.records",
    "History": "oag.revision.history",
    "Iteration": "oag.revision.history",
    "Revision": "oag.revision.records",
    "Tolerance": "oag.revision.motion",
    "admissible": "oag.revision.admission",
    "canonical": "oag.normal_form.canonical",
    "canonical_digest": "oag.normal_form.canonical",
    "chain_evidence": "oag.revision.evidence",
    "change_between": "oag.revision.records",
    "clopper_pearson": "oag.revision.evidence",
    "pooled_evidence": "oag.revision.evidence",
    "same_flow": "oag.revision.motion",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'oag' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
