"""Files that somebody sends to do harm, each with the command that is given it; made anew in an empty folder.

A row is a name, what makes its files, and the words of the command. None may crash the program, hang it, eat the
memory, write outside its folder, or reach the terminal with what steers it.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT / "tests" / "data"
TASK, SCENE = DATA / "T1.json", DATA / "T1_scene.json"
QUERY = "put the glass into the refrigerator"
DEEP = "[" * 100_000
ESCAPE = "\x1b]0;mine\x07\x1b[2J\x9b31m\u202e"


@dataclass(frozen=True)
class Attack:
    """A hostile file or folder.

    Attributes:
        name: What it tries.
        plant: Writes what it needs into a folder.
        words: The command line, run in that folder.
        fast: Whether it is among those that every test run tries.
    """

    name: str
    plant: Callable[[Path], object]
    words: tuple[str | Path, ...]
    fast: bool = False


def text(name: str, content: str | bytes) -> Callable[[Path], object]:
    """Return what writes one file."""
    raw = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(raw)


def scene(**changes: Any) -> str:
    """Return the text of a scene, with members replaced."""
    return json.dumps({**json.loads(SCENE.read_text()), **changes})


def task(**changes: Any) -> str:
    """Return the text of a task, with members replaced."""
    return json.dumps({**json.loads(TASK.read_text()), **changes})


def subtask(**changes: Any) -> str:
    """Return the text of a task whose first subtask has members replaced."""
    steps = json.loads(TASK.read_text())["sub_tasks"]
    return task(sub_tasks=[{**steps[0], **changes}, *steps[1:]])


def moved(number: float) -> str:
    """Return the text of a scene with one number wherever its glass has one."""
    objects = json.loads(SCENE.read_text())["objects"]
    objects["glass_0"] |= {"position": [number] * 3, "bbox_extent": [number] * 3}
    return scene(objects=objects)


def renamed(name: str) -> str:
    """Return the text of a scene whose glass has another id."""
    return scene().replace("glass_0", json.dumps(name)[1:-1])


def said_by_a_model(words: str) -> str:
    """Return the text of a conversation in which all that others write holds some words."""
    entry = {"kind": "round", "module": 1, "number": 1, "reply": words, "accepted": True}
    entry["findings"] = [{"code": words, "message": words}]
    head = {"schema": "scene2demo/conversation/1", "model": words, "query": words, "scene": words, "version": words}
    return json.dumps({**head, "entries": [entry]})


def link(name: str, target: str) -> Callable[[Path], object]:
    """Return what puts a link into the folder `out`."""

    def plant(folder: Path) -> None:
        (folder / "out").mkdir(exist_ok=True)
        (folder / "precious").write_text("not yours")
        (folder / "out" / name).symlink_to(folder / target)

    return plant


def bench(index: str) -> Callable[[Path], object]:
    """Return what writes a benchmark's folder `out` with an index."""

    def plant(folder: Path) -> None:
        (folder / "out" / "units").mkdir(parents=True)
        (folder / "out" / "bench.json").write_text(index)

    return plant


def archive(folder: Path) -> None:
    """Write a zip file with members that lead out of it, under the name of a mesh."""
    with zipfile.ZipFile(folder / "thing.glb", "w") as made:
        made.writestr("../../outside", "x")
        made.writestr("bomb", bytes(10_000_000), zipfile.ZIP_DEFLATED)


def pipe(name: str) -> Callable[[Path], object]:
    """Return what makes a pipe that nobody writes to."""
    return lambda folder: os.mkfifo(folder / name)


BOMB = "<!DOCTYPE a [" + "".join(f'<!ENTITY x{n} "{f"&x{n - 1};" * 10}">' for n in range(1, 10)) + "]><a>&x9;</a>"
UTF7 = '<?xml version="1.0" encoding="UTF-7"?>' + BOMB.replace("<", "+ADw-").replace(">", "+AD4-").replace("&", "+ACY-")
SERIES = '{"series": [{"family": "T3", "seed": 1, "episodes": %s, "setting": {}, "version": "v"}]}'

VERIFY = ("verify", "t.json", "--scene", SCENE)
SHOW = ("scenes", "s.json")
IN_SCENE = ("verify", TASK, "--scene", "s.json")
RUN = ("run", QUERY, "--scene", SCENE, "--out", "out", "--no-video")
PLAN = ("run", "put the unicorn away", "--scene", "s.json", "--out", "out")
BENCH = ("bench", "T3", "--out", "out", "--episodes", "1")

ATTACKS = (
    Attack("task: deep JSON", text("t.json", DEEP), VERIFY, fast=True),
    Attack("task: deep objects", text("t.json", '{"a":' * 100_000), VERIFY),
    Attack("task: digits", text("t.json", f'{{"sub_tasks": {"9" * 100_000}}}'), VERIFY),
    Attack("task: garbage", text("t.json", bytes(range(256)) * 400), VERIFY),
    Attack("task: a key twice", text("t.json", '{"goal": "", "goal": ""}'), VERIFY),
    Attack("task: YAML", text("t.json", "a: &a [*a, *a]\n"), VERIFY),
    Attack("task: mark and CRLF", text("t.json", "\ufeff" + task().replace(", ", ",\r\n")), VERIFY),
    Attack("task: half a character", text("t.json", task(task_activity_name="\ud800")), VERIFY),
    Attack("task: a long name", text("t.json", subtask(task_activity_name="n" * 1_000_000)), VERIFY),
    Attack("task: a name as a path", text("t.json", subtask(task_activity_name="../../outside")), VERIFY),
    Attack("task: a deep goal", text("t.json", task(goal="(not " * 10_000)), VERIFY),
    Attack("task: a goal of parentheses", text("t.json", task(goal="(" * 40_000)), VERIFY),
    Attack("task: more of them", text("t.json", task(goal="(" * 200_000)), VERIFY),
    Attack("task: a nested goal", text("t.json", task(goal="(" * 19_000 + "(a)" + ")" * 19_000)), VERIFY, fast=True),
    Attack("task: escapes", text("t.json", subtask(target=f"glass{ESCAPE}", goal=ESCAPE)), VERIFY),
    Attack("task: numbers", text("t.json", subtask(flow=[1e308, -1, {"7": 1e308}, {"4": [1e308] * 2}])), VERIFY),
    Attack("scene: deep JSON", text("s.json", DEEP), SHOW),
    Attack("scene: 1e308", text("s.json", moved(1e308)), IN_SCENE),
    Attack("scene: nearly nothing", text("s.json", moved(1e-308)), IN_SCENE),
    Attack("scene: NaN", text("s.json", moved(float("nan"))), IN_SCENE),
    Attack("scene: escapes in keys", text("s.json", renamed(f"glass{ESCAPE}")), SHOW, fast=True),
    Attack("scene: an id as a path", text("s.json", renamed("../../outside")), SHOW),
    Attack("scene: a long id", text("s.json", renamed("g" * 500_000)), SHOW),
    Attack("scene: a long category", text("s.json", scene().replace("water_glass", "w" * 500_000)), PLAN),
    Attack("scene: a model as a path", text("s.json", scene().replace('"glass"', '"imported/../../x"')), PLAN),
    Attack("scene: escapes in facts", text("s.json", scene(facts=[f"(open {ESCAPE})"])), SHOW),
    Attack("scene: a fact of parentheses", text("s.json", scene(facts=["(" * 20_000 + ")" * 20_000])), SHOW),
    Attack("scene: a pipe", pipe("s.json"), SHOW),
    Attack("scene: endless", lambda f: (f / "s.json").symlink_to("/dev/zero"), SHOW),
    Attack("scene: a folder", lambda folder: (folder / "s.json").mkdir(), SHOW),
    Attack("certificate: deep JSON", text("c.json", f'{{"schema": {DEEP}'), ("recheck", "c.json")),
    Attack("certificate: a pipe", pipe("c.json"), ("recheck", "c.json"), fast=True),
    Attack("certificate: endless", lambda f: (f / "c.json").symlink_to("/dev/zero"), ("recheck", "c.json")),
    Attack("BDDL: deep", text("b.bddl", "(" * 100_000), ("bddl", "check", "b.bddl")),
    Attack("BDDL: escapes", text("b.bddl", f"(define (problem {ESCAPE}))"), ("bddl", "check", "b.bddl")),
    Attack("URDF: entities", text("a.urdf", BOMB), ("assets", "import", "a.urdf")),
    Attack("URDF: UTF-7", text("a.urdf", UTF7), ("assets", "import", "a.urdf")),
    Attack("URDF: UTF-16", text("a.urdf", BOMB.encode("utf-16-le")), ("assets", "import", "a.urdf")),
    Attack("URDF: deep", text("a.urdf", "<robot>" * 200_000), ("assets", "import", "a.urdf")),
    Attack("PartNet: not closed", text("mobility.urdf", '<visual name="h" ' * 100_000), ("assets", "import", ".")),
    Attack("DAE: UTF-7", text("a.dae", UTF7), ("assets", "import", "a.dae"), fast=True),
    Attack("DAE: deep", text("a.dae", "<node>" * 100_000), ("assets", "import", "a.dae")),
    Attack("glTF: outside", text("a.gltf", '{"buffers": [{"uri": "/dev/zero"}]}'), ("assets", "import", "a.gltf")),
    Attack("mesh: a zip", archive, ("assets", "import", "thing.glb")),
    Attack("mesh: a pipe", pipe("a.obj"), ("assets", "import", "a.obj")),
    Attack("side file: deep", lambda f: (text("a.obj", "v 0 0 0")(f), text("affordances.json", DEEP)(f)),
           ("assets", "import", "a.obj")),
    Attack("bench: deep index", bench(DEEP), BENCH),
    Attack("bench: endless series", bench(SERIES % 10**18), BENCH),
    Attack("bench: a lock elsewhere", link(".lock", "precious"), BENCH, fast=True),
    Attack("bench: escapes", bench(SERIES % json.dumps(ESCAPE)), BENCH),
    Attack("run: a recording elsewhere", link("exchanges.jsonl", "outside"), RUN),
    Attack("run: pictures elsewhere", link("frames", "."), RUN),
    Attack("replay: deep", text("x.jsonl", f'{{"schema": {DEEP}\n'), (*RUN, "--model", "replay:x.jsonl")),
    Attack("replay: garbage", text("x.jsonl", bytes(range(256)) * 4000), (*RUN, "--model", "replay:x.jsonl")),
    Attack("conversation: deep", text("c.json", f'{{"schema": {DEEP}'), ("conversation", "c.json")),
    Attack("conversation: escapes", text("c.json", said_by_a_model(ESCAPE)), ("conversation", "c.json")),
    Attack("picture: garbage", text("p.png", b"\x89PNG\r\n\x1a\n" + b"\xff" * 1000),
           (*RUN, "--model", "replay:x.jsonl", "--image", "p.png")),
)  # fmt: skip
