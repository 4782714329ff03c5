"""Settings of a policy and its training: a TOML file, or the name of a built-in one.

[sees]                      # observations
kind = "state"              # or "cloud": a point cloud with a mask of the hand
frames = 1                  # observations in a row
phase = true                # and the running primitive of the plan

[acts]
kind = "joint_target"       # or "paper": the ten numbers of a hand action
chunk = 16                  # predicted actions
execute = 6                 # executed actions before the next observation

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

from pydantic import AfterValidator, ConfigDict, Field, StrictBool, StrictFloat, StrictInt

from bddl.files import read_bounded_text
from executor.data.state_readers import POINTS
from oag.model.codec import Document
from oag.model.diagnostics import InputError
from oag.model.forms import Form

_DATA = resources.files("executor.learn") / "data"
# 1 and 1.0 are the same setting.
_AS_FLOAT = AfterValidator(lambda value: float(value) + 0.0)
Amount = Annotated[StrictFloat | StrictInt, Field(ge=0, le=1e6), _AS_FLOAT]
Share = Annotated[StrictFloat | StrictInt, Field(ge=0, lt=1), _AS_FLOAT]
Width = Annotated[StrictInt, Field(ge=1, le=4096)]


class SettingsError(InputError, ValueError):
    """A file has no valid policy settings."""

    what = "policy settings"


class Sees(Form):
    """Observations of a policy.

    Attributes:
        kind: "state": poses of robot, things and handles; "cloud": points on everything, and the robot's own state.
        frames: Number of observations in a row, the latest last.
        things, handles: Number of observed (or located) things and handles, those that the task names first.
        room: Number of directions of free-space distances, around the base and around the first thing
            (`surrounding_numbers`); with any, also that thing's corners and hinge ("state" only).
        points: Number of observed points of the cloud ("cloud" only).
        locates: Whether it locates things and handles in the cloud, and acts on that (`networks.py`).
        phase: Whether it observes the running primitive of the plan; it then predicts when the next one begins.
        way: Whether it observes the grasp mode (`demonstrations.py`); at work it is the most frequent one, unless it
            chooses.
        chooses: Predict the grasp mode at the start of each subtask.
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
        """Whether it acts on places of things and handles: the simulator's, or located in a cloud."""
        return self.kind == "state" or self.locates


class Acts(Form):
    """Actions of a policy.

    Attributes:
        kind: Kind of actions, see `executor.sim.robot.actions`.
        hand: Whether it also predicts the hand's pose, by which the joints are refined (`action_chunks.py`).
        chunk: Number of predicted actions.
        execute: Number of executed actions before the next observation.
    """

    kind: Literal["joint_target", "paper"] = "joint_target"
    hand: StrictBool = False
    chunk: Annotated[StrictInt, Field(ge=1, le=64)] = 16
    execute: Annotated[StrictInt, Field(ge=1, le=64)] = 6


class NetworkForm(Form):
    """Network of a policy.

    Attributes:
        kind: "mlp" over all frames at once, or a causal "transformer" with one token a frame.
        heads: Attention heads; they divide the width ("transformer" only).
        linear: Add a linear skip connection per primitive; it keeps centimetre accuracy. A hand moves by its distance
            from the goal, and deep layers lose the last centimetres.
        members: Number of networks, each trained on its part of a batch; at work their mean counts.
        point_widths: Layer widths per point before the maximum of each number ("cloud" only).
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
    """Training of a policy: AdamW on the mean absolute error of normalised actions.

    Attributes:
        steps, batch: Optimiser steps, and samples per step.
        at_once: Samples of a batch per network pass; by default all. Gradients are accumulated, so that it bounds
            memory and changes a step by rounding alone (and by which activations `dropout` drops).
        learning_rate, decay, warm_up: The highest rate; its decay to 0; steps of its initial rise.
        average: Decay of the averaged weights per step; these are evaluated. 0 takes the last ones.
        noise: Standard deviation of noise in normalised state features.
        shift_m, jitter_m: Maximum shift of a cloud along each axis; standard deviation of each point's noise [m].
        mirror: Whether it learns from the mirror image of each demonstration, too (`mirror_columns`).
        drive_offset_m: Standard deviation of the base's offset in drives (`offset_drives`) [m].
        clouds: Samples of a batch from which a locating policy learns to locate, per step.
        usual: Share of the steps, the last ones, that use only the most frequent grasp mode (`sees.way`).
        keep_every: Interval of kept weights [steps], for a choice by rollouts; 0 keeps the last only.
    """

    model_config = ConfigDict(serialize_by_alias=True)

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
    drive_offset_m: Amount = Field(default=0.0, alias="beside_m")
    clouds: Annotated[StrictInt, Field(ge=1, le=65_536)] = 24
    usual: Annotated[StrictFloat | StrictInt, Field(ge=0, le=1), _AS_FLOAT] = 0.0
    keep_every: Annotated[StrictInt, Field(ge=0)] = 0


class PolicySettings(Form):
    """All settings of a policy."""

    sees: Sees = Sees()
    acts: Acts = Acts()
    network: NetworkForm = NetworkForm()
    training: TrainingForm = TrainingForm()


def known_settings() -> tuple[str, ...]:
    """Return the names of the built-in settings."""
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in _DATA.iterdir() if entry.name.endswith(".toml")))


def read_settings(name: str) -> PolicySettings:
    """Read built-in settings by name, or a TOML file.

    Raises:
        SettingsError: There are none, or they are invalid.
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
    """Parse settings from plain data.

    Raises:
        SettingsError: They are invalid, or contradict each other.
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
    if found.training.drive_offset_m and (found.sees.kind != "state" or found.acts.kind != "joint_target"):
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
    """Refuse settings that training would silently ignore."""
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
