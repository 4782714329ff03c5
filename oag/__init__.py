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
from oag import language as language  # isort: skip
from oag.actions import Action, ActionFlow, flow_from_json, flow_to_json
from oag.categories import Kind, kind_of
from oag.certificate import Certificate
from oag.certified import recheck
from oag.checker.recheck import RecheckResult
from oag.codes import CODES
from oag.diagnostic import Diagnostic
from oag.errors import (
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
from oag.export import to_dot, to_drawing, to_graphml, to_mermaid
from oag.feasible import applicable, feasible
from oag.flows.completion import Completion, complete
from oag.graph import Edge, Node, ObjectActionGraph, compose
from oag.obligations import Grade, Obligation
from oag.primitives import ParameterKind, Primitive, parameter_kind, parameter_problem
from oag.repairs.fix import Fix
from oag.report import Report, Verdict
from oag.scene import RobotPose, Scene, SceneObject
from oag.scenegraph import SceneGraph, Vertex
from oag.task import SimpleTask, Task

if TYPE_CHECKING:
    from oag.binomial import clopper_pearson
    from oag.evidence import Conditioning, Count, Evidence, chain_evidence, pooled_evidence
    from oag.evolution.history import History, Iteration
    from oag.evolution.motion import Tolerance, same_flow
    from oag.evolution.records import Attempt, Critique, Hindsight, Revision, change_between
    from oag.evolution.revision import Admission, admissible
    from oag.normal_form.canonical import canonical, canonical_digest
    from oag.stepoutcomes import Outcome, agreeing_outcomes, outcomes

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
    "Outcome",
    "ParameterKind",
    "Primitive",
    "RecheckResult",
    "RecordError",
    "Report",
    "Revision",
    "RobotPose",
    "Scene",
    "SceneError",
    "SceneGraph",
    "SceneObject",
    "SimpleTask",
    "Task",
    "TaskError",
    "Tolerance",
    "Verdict",
    "Vertex",
    "admissible",
    "agreeing_outcomes",
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
    "outcomes",
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
    "Admission": "oag.evolution.revision",
    "Attempt": "oag.evolution.records",
    "Conditioning": "oag.evidence",
    "Count": "oag.evidence",
    "Critique": "oag.evolution.records",
    "Evidence": "oag.evidence",
    "Hindsight": "oag.evolution.records",
    "History": "oag.evolution.history",
    "Iteration": "oag.evolution.history",
    "Outcome": "oag.stepoutcomes",
    "Revision": "oag.evolution.records",
    "Tolerance": "oag.evolution.motion",
    "admissible": "oag.evolution.revision",
    "agreeing_outcomes": "oag.stepoutcomes",
    "canonical": "oag.normal_form.canonical",
    "canonical_digest": "oag.normal_form.canonical",
    "chain_evidence": "oag.evidence",
    "change_between": "oag.evolution.records",
    "clopper_pearson": "oag.binomial",
    "outcomes": "oag.stepoutcomes",
    "pooled_evidence": "oag.evidence",
    "same_flow": "oag.evolution.motion",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'oag' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
