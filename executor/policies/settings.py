"""What a policy is and how it is trained, as people write it: a TOML file, or the name of one that comes along.

[sees]                      # of the robot and what is around it
kind = "state"              # or "cloud": a point cloud with a mask of the hand
frames = 1                  # how many observations in a row
phase = true                # and the primitive of the plan that is going on

[acts]
kind = "joint_target"       # or "paper": the ten numbers of a hand action
chunk = 16                  # actions that are foretold
execute = 6                 # of which so many are done before it looks again

[network]
kind = "mlp"                # or "transformer", causal over the frames

[training]
steps = 10000
"""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StrictBool, StrictFloat, StrictInt

from bddl.files import read_bounded_text
from executor.datasets.formats.clouds import POINTS
from oag.model.errors import InputError
from oag.model.forms import Form
from oag.model.jsonfile import Document

_DATA = resources.files("executor.policies") / "data"
# One number is one setting, whether it is typed with a point or without.
_AS_FLOAT = AfterValidator(lambda value: float(value) + 0.0)
Amount = Annotated[StrictFloat | StrictInt, Field(ge=0, le=1e6), _AS_FLOAT]
Share = Annotated[StrictFloat | StrictInt, Field(ge=0, lt=1), _AS_FLOAT]
Width = Annotated[StrictInt, Field(ge=1, le=4096)]


class SettingsError(InputError, ValueError):
    """A file does not say what a policy is and how it is trained."""

    what = "policy settings"


class Sees(Form):
    """What a policy is told.

    Attributes:
        kind: "state": where robot, things and handles are; "cloud": points on everything, and the robot's own state.
        frames: How many observations in a row, the latest last.
        things, handles: Of how many it is told, or tells itself from a cloud, those that the task names first.
        room: In how many directions it is told what room there is, around its base and beside the first thing
            (`surroundings.py`); with any, also where that thing's corners and hinge are ("state" only).
        points: How many of the cloud's points it sees ("cloud" only).
        locates: Whether it tells from the cloud where things and handles are, and acts on that (`seen/locator.py`).
        phase: Whether it is told which primitive of the plan is going on; it then foretells when the next one begins.
        way: Whether it is told which posture its arm grasps with (`windows.py`): at work the one that most
            demonstrations have, or
        chooses: the one that it takes to be the likeliest where a subtask begins.
    """

    kind: Literal["state", "cloud"] = "state"
    frames: Annotated[StrictInt, Field(ge=1, le=64)] = 1
    things: Annotated[StrictInt, Field(ge=1, le=12)] = 1
    handles: Annotated[StrictInt, Field(ge=0, le=8)] = 1
    room: Annotated[StrictInt, Field(ge=0, le=64)] = 0
    points: Annotated[StrictInt, Field(ge=16, le=POINTS)] = POINTS
    locates: StrictBool = False
    phase: StrictBool = False
    way: StrictBool = False
    chooses: StrictBool = False

    @property
    def places(self) -> bool:
        """Whether what it acts on has places of things and handles: the simulator's, or told from a cloud."""
        return self.kind == "state" or self.locates


class Acts(Form):
    """What a policy does.

    Attributes:
        kind: What actions are, as `executor.robot.actions` defines them.
        hand: Whether it foretells where the hand is to be beside the joints, which are put right by it (`chunks.py`).
        chunk: How many actions in a row it foretells.
        execute: How many of them are done before it looks again.
    """

    kind: Literal["joint_target", "paper"] = "joint_target"
    hand: StrictBool = False
    chunk: Annotated[StrictInt, Field(ge=1, le=64)] = 16
    execute: Annotated[StrictInt, Field(ge=1, le=64)] = 6


class NetworkForm(Form):
    """What a policy computes with.

    Attributes:
        kind: "mlp" over all frames at once, or a causal "transformer" with one token a frame.
        width, layers: Of the trunk.
        heads: Of attention; they divide the width ("transformer" only).
        dropout: Share of activations that training leaves out.
        linear: Whether what is seen also counts straight, primitive by primitive: a hand that goes to a place moves by
            as much as it is off, and what is wound through layers loses the last centimetres.
        members: How many such networks there are, each trained on its part of a batch; at work their mean counts.
        point_widths: Widths of what each point goes through before the most of each number is taken ("cloud" only).
    """

    kind: Literal["mlp", "transformer"] = "mlp"
    width: Width = 512
    layers: Annotated[StrictInt, Field(ge=1, le=24)] = 3
    heads: Annotated[StrictInt, Field(ge=1, le=32)] = 8
    dropout: Share = 0.0
    linear: StrictBool = False
    members: Annotated[StrictInt, Field(ge=1, le=16)] = 1
    point_widths: Annotated[tuple[Width, ...], Field(min_length=1, max_length=8)] = (64, 128, 256)


class TrainingForm(Form):
    """How it is trained: AdamW on the mean absolute error of normalised actions.

    Attributes:
        steps, batch: Optimiser steps, and samples in each.
        at_once: How many samples of a batch go through the network at once; by default all. Gradients are added up, so
            that it bounds memory and changes a step by rounding alone (and by which activations `dropout` leaves out).
        learning_rate, decay, warm_up: The highest rate; how it goes to 0; steps in which it rises first.
        weight_decay: AdamW's.
        average: Share that the averaged weights keep at a step; these are what is evaluated. 0 takes the last ones.
        noise: Deviation of noise in normalised numbers of the state.
        shift_m, jitter_m: How far a cloud is shifted along each axis at most; deviation of each point's noise.
        mirror: Whether it learns from the mirror image of each demonstration too (`mirror.py`).
        beside_m: Deviation of how far beside where it drove the base is taken to be (`beside.py`).
        clouds: From how many samples of a batch a policy that locates learns to do so in a step.
        usual: Share of the steps, the last ones, in which only the usual way is learned from (`sees.way`).
        keep_every: Weights after so many steps are kept, for a choice by rollouts; 0 keeps the last only.
    """

    steps: Annotated[StrictInt, Field(ge=1, le=10_000_000)] = 12_000
    batch: Annotated[StrictInt, Field(ge=1, le=65_536)] = 256
    at_once: Annotated[StrictInt, Field(ge=1, le=65_536)] | None = None
    learning_rate: Amount = 1e-3
    decay: Literal["cosine", "linear"] = "cosine"
    warm_up: Annotated[StrictInt, Field(ge=0)] = 100
    weight_decay: Amount = 1e-4
    average: Share = 0.0
    noise: Amount = 0.03
    shift_m: Amount = 0.0
    jitter_m: Amount = 0.0
    mirror: StrictBool = False
    beside_m: Amount = 0.0
    clouds: Annotated[StrictInt, Field(ge=1, le=65_536)] = 24
    usual: Annotated[StrictFloat | StrictInt, Field(ge=0, le=1), _AS_FLOAT] = 0.0
    keep_every: Annotated[StrictInt, Field(ge=0)] = 0


class PolicySettings(Form):
    """All of it; the classes of the parts say what there is."""

    sees: Sees = Sees()
    acts: Acts = Acts()
    network: NetworkForm = NetworkForm()
    training: TrainingForm = TrainingForm()


def known_settings() -> tuple[str, ...]:
    """Returns the names of the settings that come along."""
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in _DATA.iterdir() if entry.name.endswith(".toml")))


def read_settings(name: str) -> PolicySettings:
    """Returns the settings of a name that comes along, or of a TOML file.

    Raises:
        SettingsError: There are none, or they do not say what is expected.
    """
    if name in known_settings():
        text = (_DATA / f"{name}.toml").read_text(encoding="utf-8")
    elif name.endswith(".toml"):
        try:
            text = read_bounded_text(Path(name))
        except OSError as problem:
            raise SettingsError(f"cannot be read: {problem.strerror or problem}", source=name) from None
        except UnicodeDecodeError:
            raise SettingsError("is not UTF-8 text", source=name) from None
    else:
        raise SettingsError(f"expected {', '.join(known_settings())}, or a file that ends in .toml", source=name)
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise SettingsError(f"is not TOML: {problem}", source=name) from None
    except RecursionError:
        raise SettingsError("is not TOML of settings: it is nested too deeply", source=name) from None
    return settings_of(content, name)


def settings_of(content: object, source: str) -> PolicySettings:
    """Returns settings of plain data.

    Args:
        content: The settings.
        source: What they are called in messages.

    Raises:
        SettingsError: They do not say what is expected, or contradict each other.
    """
    document = Document(content, source, SettingsError)
    found = document.read(PolicySettings)
    if found.sees.locates and found.sees.kind != "cloud":
        raise document.fail(("sees", "locates"), "expected false where it sees no cloud, got true")
    if found.sees.room and found.sees.kind != "state":
        raise document.fail(("sees", "room"), f"expected 0 where it sees a cloud, got {found.sees.room}")
    if found.sees.chooses and not (found.sees.way and found.sees.places):
        raise document.fail(("sees", "chooses"), "expected false where no way or no places are told, got true")
    if found.acts.execute > found.acts.chunk:
        problem = f"expected at most the {found.acts.chunk} actions of a chunk, got {found.acts.execute}"
        raise document.fail(("acts", "execute"), problem)
    if found.training.beside_m and (found.sees.kind != "state" or found.acts.kind != "joint_target"):
        problem = "expected 0 where it sees a cloud, or does the hand's actions: these would be others"
        raise document.fail(("training", "beside_m"), problem)
    if found.acts.hand and found.acts.kind != "joint_target":
        raise document.fail(("acts", "hand"), "expected false where actions are the hand's already")
    if found.network.kind == "transformer" and found.network.width % found.network.heads:
        problem = f"expected a divisor of the width {found.network.width}, got {found.network.heads}"
        raise document.fail(("network", "heads"), problem)
    _check_training(found, document)
    return found


def _check_training(found: PolicySettings, document: Document) -> None:
    """Refuses what training would pass over in silence."""
    form, members = found.training, found.network.members
    if form.shift_m and (found.sees.kind != "cloud" or found.sees.locates):
        problem = f"expected 0 where it sees no cloud, or locates by it, got {form.shift_m:g}"
        raise document.fail(("training", "shift_m"), problem)
    if form.jitter_m and found.sees.kind != "cloud":
        raise document.fail(("training", "jitter_m"), f"expected 0 where it sees no cloud, got {form.jitter_m:g}")
    if form.usual and not found.sees.way:
        raise document.fail(("training", "usual"), f"expected 0 where no way is told, got {form.usual:g}")
    for name, count in (("batch", form.batch), ("at_once", form.at_once)):
        if count is not None and count < members:
            problem = f"expected at least 1 for each of the {members} members, got {count}"
            raise document.fail(("training", name), problem)
