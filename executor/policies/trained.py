"""A trained policy in a folder: `policy.json` says what it is, `weights.safetensors` holds what it learned.

    policy.json             settings, sizes, what numbers are divided by, what it was trained on
    weights.safetensors     of the last step, averaged where that was asked for
    steps/008000.safetensors    the same of earlier steps, where they were to be kept
    resume.safetensors      where training goes on: weights, averages, the optimiser's state
    training.jsonl          loss by step

Nothing in it is executed when it is read.
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

from bddl.files import temporary_beside
from executor.datasets.formats.observations import LARGEST
from executor.machine.files import content_key, json_text, read_json, write_json
from executor.policies.chunks import numbers_each
from executor.policies.networks import NetworkSizes, PolicyNetwork
from executor.policies.seen.features import Numbers, shown_numbers
from executor.policies.settings import PolicySettings, settings_of
from executor.policies.steps import DRIVES, primitive_of, subtask_of
from executor.policies.windows import Demonstrations, EpisodeKind, scale_of
from oag.model.primitives import Primitive

SCHEMA = "scene2demo-policy/4"
ABOUT, WEIGHTS, RESUME, LOSSES, STEPS = (
    *("policy.json", "weights.safetensors", "resume.safetensors", "training.jsonl", "steps"),
)
_LEAST_SPREAD = 1e-3
"""In m or rad: numbers that hardly vary are not blown up."""

_SEEN_SHARE, _DONE_SHARE = 0.1, 0.05
"""Of the deviation over all phases, the least that counts within one: where a primitive rests, a centimetre seen is no
small thing, and a millimetre done no large one."""


TAKEN_M = 0.1
"""What nearly all grasps are nearer to is what they take: long handles are held 6 cm off the middle."""

ODD_SHARE = 0.05
"""Of demonstrations, at either end: what so few of them show, such as another of two doors opened, is no bound."""

MOST_DEVIATIONS = 5.0
"""What is seen counts as no farther from its mean: demonstrations hardly are, and nothing was learned of beyond."""


class NotAPolicy(ValueError):
    """A folder holds no policy, or not a whole one."""


@dataclass(frozen=True)
class PolicyRecord:
    """All that is known of a policy beside its weights.

    Attributes:
        settings: What it is and how it is trained.
        seed: Of its first weights, of batches and noise.
        rate_hz: Actions a second.
        steps: Numbers of the plans' steps (`steps.py`) that it knows as phases.
        numbers: Mean and deviation (P, F) of what is seen, for each step where policies are told it, else P = 1.
        actions: The same (P, H, A) of chunks.
        left: Least and most (P, G) of what shows how far a plan has come, where each step had been left.
        longest_s: (P,) for how long nearly all demonstrations were in each step at most.
        kinds: What the demonstrations are of.
        seeds: Of the demonstrations; they say nothing of what it does elsewhere.
        demonstrations: How many there were.
        takeovers: How many of them go on from where a policy had come to.
        ways: How many ways of grasping it tells apart (`windows.py`).
        data_key: Follows from what they are.
    """

    settings: PolicySettings
    seed: int
    rate_hz: float
    steps: tuple[int, ...]
    numbers: tuple[Numbers, Numbers]
    actions: tuple[Numbers, Numbers]
    left: tuple[Numbers, Numbers]
    longest_s: Numbers
    kinds: tuple[EpisodeKind, ...]
    seeds: tuple[int, ...]
    demonstrations: int
    takeovers: int
    ways: int
    data_key: str

    @classmethod
    def of(cls, settings: PolicySettings, seed: int, data: Demonstrations) -> PolicyRecord:
        """Returns the record of a policy that is to be trained on demonstrations."""
        chunks, _ = data.chunks(np.arange(len(data)), settings.acts.chunk)
        phases = data.phases if settings.sees.phase else np.zeros_like(data.phases)
        count = len(data.steps) if settings.sees.phase else 1
        return cls(
            settings=settings,
            seed=seed,
            rate_hz=data.rate_hz,
            steps=data.steps,
            numbers=_spread(data.numbers, phases, count, _SEEN_SHARE),
            actions=_spread(chunks, phases, count, _DONE_SHARE),
            left=_left(settings, data),
            longest_s=_longest_s(data, phases, count),
            kinds=data.kinds,
            seeds=data.seeds,
            demonstrations=len(data.names),
            takeovers=data.takeovers,
            ways=int(data.ways.max()) + 1,
            data_key=data.key,
        )

    @property
    def sizes(self) -> NetworkSizes:
        """Of the network."""
        each = numbers_each(self.settings.acts)
        return NetworkSizes(self.numbers[0].shape[-1], each, len(self.steps), self.ways)

    @property
    def scale(self) -> float:
        """Of the robot, of a Panda's full size."""
        return scale_of(self.kinds)

    @property
    def key(self) -> str:
        """Follows from all of it: training goes on with a policy of the same key only."""
        return content_key(json_text(self.to_json()))

    @property
    def but_for_its_seed(self) -> str:
        """A key that is equal when two policies differ in nothing but the seed of their training."""
        return replace(self, seed=0).key

    def network(self) -> PolicyNetwork:
        """Returns the network with new weights."""
        return PolicyNetwork(self.settings, self.sizes)

    def to_json(self) -> dict[str, Any]:
        """Returns the record as plain data."""
        return {
            "schema": SCHEMA,
            "settings": self.settings.model_dump(mode="json"),
            "seed": self.seed,
            "rate_hz": self.rate_hz,
            "steps": self.steps,
            "numbers": self.numbers,
            "actions": self.actions,
            "left": self.left,
            "longest_s": self.longest_s,
            "seeds": self.seeds,
            "kinds": [kind.to_json() for kind in self.kinds],
            "demonstrations": self.demonstrations,
            "takeovers": self.takeovers,
            "ways": self.ways,
            "data_key": self.data_key,
        }

    @classmethod
    def from_json(cls, told: Mapping[str, Any], source: str) -> PolicyRecord:
        """Returns the record that `to_json` gave.

        Raises:
            NotAPolicy: It did not give this.
            SettingsError: Its settings are none.
        """
        try:
            if told["schema"] != SCHEMA:
                raise NotAPolicy(f"{source} is of {told['schema']!r}, this program reads {SCHEMA!r}")
            settings = settings_of(told["settings"], source)
            names = ("numbers", "actions", "left")
            seen, done, left = ([np.asarray(part, np.float32) for part in told[name]] for name in names)
            count = len(told["steps"]) if settings.sees.phase else 1
            each = (count, settings.acts.chunk, numbers_each(settings.acts))
            shapes = [part.shape for part in (*seen, *left)]
            if any(len(shape) != 2 or shape[0] != count for shape in shapes) or shapes[::2] != shapes[1::2]:
                raise ValueError("arrays of other shapes than the settings say")
            if [part.shape for part in done] != [each, each]:
                raise ValueError("arrays of other shapes than the settings say")
            sees = settings.sees
            shown = 1 + (3 * (sees.things + sees.handles) + sees.handles if sees.places else 0)
            longest_s = np.asarray(told["longest_s"], np.float32)
            steps = tuple(int(number) for number in told["steps"])
            if left[0].shape[1] != shown or list(steps) != sorted({*steps}) or not all(map(primitive_of, steps)):
                raise ValueError("bounds or steps that are not those of such a policy")
            if longest_s.shape != (count,) or not (longest_s > 0.0).all():
                raise ValueError("longest steps that are not one for each")
            rate_hz, kinds = float(told["rate_hz"]), _KINDS.validate_python(told["kinds"])
            if not 0.0 < rate_hz < np.inf or not kinds:
                raise ValueError("no rate above 0, or nothing that its demonstrations are of")
            parts = (*seen, *done, *left, longest_s)
            if not all(np.isfinite(part).all() for part in parts) or min(seen[1].min(), done[1].min()) <= 0:
                raise ValueError("numbers that are not finite, or deviations that are not above 0")
            return cls(
                settings=settings,
                seed=int(told["seed"]),
                rate_hz=rate_hz,
                steps=steps,
                numbers=(seen[0], seen[1]),
                actions=(done[0], done[1]),
                left=(left[0], left[1]),
                longest_s=longest_s,
                seeds=tuple(int(seed) for seed in told["seeds"]),
                kinds=kinds,
                demonstrations=int(told["demonstrations"]),
                takeovers=int(told["takeovers"]),
                ways=int(told["ways"]),
                data_key=str(told["data_key"]),
            )
        except NotAPolicy:
            raise
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            raise NotAPolicy(f"{source} does not say what a policy is: {problem}") from None


def _spread(values: NDArray, groups: NDArray[np.int64], count: int, shares: float) -> tuple[Numbers, Numbers]:
    """Returns (count, ...) mean and standard deviation over the first axis, group by group.

    What hardly varies within a group is not blown up: deviations are not below a share of that over all groups, nor
    below `_LEAST_SPREAD`. A group that does not occur has the mean and the deviation over all.

    Args:
        values: (N, ...).
        groups: (N,) which group each is of.
        count: How many groups there are.
        shares: That share.
    """
    stacked = np.asarray(values, dtype=np.float64)
    mean, deviation = stacked.mean(axis=0), np.maximum(stacked.std(axis=0), _LEAST_SPREAD)
    means, deviations = np.stack([mean] * count), np.stack([deviation] * count)
    for group in np.unique(groups):
        rows = stacked[groups == group]
        means[group] = rows.mean(axis=0)
        deviations[group] = np.maximum(rows.std(axis=0), np.maximum(shares * deviation, _LEAST_SPREAD))
    return means.astype(np.float32), deviations.astype(np.float32)


def _left(settings: PolicySettings, data: Demonstrations) -> tuple[Numbers, Numbers]:
    """Returns the least and the most of what shows how far a plan has come, where steps had been left.

    What is never left, such as the last one, has no bounds; nor has where things are that a subtask takes no hold of.
    """
    sees = settings.sees
    shown = shown_numbers(data.numbers, sees.places, sees.things, sees.handles)
    count = len(data.steps) if sees.phase else 1
    most = np.full((count, shown.shape[1]), LARGEST, np.float32)
    least = -most
    if not sees.phase:
        return least, most
    rows, left = data.after_leaving(settings.acts.execute)
    arrived, driven = data.after_leaving(1)
    if not sees.chooses:
        usual = data.ways[arrived] == 0
        arrived, driven = arrived[usual], driven[usual]
    for phase in np.unique(left):
        # Where a drive ends, the way that is done stands still; all other steps are left while one looks elsewhere.
        drives = primitive_of(data.steps[phase]) in DRIVES
        seen = shown[arrived[driven == phase]] if drives and (driven == phase).any() else shown[rows[left == phase]]
        least[phase], most[phase] = np.quantile(seen, ODD_SHARE, axis=0), np.quantile(seen, 1.0 - ODD_SHARE, axis=0)
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
    """Returns (count,) for how long all but the longest `ODD_SHARE` of the stretches of each phase go on."""
    begun = np.flatnonzero(np.append(True, data.lasts[1:] != data.lasts[:-1]))
    lengths, of = data.lasts[begun] - begun, phases[begun]
    moments = [np.quantile(lengths[of == phase], 1.0 - ODD_SHARE) for phase in range(count)]
    return (np.array(moments) / data.rate_hz).astype(np.float32)


_KINDS = TypeAdapter(tuple[EpisodeKind, ...])


def normalised(numbers: Tensor, phase: Tensor, scales: tuple[Tensor, Tensor]) -> Tensor:
    """Returns (..., F) numbers less their mean, by their deviation, in the phase that each is of.

    Args:
        numbers: (..., F).
        phase: (...).
        scales: Mean and deviation, (P, F).
    """
    mean, deviation = scales
    return ((numbers - mean[phase]) / deviation[phase]).clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS)


def write_record(folder: Path, record: PolicyRecord) -> None:
    """Writes what a policy is.

    Raises:
        OSError: The folder cannot be written.
    """
    write_json(folder / ABOUT, record.to_json())


def read_record(folder: Path) -> PolicyRecord:
    """Returns what the policy in a folder is.

    Raises:
        NotAPolicy: There is none.
    """
    path = folder / ABOUT
    try:
        told = read_json(path)
    except OSError as problem:
        raise NotAPolicy(f"{folder} holds no policy: {ABOUT} cannot be read ({problem.strerror})") from None
    except ValueError as problem:
        raise NotAPolicy(f"{path} is no JSON: {problem}") from None
    return PolicyRecord.from_json(told, str(path))


def write_tensors(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Writes tensors, all of them or nothing.

    Raises:
        OSError: The file cannot be written.
    """
    with temporary_beside(path) as temporary:
        save_file({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, temporary)


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Returns the tensors of a file.

    Raises:
        NotAPolicy: It is missing, or no file of tensors.
    """
    try:
        return load_file(path)
    except OSError as problem:
        raise NotAPolicy(f"{path} cannot be read: {problem.strerror or problem}") from None
    except SafetensorError as problem:
        raise NotAPolicy(f"{path} is no file of tensors: {problem}") from None


def load_network(folder: Path, record: PolicyRecord, step: int | None = None) -> PolicyNetwork:
    """Returns a policy's network, ready to act.

    Args:
        folder: Where it is.
        record: What it is.
        step: After how many steps of training, of those that were kept; by default the last.

    Raises:
        NotAPolicy: Its weights are missing, or of another network.
    """
    network = record.network()
    path = folder / WEIGHTS if step is None else step_path(folder, step)
    if not path.exists():
        kept = sorted(int(file.stem) for file in (folder / STEPS).glob("*.safetensors") if file.stem.isdecimal())
        told = f"; kept are those of {', '.join(map(str, kept))}" if kept else ""
        raise NotAPolicy(f"{folder} has no weights{'' if step is None else f' of step {step}'} yet{told}")
    try:
        network.load_state_dict(read_tensors(path))
    except RuntimeError:
        raise NotAPolicy(f"{path} holds the weights of another network than {folder / ABOUT} says") from None
    return network.eval()


def policy_key(folder: Path, step: int | None = None) -> str:
    """Returns a key that is equal when a policy and its weights are.

    Raises:
        NotAPolicy: It is none, or these weights are missing.
    """
    record = read_record(folder)
    path = folder / WEIGHTS if step is None else step_path(folder, step)
    try:
        return content_key(record.key, path.read_bytes())
    except OSError as problem:
        raise NotAPolicy(f"{path} cannot be read: {problem.strerror}") from None


def step_path(folder: Path, step: int) -> Path:
    """Returns where the weights of a step are kept."""
    return folder / STEPS / f"{step:06d}.safetensors"
