"""The formal core: scenes, tasks, object-action graphs, and the decision whether a plan reaches its goal.

scene = oag.scene(objects={"drawer_0": "drawer", "apple_0": "apple", "table_0": "table"},
                  facts=["(ontop apple_0 table_0)"], closed="all")
task = oag.task(scene, goal="(open drawer_0)", steps=[oag.open("drawer_0")])
report = oag.compose(task).verify()
print(report)                      # verdict and diagnostics
oag.recheck(report.certificate)    # an independent check

Files are read by `oag.Scene.from_json("scene.json")` and `oag.Task.from_json("task.json", scene=scene)`. What is not
needed for this lives in its room, such as `oag.revision` or `oag.model.symbols` (docs/api.md lists them).
"""

from __future__ import annotations

import importlib
import warnings
from typing import TYPE_CHECKING, Any

# First of all: a foreign `bddl` package ends here, in one sentence.
from oag import model as model  # isort: skip

from oag.authoring import close, open, pick, place, scene, task
from oag.certificate.recheck import recheck
from oag.flows import complete
from oag.graph import ObjectActionGraph, compose
from oag.model.actions import Action
from oag.model.diagnostics import Diagnostic, OagError, SceneError, TaskError
from oag.model.domain import Domain
from oag.model.scene import Scene, SceneObject
from oag.model.symbols import Primitive
from oag.task_definition import SimpleTask, Task
from oag.verify.edits import Fix
from oag.verify.verify import Report, Verdict

if TYPE_CHECKING:
    from oag.decompositions import stability
    from oag.normal_form import canonical, canonical_digest
    from oag.planning import plan, repair
    from oag.wish_list import tasks

__all__ = [
    "Action",
    "Diagnostic",
    "Domain",
    "Fix",
    "OagError",
    "ObjectActionGraph",
    "Primitive",
    "Report",
    "Scene",
    "SceneError",
    "SceneObject",
    "SimpleTask",
    "Task",
    "TaskError",
    "Verdict",
    "canonical",
    "canonical_digest",
    "close",
    "complete",
    "compose",
    "open",
    "pick",
    "place",
    "plan",
    "recheck",
    "repair",
    "scene",
    "stability",
    "task",
    "tasks",
]

# What verifying a plan does not need is loaded when it is first asked for.
_PLACES = {
    "canonical": "oag.normal_form",
    "canonical_digest": "oag.normal_form",
    "plan": "oag.planning",
    "repair": "oag.planning",
    "stability": "oag.decompositions",
    "tasks": "oag.wish_list",
}
# Names of version 0.2.0 that are now in their rooms alone; the next release no longer finds them here.
_MOVED = {
    name: module
    for module, names in {
        "oag.certificate.check": "RecheckResult",
        "oag.certificate.write": "Certificate",
        "oag.decompositions": "Stability",
        "oag.flows": "Completion",
        "oag.graph": "Edge Node feasible to_dot to_drawing to_graphml to_mermaid",
        "oag.measurements": "clopper_pearson",
        "oag.model.actions": "ActionFlow flow_from_json flow_to_json",
        "oag.model.diagnostics": "CODES EvidenceError FixError FlowError HistoryFull InputError MissingScene "
        "NoSuchSubtask RecordError",
        "oag.model.scene": "RobotPose",
        "oag.model.symbols": "Kind ParameterKind applicable kind_of parameter_kind parameter_problem",
        "oag.planning": "NoPlan Planned",
        "oag.progression": "Grade Obligation",
        "oag.revision": "Admission Attempt Critique Hindsight History Iteration Revision Tolerance admissible "
        "change_between same_flow",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    if name == "testing":
        # Needs hypothesis, which is an extra.
        return importlib.import_module("oag.testing")
    if name in _MOVED:
        room = _MOVED[name]
        warnings.warn(f"oag.{name} has moved: from {room} import {name}", DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module(room), name)
    if name not in _PLACES:
        raise AttributeError(f"module 'oag' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    own = [name for name in globals() if name.startswith("__")]
    return sorted([*own, *__all__])
