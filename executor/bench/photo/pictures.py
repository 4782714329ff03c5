"""Measure reconstructions of real pictures, with what a person drew and wrote about each, and the sentences in them.

Every picture goes the way of a user: its boxes are read, the scene is made, and each sentence is planned, proved, asked
whether it is feasible, and executed in that scene.
"""

from __future__ import annotations

import re
import signal
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from types import FrameType
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

import bddl
import llm
from bddl.errors import Scene2DemoError
from bddl.files import read_bounded_text
from executor.bench.photo.picture_score import (
    FLOOR,
    PictureThing,
    covered,
    is_called,
    is_same_support,
    level_scores,
    outline_iou,
    pixels_of_box,
    size_scores,
)
from executor.geometry import Array
from executor.photo.drawing import as_settled, visible_surfaces
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detection, boxes_in, is_left_out
from executor.photo.inputs.depth import depth_in
from executor.photo.inputs.picture import CameraFacts
from executor.photo.output import FILES, prepared, write_result
from executor.photo.pipeline import AuxiliaryInputs, PhotoInput, PhotoResult, read_inputs, reconstruct_scene
from executor.records import PlanRefused, Rollout
from executor.rollouts.feasibility import feasible
from executor.rollouts.goals import judge, judge_at_rest
from executor.rollouts.rollout import failure_of, rollout
from executor.scenes.file import scene_for
from executor.scenes.validation import MOST_FALL_M, require_valid
from executor.sim.world import World
from executor.system.extras import MissingExtra
from executor.system.files import read_json, write_json
from oag import Scene, compose
from oag.model.symbols import has_boards
from oag.sizes import Sizing

PICTURE_SCHEMA = "scene2demo-photo-picture/1"
INDEX, ANNOTATIONS = "pictures.toml", "annotations"
LIMIT_S = 300.0
"""Most CPU seconds of a picture and its sentences."""

Half: TypeAlias = Literal["tuning", "judging"]
_UNBOXED = ("wall", "floor")
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


class NoPictures(Scene2DemoError, ValueError):
    """A folder lacks the index, an annotation, or a picture that is to be measured."""


class OutOfTime(BaseException):
    """The CPU time of a picture is used up; no search that goes on after an `Exception` keeps it."""


@dataclass(frozen=True)
class RealPicture:
    """One picture with what a person says about it.

    Attributes:
        name: Its id.
        half: What it may be used for.
        color, depth, camera: Its files; no depth is None.
        depth_unit_m: One step of the depth [m].
        level: The camera's `tilt_deg`, `roll_deg` and heights, as far as they are known.
        boxes: The annotation's file.
        things, sentences: Its content.
    """

    name: str
    half: Half
    color: Path
    depth: Path | None
    camera: Path
    depth_unit_m: float | None
    level: Mapping[str, Any]
    boxes: Path
    things: Sequence[Mapping[str, Any]] = field(repr=False)
    sentences: Sequence[Mapping[str, Any]] = field(repr=False)


def read_pictures(annotations: Path, folder: Path, half: Half | None, only: Sequence[str]) -> list[RealPicture]:
    """Return the pictures that are to be measured, in the order of the index.

    Args:
        annotations: Folder of the index and the annotations.
        folder: Folder of the pictures, as `benchmarks.pictures.fetch` fills it.
        half: One half; both by default.
        only: Ids; all by default.

    Raises:
        NoPictures: The index, an annotation or a picture is missing or malformed, or an id is unknown.
    """
    index = annotations / INDEX
    try:
        entries = tomllib.loads(read_bounded_text(index))["pictures"]
        known = [str(entry["id"]) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise NoPictures(f"{index} is no index of pictures ({error!r}); give the folder that has one") from error
    for name in only:
        if name not in known:
            near = get_close_matches(name, known, 3) or known[:3]
            raise NoPictures(f"{index} has no picture {name!r}; the nearest are {', '.join(near)}")
    chosen = [entry for entry in entries if half in (None, entry["half"]) and (not only or entry["id"] in only)]
    if not chosen:
        raise NoPictures(f"none of {', '.join(only) or 'the pictures'} is in the {half} half of {index}")
    try:
        found = [_picture_of(entry, annotations, folder) for entry in chosen]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NoPictures(f"an entry of {index} or its annotation is malformed ({error!r})") from error
    wanted = [path for one in found for path in (one.color, one.depth, one.camera) if path is not None]
    if missing := [path.name for path in wanted if not path.is_file()]:
        shown = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if len(missing) > 3 else "")
        raise NoPictures(f"{folder} lacks {shown}; fetch them by: python -m benchmarks.pictures.fetch {folder}")
    return found


def _picture_of(entry: Mapping[str, Any], annotations: Path, folder: Path) -> RealPicture:
    name, depth = str(entry["id"]), entry.get("depth")
    boxes = annotations / ANNOTATIONS / f"{name}.json"
    annotation = read_json(boxes)
    return RealPicture(
        name,
        entry["half"],
        folder / f"{name}{Path(entry['color']['path']).suffix.lower()}",
        None if depth is None else folder / f"{name}_depth{Path(depth['path']).suffix.lower()}",
        folder / f"{name}_camera.json",
        None if depth is None else float(depth["unit_m"]),
        entry.get("level", {}),
        boxes,
        annotation["things"],
        annotation.get("sentences", ()),
    )


class NamedSubject(Protocol):
    """Something that is measured once: a real picture or a drawn room."""

    @property
    def name(self) -> str:
        """Fit for files."""


_Subject = TypeVar("_Subject", bound=NamedSubject)


def each_once(
    folder: Path,
    kind: str,
    subjects: Sequence[_Subject],
    measured: Callable[[_Subject], dict[str, Any]],
    on_progress: Callable[[Mapping[str, Any]], None],
) -> Iterator[dict[str, Any]]:
    """Yield the result of every subject, measured if it has no file yet, so that an interrupted run resumes.

    Args:
        folder: Folder of the files, one a subject.
        kind: Prefix of the files' names.
        subjects: What is measured.
        measured: Measures one.
        on_progress: Called with every result.
    """
    for one in subjects:
        path = folder / f"{kind}-{one.name}.json"
        result = read_json(path) if path.is_file() else measured(one)
        if not path.is_file():
            write_json(path, result)
        on_progress(result)
        yield result


def measure_pictures(
    folder: Path,
    pictures: Sequence[RealPicture],
    on_progress: Callable[[Mapping[str, Any]], None],
    *,
    limit_s: float = LIMIT_S,
    robot: str = "",
) -> Iterator[dict[str, Any]]:
    """Yield the result of every picture, measured if it has no file yet.

    Args:
        folder: Folder of the results: a file and a folder for each picture.
        pictures: Which ones.
        on_progress: Called with every result.
        limit_s: Most CPU seconds of a picture and its sentences.
        robot: Name of the robot that executes the sentences; by default the scene's own.
    """

    def measured(picture: RealPicture) -> dict[str, Any]:
        return _measured(picture, folder / picture.name, limit_s, robot)

    yield from each_once(folder, "picture", pictures, measured, on_progress)


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """End a block by OutOfTime once this process has used so many CPU seconds; in the main thread alone."""

    def end(number: int, frame: FrameType | None) -> None:
        raise OutOfTime

    if seconds <= 0.0:
        raise OutOfTime
    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _measured(picture: RealPicture, folder: Path, limit_s: float, robot: str) -> dict[str, Any]:
    began = time.process_time()
    record: dict[str, Any] = {
        "schema": PICTURE_SCHEMA,
        "picture": picture.name,
        "half": picture.half,
        "has_depth": picture.depth is not None,
        "limit_s": limit_s,
        "robot": robot,
    }
    for name in FILES:
        (prepared(folder, force=True) / name).unlink(missing_ok=True)
    try:
        with cpu_limit(limit_s):
            given = read_inputs(picture.color, _auxiliary(picture))
            result = reconstruct_scene(given)
            write_result(folder, result)
    except PhotoRefused as problem:
        record |= _refused(picture, str(problem), problem.kind)
    except OutOfTime:
        record |= _refused(picture, f"more than {limit_s:g} CPU seconds", "time")
    except MissingExtra:
        raise
    except Exception as problem:  # A mistake of the program in one picture is a result of that picture.
        record |= _refused(picture, f"{type(problem).__name__}: {problem}", "mistake")
    else:
        record |= _compared(picture, given, result)
    record["cpu_s"] = time.process_time() - began
    made = {thing["thing"]: thing["made"] for thing in record["things"] if thing["made"]}
    scene = None if record["refused"] else folder / "scene.json"
    record["sentences"] = [
        _asked(picture, request, scene, made, limit_s - (time.process_time() - began), robot)
        for request in picture.sentences
    ]
    return record


def _auxiliary(picture: RealPicture) -> AuxiliaryInputs:
    """Return what a user gives beside the picture: without depth, the camera's tilt and height as well."""
    detect = boxes_in(picture.boxes, picture.color.name)
    if picture.depth is not None:
        return AuxiliaryInputs(detect, depth_in(picture.depth, picture.depth_unit_m), str(picture.camera))
    level = picture.level
    facts = CameraFacts(level.get("tilt_deg"), level.get("roll_deg"), level.get("height_m"))
    return AuxiliaryInputs(detect, camera=str(picture.camera), facts=facts)


def _refused(picture: RealPicture, reason: str, kind: str) -> dict[str, Any]:
    """Return the scores of a picture without a scene: all of its boxes are lost."""
    lost = [
        PictureThing(thing["id"], thing["label"], lost=f"the picture is refused: {kind}", support=_support(thing))
        for thing in picture.things
    ]
    things = [one.to_json() for one in lost]
    return {"refused": reason, "refused_kind": kind, "level": None, "invented": [], "things": things, "took_s": {}}


def _support(thing: Mapping[str, Any]) -> str:
    return next((f"{relation} {thing[relation]}" for relation in ("on", "inside") if relation in thing), "")


def _compared(picture: RealPicture, given: PhotoInput, result: PhotoResult) -> dict[str, Any]:
    # Without depth, tilt and height are given.
    level = None if given.depth is None else level_scores(picture.level, given.floor.up, given.floor.height_m)
    scene = result.made.scene
    if scene is None or result.made.refused:
        return {**_refused(picture, result.made.refused, "scene"), "level": level, "took_s": dict(result.took_s)}
    read = (thing["id"] for thing in picture.things if not is_left_out(str(thing["label"])))
    detections: dict[str, Detection] = dict(zip(read, given.detections, strict=False))
    made_of = {id(one.detection): one.id for one in result.found.things}
    made = {key: made_of[id(one)] for key, one in detections.items() if id(one) in made_of}
    causes = {id(one.detection): one.cause.value for one in result.found.unfitted}
    guesses = as_settled(result.found, scene)
    owner, made_z_m = visible_surfaces(result.observation, guesses)
    numbers = {key: number for number, key in enumerate(guesses)}
    stands = _stands(scene, made)
    boarded = {thing["id"] for thing in picture.things if has_boards(str(thing["label"]).replace(" ", "_"))}
    things = []
    for thing in picture.things:
        start = PictureThing(thing["id"], thing["label"], support=_support(thing))
        key = made.get(thing["id"])
        if key is None:
            lost = causes.get(id(detections.get(thing["id"])), "it is no thing, but a part of the room")
            things.append(replace(start, lost=lost))
            continue
        mask = owner == numbers[key]
        ratios, nearer_m = _sizes(picture, thing, given, mask, made_z_m)
        category = scene.objects[key].category
        things.append(
            replace(
                start,
                made=key,
                called=category,
                named=is_called(thing["label"], category),
                outline_iou=outline_iou(mask, tuple(thing["box"])),
                stands=stands[key],
                support_right=is_same_support(start.support, stands[key], boarded),
                size_ratios=ratios,
                nearer_m=nearer_m,
            )
        )
    boxed = set(made.values())
    invented = [key for key, one in scene.objects.items() if key not in boxed and one.category not in _UNBOXED]
    return {
        "refused": "",
        "refused_kind": "",
        "level": level,
        "invented": invented,
        "things": [one.to_json() for one in things],
        "took_s": dict(result.took_s),
    }


def _stands(scene: Scene, made: Mapping[str, str]) -> dict[str, str]:
    """Return id -> relation and support as an annotation has them; what is on nothing hangs, or is on the floor."""
    names = {key: name for name, key in made.items()}
    relations = {"ontop": "on", "inside": "inside"}
    hung = {key for key, obj in scene.objects.items() if obj.position[2] - obj.bbox_extent[2] / 2 > MOST_FALL_M}
    found = {key: "on wall" if key in hung else f"on {FLOOR}" for key in scene.objects}
    for fact in scene.facts:
        for literal in bddl.literals(fact) or ():
            relation = relations.get(literal.atom.predicate)
            if literal.value and relation is not None:
                thing, support = literal.atom.args
                found[thing] = f"{relation} {names.get(support, support)}"
    return found


def _sizes(
    picture: RealPicture, thing: Mapping[str, Any], given: PhotoInput, mask: NDArray[np.bool_], made_z_m: Array
) -> tuple[tuple[float, float] | None, float | None]:
    if given.depth is None:
        return None, None
    box, z_m = tuple(thing["box"]), given.depth.z_m
    others = [tuple(other["box"]) for other in picture.things if other is not thing]
    own = pixels_of_box(z_m, given.camera, box, others)
    # What hides it in the depth hides it in the fit as well.
    return size_scores(own, z_m, mask & ~covered(mask.shape, box, others), made_z_m, given.camera, box)


def _asked(
    picture: RealPicture,
    request: Mapping[str, Any],
    scene_file: Path | None,
    made: Mapping[str, str],
    left_s: float,
    robot: str,
) -> dict[str, Any]:
    """Return how far a sentence comes: planned, feasible, succeeded, and as asked; and where it ends."""
    began = time.process_time()
    record: dict[str, Any] = {
        "sentence": request["sentence"],
        "possible": bool(request["possible"]),
        **dict.fromkeys(("planned", "feasible", "succeeded", "as_asked"), False),
        "stage": "no scene",
        "why": "",
        "scaled": {},
    }
    if scene_file is None:
        return {**record, "cpu_s": 0.0}
    try:
        with cpu_limit(left_s):
            _chain(picture, request, scene_file, made, record, robot)
    except OutOfTime:
        record |= {"stage": "time", "why": f"no CPU time is left after {record['stage']}"}
    except llm.QueryError as problem:
        record |= {"stage": "sentence", "why": str(problem)}
    except PlanRefused as problem:
        record |= {"stage": "plan", "why": str(problem)}
    except MissingExtra:
        raise
    except Exception as problem:  # As for pictures.
        record |= {"stage": f"mistake in {record['stage']}", "why": f"{type(problem).__name__}: {problem}"}
    return {**record, "cpu_s": time.process_time() - began}


def _chain(
    picture: RealPicture,
    request: Mapping[str, Any],
    scene_file: Path,
    made: Mapping[str, str],
    record: dict[str, Any],
    robot: str,
) -> None:
    """Plan, prove, ask whether it is feasible, and execute a sentence as `run` does, and write into its record."""
    record["stage"] = "scene"
    scene = scene_for(request["sentence"], scene_file, robot=robot)
    require_valid(scene)
    record["stage"] = "sentence"
    graph = compose(llm.propose(request["sentence"], scene, sizing=Sizing(0)).task, scene=scene)
    record |= {"stage": "plan", "scaled": dict(graph.task.scales)}
    report = graph.verify()
    if not report:
        record["why"] = str(report)
        return
    record |= {"planned": True, "stage": "feasibility"}
    found = feasible(graph, scene, 0)
    record |= {"feasible": found.feasible if found.decided else None}
    if found.failure is not None:
        record |= {"stage": f"feasibility: {found.failure.kind.value}", "why": found.reason}
        return
    record["stage"] = "execution"
    done = rollout(compose(found.task, scene=scene), scene, 0, conditions=found.conditions())
    failure = failure_of(done)
    record["succeeded"] = done.succeeded
    if failure is not None:
        record |= {"stage": f"execution: {failure.kind.value}", "why": failure.message}
        return
    words = reached(request["goals"], [thing["id"] for thing in picture.things], made, done)
    record |= {"as_asked": not words, "stage": "goal" if words else "", "why": words}


def reached(goals: Sequence[Sequence[str]], ids: Sequence[str], made: Mapping[str, str], done: Rollout) -> str:
    """Return why none of some goals is reached at the end of a rollout; empty if one of them is.

    A goal that holds at the start is not reached by the robot.

    Args:
        goals: Alternatives; all literals of one have to hold.
        ids: Of the annotation.
        made: Annotated id -> id in the scene.
        done: The rollout.
    """
    problems = []
    with World(done.scene) as world:
        world.step()
        start = world.pack()
        for goal in goals:
            if lost := [
                word for literal in goal for word in _WORD.findall(literal) if word in ids and word not in made
            ]:
                problems.append(f"{lost[0]} is lost")
                continue
            wanted = [bddl.parse_formula(_WORD.sub(lambda word: made.get(word[0], word[0]), one)) for one in goal]
            world.unpack(start)
            world.step()
            if all(reading.satisfied for one in wanted for reading in judge(one, world)):
                problems.append(f"{' '.join(goal)} holds at the start")
                continue
            world.unpack(done.trajectory.packed_states[-1])
            world.step()  # Contacts are found by stepping.
            readings = [reading for one in wanted for reading in judge_at_rest(one, world)]
            if all(reading.satisfied for reading in readings):
                return ""
            problems.append(next(f"{reading} does not hold" for reading in readings if not reading.satisfied))
    return "; ".join(problems)
