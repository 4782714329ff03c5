"""Networks out of a folder of weights, through `transformers`: what is in the folder decides, and nothing is fetched.

Weights are read from safetensors alone, and no code that lies beside them is run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executor.machine.extras import require
from executor.machine.files import read_json
from executor.photo.refusal import PhotoRefused

CONFIG = "config.json"


@dataclass(frozen=True)
class Network:
    """A network that is ready to be asked.

    Attributes:
        model: The network, in evaluation.
        processor: Makes of a picture what it takes.
        folder: Where it was.
        torch, transformers: The libraries.
    """

    model: Any
    processor: Any
    folder: Path
    torch: Any
    transformers: Any

    def tokenizer(self) -> Any:
        """Returns what makes of words what the network takes.

        Raises:
            PhotoRefused: The folder has none.
        """
        try:
            return self.transformers.AutoTokenizer.from_pretrained(self.folder, **_LOCAL)
        except (OSError, ValueError, KeyError) as error:
            raise _unusable(self.folder, f"has no tokenizer that can be read ({_first_line(error)})") from error


_LOCAL = {"local_files_only": True, "trust_remote_code": False}


def network_config(folder: Path, kinds: Sequence[str]) -> dict[str, Any]:
    """Returns the configuration of the network in a folder.

    Args:
        folder: The folder.
        kinds: The values of `model_type` that are good.

    Raises:
        PhotoRefused: There is no such folder, no configuration in it, or that of another network.
    """
    if not folder.is_dir():
        raise PhotoRefused("weights", folder, "is no folder", "expected one with config.json and model.safetensors")
    try:
        config = read_json(folder / CONFIG)
    except (OSError, ValueError) as error:
        raise _unusable(folder, f"its {CONFIG} cannot be read ({_first_line(error)})") from error
    kind = config.get("model_type") if isinstance(config, dict) else None
    if not isinstance(config, dict) or kind not in kinds:
        raise _unusable(folder, f"holds a network of the kind {kind!r}", f"expected {' or '.join(kinds)}")
    if not any(folder.glob("*.safetensors")):
        raise _unusable(folder, "has no weights in safetensors", "other forms can run code, and are not read")
    return config


def loaded(folder: Path, model: str, processor: str) -> Network:
    """Returns the network in a folder.

    Args:
        folder: The folder, whose configuration has been looked at.
        model, processor: Names of classes of `transformers`.

    Raises:
        PhotoRefused: Its files cannot be read, or are not those of the whole network.
        MissingExtra: The libraries are not installed.
    """
    transformers, torch = require("transformers", "vision"), require("torch", "vision")
    with _quiet(transformers):
        try:
            network, told = getattr(transformers, model).from_pretrained(
                folder, use_safetensors=True, output_loading_info=True, **_LOCAL
            )
            prepares = getattr(transformers, processor).from_pretrained(folder, **_LOCAL)
        except Exception as error:
            # Of what can be wrong with a file of weights, the libraries raise some ten kinds.
            raise _unusable(folder, f"its weights cannot be read ({_first_line(error)})") from error
    missing = told.get("missing_keys") or told.get("mismatched_keys")
    if missing:
        raise _unusable(folder, f"lacks {len(missing)} of the network's weights, such as {min(map(str, missing))}")
    return Network(network.eval(), prepares, folder, torch, transformers)


@contextmanager
def _quiet(transformers: Any) -> Iterator[None]:
    """Keeps progress bars and remarks off the terminal; what matters of them is raised."""
    logs = transformers.utils.logging
    level, bars = logs.get_verbosity(), logs.is_progress_bar_enabled()
    logs.set_verbosity(logs.CRITICAL)
    logs.disable_progress_bar()
    try:
        yield
    finally:
        logs.set_verbosity(level)
        if bars:
            logs.enable_progress_bar()


def _unusable(folder: Path, problem: str, hint: str = "") -> PhotoRefused:
    return PhotoRefused("weights", folder, problem, hint)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
