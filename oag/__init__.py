"""The formal core: scenes, tasks, object-action graphs, and the decision whether a plan reaches its goal.

scene = oag.Scene.from_json("scene.json")
task = oag.Task.from_json("task.json", scene=scene)
report = oag.compose(task).verify()
print(report)                      # verdict and diagnostics
oag.recheck(report.certificate)    # an independent check
"""

from __future__ import annotations

# First of all: a foreign `bddl` package ends here, in one sentence.
from oag import language as language  # isort: skip
from oag.actions import Action, ActionFlow, flow_from_json, flow_to_json
from oag.categories import Kind, kind_of
from oag.certificate import Certificate
from oag.codes import CODES
from oag.diagnostic import Diagnostic
from oag.errors import FlowError, InputError, MissingScene, OagError, SceneError, TaskError
from oag.export import to_dot, to_drawing, to_graphml, to_mermaid
from oag.feasible import applicable, feasible
from oag.graph import Edge, Node, ObjectActionGraph, compose
from oag.obligations import Grade, Obligation
from oag.primitives import ParameterKind, Primitive, parameter_kind, parameter_problem
from oag.recheck import RecheckResult, recheck
from oag.report import Report, Verdict
from oag.scene import RobotPose, Scene, SceneObject
from oag.scenegraph import SceneGraph, Vertex
from oag.task import SimpleTask, Task

__all__ = [
    "CODES",
    "Action",
    "ActionFlow",
    "Certificate",
    "Diagnostic",
    "Edge",
    "FlowError",
    "Grade",
    "InputError",
    "Kind",
    "MissingScene",
    "Node",
    "OagError",
    "ObjectActionGraph",
    "Obligation",
    "ParameterKind",
    "Primitive",
    "RecheckResult",
    "Report",
    "RobotPose",
    "Scene",
    "SceneError",
    "SceneGraph",
    "SceneObject",
    "SimpleTask",
    "Task",
    "TaskError",
    "Verdict",
    "Vertex",
    "applicable",
    "compose",
    "feasible",
    "flow_from_json",
    "flow_to_json",
    "kind_of",
    "parameter_kind",
    "parameter_problem",
    "recheck",
    "to_dot",
    "to_drawing",
    "to_graphml",
    "to_mermaid",
]
