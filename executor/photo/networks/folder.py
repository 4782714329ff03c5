"""Folders of weights: what has to lie in one, and how a network of `transformers` is loaded from it.

Nothing is downloaded. Weights are read from safetensors alone, and no code beside them is run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.photo.errors import PhotoRefused
from executor.system.extras import require
from executor.system.files import read_json

CONFIG = "config.json"
PLAIN_PROCESSOR = "ViTImageProcessorPil"
"""Scales a picture to one size and normalises it. The networks' own classes for that need torchvision."""

_SCALING = ("size", "image_mean", "image_std")
_LOCAL = {"local_files_only": True, "trust_remote_code": False}
_FILES = (
    ("weights in safetensors (model.safetensors)", ("*.safetensors",)),
    ("preprocessor_config.json", ("preprocessor_config.json", "processor_config.json")),
)
_WORDS = ("tokenizer.json", ("tokenizer.json", "vocab.txt", "vocab.json"))
_CODE = ("*.bin", "*.pt", "*.pth", "*.ckpt", "*.pkl")


@dataclass(frozen=True)
class NetworkClass:
    """Classes of `transformers` that run a kind of network.

    Attributes:
        model: Of the network.
        processor: Of its preprocessing of pictures.
        reads_words: Whether it needs a tokenizer.
    """

    model: str
    processor: str = PLAIN_PROCESSOR
    reads_words: bool = False


@dataclass(frozen=True)
class Network:
    """A loaded network.

    Attributes:
        model: The network, in evaluation mode.
        processor: Its preprocessing of pictures.
        folder: Its folder.
        torch, transformers: The libraries.
    """

    model: Any
    processor: Any
    folder: Path
    torch: Any
    transformers: Any

    def pixels(self, rgb: NDArray[np.uint8], side_px: int | None = None) -> Any:
        """Return the preprocessed picture (H, W, 3) as a tensor (1, 3, h, w).

        Args:
            rgb: The picture.
            side_px: Side of the square that the network takes; by default the size in its folder.
        """
        size = {} if side_px is None else {"size": {"height": side_px, "width": side_px}}
        return self.processor(images=rgb, return_tensors="pt", **size)["pixel_values"]

    def answer(self, **inputs: Any) -> Any:
        """Run the network.

        Raises:
            PhotoRefused: It fails, because its configuration is not that of its weights.
        """
        try:
            with self.torch.inference_mode():
                return self.model(**inputs)
        except (RuntimeError, ValueError, TypeError, IndexError) as error:
            raise unusable(self.folder, f"its network does not run ({first_line(error)})") from error

    def resized(self, plane: Any, size_px: tuple[int, int], mode: str = "bilinear") -> Any:
        """Return a tensor (h, w) scaled to the width and height of a picture."""
        scaled = self.torch.nn.functional.interpolate(plane[None, None].float(), size=size_px[::-1], mode=mode)
        return scaled[0, 0]

    def tokenizer(self) -> Any:
        """Return the network's tokenizer.

        Raises:
            PhotoRefused: The folder has none.
        """
        try:
            return self.transformers.AutoTokenizer.from_pretrained(self.folder, **_LOCAL)
        except (OSError, ValueError, KeyError) as error:
            raise unusable(self.folder, f"has no tokenizer that can be read ({first_line(error)})") from error


def network_config(folder: Path, kinds: Mapping[str, NetworkClass]) -> dict[str, Any]:
    """Return the configuration of the network in a folder, which has all files of one.

    Args:
        folder: The folder.
        kinds: Accepted values of `model_type`.

    Raises:
        PhotoRefused: There is no such folder, its configuration is that of another network, or files are missing.
    """
    if not folder.is_dir():
        raise PhotoRefused("weights", folder, "is no folder", "expected one with config.json and model.safetensors")
    kind, config = None, None
    if (folder / CONFIG).exists():
        try:
            config = read_json(folder / CONFIG)
        except (OSError, ValueError) as error:
            raise unusable(folder, f"its {CONFIG} cannot be read ({first_line(error)})") from error
        kind = config.get("model_type") if isinstance(config, dict) else None
        if kind not in kinds:
            raise unusable(folder, f"holds a network of the kind {kind!r}", f"expected {' or '.join(kinds)}")
    needed = (*_FILES, _WORDS) if kind is not None and kinds[kind].reads_words else _FILES
    lacking = [name for name, patterns in needed if not any(any(folder.glob(one)) for one in patterns)]
    if not isinstance(config, dict) or lacking:
        listed = ", ".join([*([] if config else [CONFIG]), *lacking])
        others = sorted(path.name for pattern in _CODE for path in folder.glob(pattern))
        hint = f"{others[0]} can run code, and is not read" if others else "expected what `save_pretrained` writes"
        raise unusable(folder, f"lacks {listed}", hint)
    return config


def loaded(folder: Path, kind: NetworkClass) -> Network:
    """Load the network of a folder.

    Args:
        folder: The folder, whose configuration has been checked.
        kind: The classes that run it.

    Raises:
        PhotoRefused: Its files cannot be read, or are incomplete.
        MissingExtra: The libraries are not installed.
    """
    transformers, torch = require("transformers", "vision"), require("torch", "vision")
    with _quiet(transformers):
        try:
            network, loading_info = getattr(transformers, kind.model).from_pretrained(
                folder, use_safetensors=True, dtype=torch.float32, output_loading_info=True, **_LOCAL
            )
            processor_class = getattr(transformers, kind.processor)
            written, _ = processor_class.get_image_processor_dict(folder, **_LOCAL)
            processor = processor_class.from_pretrained(folder, **_LOCAL)
        except Exception as error:
            # The libraries raise some ten kinds of errors for faulty weights.
            raise unusable(folder, f"its weights cannot be read ({first_line(error)})") from error
    missing = loading_info.get("missing_keys") or loading_info.get("mismatched_keys")
    if missing:
        raise unusable(folder, f"lacks {len(missing)} of the network's weights, such as {min(map(str, missing))}")
    # The plain class has other defaults than the networks' own.
    unsaid = [name for name in _SCALING if kind.processor == PLAIN_PROCESSOR and name not in written]
    if unsaid:
        raise unusable(folder, f"its preprocessing does not have {', '.join(unsaid)}")
    return Network(network.eval(), processor, folder, torch, transformers)


@contextmanager
def _quiet(transformers: Any) -> Iterator[None]:
    """Keep progress bars and remarks off the terminal; errors are raised."""
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


def unusable(folder: Path, problem: str, hint: str = "") -> PhotoRefused:
    """Return the error of a folder of weights."""
    return PhotoRefused("weights", folder, problem, hint)


def first_line(error: Exception) -> str:
    """Return the first line of a library's message."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
