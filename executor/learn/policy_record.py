"""Trained policy in a folder: `policy.json` describes it, `weights.safetensors` has the weights.

    policy.json             settings, sizes, normalisation, training data
    weights.safetensors     of the last step, averaged where that was requested
    steps/008000.safetensors    the same of earlier steps, where they were kept
    resume.safetensors      state of training: weights, averages, the optimiser's state
    training.jsonl          loss by step

Reading executes nothing. Keys of `policy.json` that this version does not know are ignored, and are no part of the key
by which a finished training is recognised.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from bddl.errors import Scene2DemoError
from bddl.files import atomic_path
from executor.data.state_readers import LARGEST
from executor.learn.action_chunks import action_size
from executor.learn.demonstrations import Demonstrations, EpisodeKind, robot_of_kinds
from executor.learn.networks import NetworkSizes, PolicyNetwork
from executor.learn.observations import DRIVES, Numbers, primitive_of, robot_number_count, shown_numbers, subtask_of
from executor.learn.settings import PolicySettings, settings_of
from executor.system.files import content_key, json_text, read_json, write_json
from oag.model.robots import Robot
from oag.model.symbols import Primitive

SCHEMA = "scene2demo-policy/4"
ABOUT, WEIGHTS, RESUME, LOSSES, STEPS = (
    *("policy.json", "weights.safetensors", "resume.safetensors", "training.jsonl", "steps"),
)
_LEAST_SPREAD = 1e-3
"""Minimum deviation, in m or rad: numbers that hardly vary are not blown up."""

_INPUT_SHARE, _ACTION_SHARE = 0.1, 0.05
"""Minimum deviation within a phase, as a share of that over all phases. Where a primitive rests, an observed centimetre
is not small, and a millimetre of action not large."""


TAKEN_M = 0.1
"""Distance within which nearly all grasps of a thing are: long handles are held 6 cm off the middle."""

ODD_SHARE = 0.05
"""Share of demonstrations ignored at either end of bounds, such as those that opened the other of two doors."""

MOST_DEVIATIONS = 5.0
"""Clipping of normalised observations: demonstrations hardly exceed it, and nothing was learned beyond it."""


class NotAPolicy(Scene2DemoError, ValueError):
    """A folder has no complete policy."""


@dataclass(frozen=True)
class PolicyRecord:
    """Everything about a policy besides its weights.

    Attributes:
        seed: Seed of its initial weights, of batches and noise.
        rate_hz: Actions a second.
        steps: Step numbers (`observations.py`) that it knows as phases.
        numbers: Mean and deviation (P, F) of observed numbers, per step where policies observe it, else P = 1.
        actions: The same (P, H, A) of chunks.
        exit_bounds: Minimum and maximum (P, G) of the progress numbers at the exit of each step.
        longest_s: (P,) maximum duration of nearly all demonstrations in each step [s].
        kinds: Distributions of the demonstrations.
        seeds: Seeds of the demonstrations, on which success proves nothing.
        takeovers: Number of those that continue from a state that a policy reached.
    """

    settings: PolicySettings
    seed: int
    rate_hz: float
    steps: tuple[int, ...]
    numbers: tuple[Numbers, Numbers]
    actions: tuple[Numbers, Numbers]
    exit_bounds: tuple[Numbers, Numbers]
    longest_s: Numbers
    kinds: tuple[EpisodeKind, ...]
    seeds: tuple[int, ...]
    demonstrations: int
    takeovers: int
    grasp_modes: int
    data_key: str

    @classmethod
    def of(cls, settings: PolicySettings, seed: int, data: Demonstrations) -> PolicyRecord:
        """Return the record of a policy to be trained on demonstrations."""
        chunks, _ = data.chunks(np.arange(len(data)), settings.acts.chunk)
        phases = data.phases if settings.sees.phase else np.zeros_like(data.phases)
        count = len(data.steps) if settings.sees.phase else 1
        return cls(
            settings=settings,
            seed=seed,
            rate_hz=data.rate_hz,
            steps=data.steps,
            numbers=_spread(data.numbers, phases, count, _INPUT_SHARE),
            actions=_spread(chunks, phases, count, _ACTION_SHARE),
            exit_bounds=_phase_exit_bounds(settings, data),
            longest_s=_longest_s(data, phases, count),
            kinds=data.kinds,
            seeds=data.seeds,
            demonstrations=len(data.names),
            takeovers=data.takeovers,
            grasp_modes=int(data.grasp_modes.max()) + 1,
            data_key=data.key,
        )

    @property
    def sizes(self) -> NetworkSizes:
        """Sizes of the network."""
        each, own = action_size(self.settings.acts, self.robot), robot_number_count(self.robot)
        return NetworkSizes(self.numbers[0].shape[-1], each, len(self.steps), self.grasp_modes, own)

    @property
    def robot(self) -> Robot:
        """Record of the robot."""
        return robot_of_kinds(self.kinds)

    @property
    def key(self) -> str:
        """Key of the record: training continues only a policy of the same key."""
        return content_key(json_text(self.to_json()))

    @property
    def key_without_seed(self) -> str:
        """Key of the record without the seed of training."""
        return replace(self, seed=0).key

    def network(self) -> PolicyNetwork:
        """Return the network with new weights."""
        return PolicyNetwork(self.settings, self.sizes)

    def to_json(self) -> dict[str, Any]:
        """Return the record as plain data."""
        return {
            "schema": SCHEMA,
            "settings": self.settings.model_dump(mode="json"),
            "seed": self.seed,
            "rate_hz": self.rate_hz,
            "steps": self.steps,
            "numbers": self.numbers,
            "actions": self.actions,
            "left": self.exit_bounds,
            "longest_s": self.longest_s,
            "seeds": self.seeds,
            "kinds": [kind.to_json() for kind in self.kinds],
            "demonstrations": self.demonstrations,
            "takeovers": self.takeovers,
            "ways": self.grasp_modes,
            "data_key": self.data_key,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str) -> PolicyRecord:
        """Parse the record that `to_json` returned.

        Raises:
            NotAPolicy: It is no such data.
            SettingsError: Its settings are invalid.
        """
        try:
            if data["schema"] != SCHEMA:
                raise NotAPolicy(f"{source} is of {data['schema']!r}, this program reads {SCHEMA!r}")
            settings = settings_of(data["settings"], source)
            names = ("numbers", "actions", "left")
            inputs, done, exit_bounds = ([np.asarray(part, np.float32) for part in data[name]] for name in names)
            count = len(data["steps"]) if settings.sees.phase else 1
            shapes = [part.shape for part in (*inputs, *exit_bounds)]
            if any(len(shape) != 2 or shape[0] != count for shape in shapes) or shapes[::2] != shapes[1::2]:
                raise ValueError("arrays of other shapes than the settings say")
            rate_hz, kinds = float(data["rate_hz"]), _KINDS.validate_python(data["kinds"])
            each = (count, settings.acts.chunk, action_size(settings.acts, robot_of_kinds(kinds)))
            if [part.shape for part in done] != [each, each]:
                raise ValueError("arrays of other shapes than the settings say")
            sees = settings.sees
            shown = 1 + (3 * (sees.things + sees.handles) + sees.handles if sees.places else 0)
            longest_s = np.asarray(data["longest_s"], np.float32)
            steps = tuple(int(number) for number in data["steps"])
            if exit_bounds[0].shape[1] != shown or list(steps) != sorted({*steps}) or not all(map(primitive_of, steps)):
                raise ValueError("bounds or steps that are not those of such a policy")
            if longest_s.shape != (count,) or not (longest_s > 0.0).all():
                raise ValueError("longest steps that are not one for each")
            if not 0.0 < rate_hz < np.inf or not kinds:
                raise ValueError("no rate above 0, or nothing that its demonstrations are of")
            parts = (*inputs, *done, *exit_bounds, longest_s)
            if not all(np.isfinite(part).all() for part in parts) or min(inputs[1].min(), done[1].min()) <= 0:
                raise ValueError("numbers that are not finite, or deviations that are not above 0")
            return cls(
                settings=settings,
                seed=int(data["seed"]),
                rate_hz=rate_hz,
                steps=steps,
                numbers=(inputs[0], inputs[1]),
                actions=(done[0], done[1]),
                exit_bounds=(exit_bounds[0], exit_bounds[1]),
                longest_s=longest_s,
                seeds=tuple(int(seed) for seed in data["seeds"]),
                kinds=kinds,
                demonstrations=int(data["demonstrations"]),
                takeovers=int(data["takeovers"]),
                grasp_modes=int(data["ways"]),
                data_key=str(data["data_key"]),
            )
        except NotAPolicy:
            raise
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            raise NotAPolicy(f"{source} does not say what a policy is: {problem}") from None


def _spread(values: NDArray, groups: NDArray[np.int64], count: int, shares: float) -> tuple[Numbers, Numbers]:
    """Return (count, ...) mean and standard deviation over the first axis, group by group.

    Numbers that hardly vary within a group are not blown up: deviations are not below a share of that over all groups,
    nor below `_LEAST_SPREAD`. An absent group has the mean and the deviation over all.

    Args:
        values: (N, ...).
        groups: (N,) the group of each.
    """
    stacked = np.asarray(values, dtype=np.float64)
    mean, deviation = stacked.mean(axis=0), np.maximum(stacked.std(axis=0), _LEAST_SPREAD)
    means, deviations = np.stack([mean] * count), np.stack([deviation] * count)
    for group in np.unique(groups):
        rows = stacked[groups == group]
        means[group] = rows.mean(axis=0)
        deviations[group] = np.maximum(rows.std(axis=0), np.maximum(shares * deviation, _LEAST_SPREAD))
    return means.astype(np.float32), deviations.astype(np.float32)


def _phase_exit_bounds(settings: PolicySettings, data: Demonstrations) -> tuple[Numbers, Numbers]:
    """Return the minimum and maximum of the progress numbers at the exit of each step.

    Steps that are never left, such as the last one, have no bounds; nor have places of things that a subtask does not
    grasp.
    """
    sees = settings.sees
    shown = shown_numbers(data.robot, data.numbers, sees.places, sees.things, sees.handles)
    count = len(data.steps) if sees.phase else 1
    most = np.full((count, shown.shape[1]), LARGEST, np.float32)
    least = -most
    if not sees.phase:
        return least, most
    rows, left = data.after_leaving(settings.acts.execute)
    arrived, driven = data.after_leaving(1)
    if not sees.chooses:
        usual = data.grasp_modes[arrived] == 0
        arrived, driven = arrived[usual], driven[usual]
    for phase in np.unique(left):
        # At the end of a drive the base rests; all other steps are left between two observations.
        drives = primitive_of(data.steps[phase]) in DRIVES
        values = shown[arrived[driven == phase]] if drives and (driven == phase).any() else shown[rows[left == phase]]
        least[phase], most[phase] = np.quantile(values, ODD_SHARE, axis=0), np.quantile(values, 1.0 - ODD_SHARE, axis=0)
    sites = sees.things + sees.handles if sees.places else 0
    subtasks = np.array([subtask_of(step) for step in data.steps])
    grasps = np.array([primitive_of(step) is Primitive.GRASP for step in data.steps])
    for subtask in np.unique(subtasks):
        behind_grasps = rows[(grasps & (subtasks == subtask))[left]]
        for site in (slice(1 + 3 * place, 4 + 3 * place) for place in range(sites)):
            off_m = np.linalg.norm(shown[behind_grasps, site], axis=1)
            if not len(behind_grasps) or np.quantile(off_m, 1.0 - ODD_SHARE) > TAKEN_M:
                least[subtasks == subtask, site], most[subtasks == subtask, site] = -LARGEST, LARGEST
    return least, most


def _longest_s(data: Demonstrations, phases: NDArray[np.int64], count: int) -> Numbers:
    """Return (count,) the maximum duration of each phase without the longest `ODD_SHARE` of its stretches [s]."""
    begun = np.flatnonzero(np.append(True, data.lasts[1:] != data.lasts[:-1]))
    lengths, of = data.lasts[begun] - begun, phases[begun]
    moments = [np.quantile(lengths[of == phase], 1.0 - ODD_SHARE) for phase in range(count)]
    return (np.array(moments) / data.rate_hz).astype(np.float32)


_KINDS = TypeAdapter(tuple[EpisodeKind, ...])


def normalise(numbers: Tensor, phase: Tensor, scales: tuple[Tensor, Tensor]) -> Tensor:
    """Normalise numbers (..., F) by the mean and deviation of their phase.

    Args:
        scales: Mean and deviation, (P, F).
    """
    mean, deviation = scales
    return ((numbers - mean[phase]) / deviation[phase]).clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS)


def write_record(folder: Path, record: PolicyRecord) -> None:
    """Write a policy's record."""
    write_json(folder / ABOUT, record.to_json())


def read_record(folder: Path) -> PolicyRecord:
    """Read the record of the policy in a folder."""
    path = folder / ABOUT
    try:
        data = read_json(path)
    except OSError as problem:
        raise NotAPolicy(f"{folder} holds no policy: {ABOUT} cannot be read ({problem.strerror})") from None
    except ValueError as problem:
        raise NotAPolicy(f"{path} is no JSON: {problem}") from None
    return PolicyRecord.from_json(data, str(path))


def write_tensors(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Write tensors atomically."""
    with atomic_path(path) as temporary:
        save_file({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, temporary)


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Read the tensors of a file."""
    try:
        return load_file(path)
    except OSError as problem:
        raise NotAPolicy(f"{path} cannot be read: {problem.strerror or problem}") from None
    except SafetensorError as problem:
        raise NotAPolicy(f"{path} is no file of tensors: {problem}") from None


def load_network(folder: Path, record: PolicyRecord, step: int | None = None) -> PolicyNetwork:
    """Load a policy's network, ready to act.

    Args:
        step: Step of training, of those that were kept; by default the last.

    Raises:
        NotAPolicy: Its weights are missing, or of another network.
    """
    network = record.network()
    path = folder / WEIGHTS if step is None else step_path(folder, step)
    if not path.exists():
        kept = sorted(int(file.stem) for file in (folder / STEPS).glob("*.safetensors") if file.stem.isdecimal())
        kept_words = f"; kept are those of {', '.join(map(str, kept))}" if kept else ""
        raise NotAPolicy(f"{folder} has no weights{'' if step is None else f' of step {step}'} yet{kept_words}")
    try:
        network.load_state_dict(read_tensors(path))
    except RuntimeError:
        raise NotAPolicy(f"{path} holds the weights of another network than {folder / ABOUT} says") from None
    return network.eval()


def step_path(folder: Path, step: int) -> Path:
    """Return the path of the weights of a step."""
    return folder / STEPS / f"{step:06d}.safetensors"
