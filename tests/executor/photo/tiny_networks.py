"""Networks with random weights that fit in a test: of the forms that people have in folders, a few layers each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

WORDS = [
    "[PAD]",
    "[UNK]",
    "[CLS]",
    "[SEP]",
    "[MASK]",
    ".",
    "a",
    "photo",
    "of",
    "cup",
    "table",
    "chair",
    "bottle",
    "book",
]


def _tokenizer(transformers: Any, folder: Path) -> None:
    tokenizers = __import__("tokenizers")
    words = tokenizers.Tokenizer(
        tokenizers.models.WordPiece({word: place for place, word in enumerate(WORDS)}, unk_token="[UNK]")
    )
    words.normalizer = tokenizers.normalizers.BertNormalizer()
    words.pre_tokenizer = tokenizers.pre_tokenizers.BertPreTokenizer()
    words.post_processor = tokenizers.processors.BertProcessing(("[SEP]", 3), ("[CLS]", 2))
    special = {"unk_token": "[UNK]", "pad_token": "[PAD]", "cls_token": "[CLS]", "sep_token": "[SEP]"}
    transformers.PreTrainedTokenizerFast(tokenizer_object=words, **special).save_pretrained(folder)


def grounding_dino(transformers: Any, folder: Path) -> Any:
    """Write a Grounding DINO of 0.2 million weights, and returns it."""
    swin = transformers.SwinConfig(
        embed_dim=8,
        depths=[1, 1, 1, 1],
        num_heads=[1, 1, 1, 1],
        window_size=4,
        image_size=64,
        out_features=["stage2", "stage3", "stage4"],
    )
    bert = transformers.BertConfig(
        hidden_size=16, num_hidden_layers=1, num_attention_heads=2, intermediate_size=32, vocab_size=64
    )
    config = transformers.GroundingDinoConfig(
        backbone_config=swin,
        text_config=bert,
        d_model=32,
        encoder_layers=2,
        decoder_layers=2,
        encoder_ffn_dim=16,
        decoder_ffn_dim=16,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        num_queries=10,
        num_feature_levels=4,
    )
    network = transformers.GroundingDinoForObjectDetection(config).eval()
    network.save_pretrained(folder)
    size = {"shortest_edge": 256, "longest_edge": 320}
    transformers.GroundingDinoImageProcessorPil(size=size).save_pretrained(folder)
    _tokenizer(transformers, folder)
    return network


def owlv2(transformers: Any, folder: Path) -> Any:
    """Write an OWLv2 of a few thousand weights, and returns it."""
    tower = {"hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 32}
    text = {"vocab_size": 64, "max_position_embeddings": 16, "bos_token_id": 2, "eos_token_id": 3, "pad_token_id": 0}
    config = transformers.Owlv2Config(
        text_config={**tower, **text}, vision_config={**tower, "image_size": 64, "patch_size": 16}, projection_dim=16
    )
    network = transformers.Owlv2ForObjectDetection(config).eval()
    for weight in network.parameters():
        # So that boxes stay near the places that they begin at, and some of them in the picture.
        weight.data *= 0.2
    network.save_pretrained(folder)
    transformers.Owlv2ImageProcessorPil(size={"height": 64, "width": 64}).save_pretrained(folder)
    _tokenizer(transformers, folder)
    return network


def depth_anything(transformers: Any, folder: Path, *, metric: bool = True) -> Any:
    """Write a Depth Anything of some ten thousand weights, and returns it."""
    backbone = transformers.Dinov2Config(
        hidden_size=32,
        num_hidden_layers=4,
        num_attention_heads=2,
        image_size=56,
        patch_size=14,
        out_indices=[1, 2, 3, 4],
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=32,
        patch_size=14,
        neck_hidden_sizes=[8, 8, 8, 8],
        fusion_hidden_size=8,
        head_hidden_size=4,
        depth_estimation_type="metric" if metric else "relative",
        max_depth=20 if metric else 1,
    )
    network = transformers.DepthAnythingForDepthEstimation(config).eval()
    network.save_pretrained(folder)
    size = {"height": 56, "width": 56}
    transformers.DPTImageProcessorPil(size=size, ensure_multiple_of=14, keep_aspect_ratio=True).save_pretrained(folder)
    return network


def coco_ssd(folder: Path, kind: int) -> None:
    """Write an SSD in the form of TensorFlow's zoo: one box in the middle, of a class where the picture is red.

    The mean colour decides: its red share, of 255, is the logit of the class less 100.
    """
    weights = np.zeros((1, 1, 3, 91), np.float32)
    weights[0, 0, 0, kind] = 1.0
    bias = np.full(91, -100.0, np.float32)
    constants = {
        "loc/weights": np.zeros((1, 1, 3, 4), np.float32),
        "loc/bias": np.zeros(4, np.float32),
        "conf/weights": weights,
        "conf/bias": bias,
        "axis": np.array(-1, np.int32),
    }
    folder.mkdir(parents=True, exist_ok=True)
    content = b"".join(_field(1, _constant(name, value)) for name, value in constants.items())
    (folder / "frozen_inference_graph.pb").write_bytes(content)
    (folder / "graph.pbtxt").write_text(_GRAPH)


def _varint(number: int) -> bytes:
    digits = []
    while number > 127:
        digits.append(number & 127 | 128)
        number >>= 7
    return bytes([*digits, number])


def _field(number: int, content: bytes) -> bytes:
    """Return a field of a protocol buffer that has a length."""
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _constant(name: str, value: np.ndarray) -> bytes:
    """Return a node of TensorFlow's graph that holds an array (fields of NodeDef, AttrValue, TensorProto)."""
    kind = 1 if value.dtype == np.float32 else 3
    shape = b"".join(_field(2, _number(1, side)) for side in value.shape)
    tensor = _number(1, kind) + _field(2, shape) + _field(4, value.tobytes())
    attributes = {"value": _field(8, tensor), "dtype": _number(6, kind)}
    listed = b"".join(_field(5, _field(1, key.encode()) + _field(2, one)) for key, one in attributes.items())
    return _field(1, name.encode()) + _field(2, b"Const") + listed


def _node(name: str, op: str, *inputs: str, **attributes: str) -> str:
    lines = [f'  name: "{name}"', f'  op: "{op}"', *(f'  input: "{one}"' for one in inputs)]
    lines += [f'  attr {{ key: "{key}" value {{ {value} }} }}' for key, value in attributes.items()]
    return "node {\n" + "\n".join(lines) + "\n}\n"


def _floats(*values: float) -> str:
    listed = " ".join(f"float_val: {value}" for value in values)
    return f"tensor {{ dtype: DT_FLOAT tensor_shape {{ dim {{ size: {len(values)} }} }} {listed} }}"


_ONES = "list { i: 1 i: 1 i: 1 i: 1 }"
_WHOLE = "list { i: 1 i: 300 i: 300 i: 1 }"
_GRAPH = (
    _node("image_tensor", "Placeholder", dtype="type: DT_UINT8")
    + _node("mean", "AvgPool", "image_tensor", ksize=_WHOLE, strides=_WHOLE, padding='s: "VALID"')
    + "".join(
        _node(f"{one}/Conv2D", "Conv2D", "mean", f"{one}/weights", strides=_ONES, padding='s: "VALID"')
        + _node(f"{one}/BiasAdd", "BiasAdd", f"{one}/Conv2D", f"{one}/bias")
        + _node(f"{one}/flat", "Flatten", f"{one}/BiasAdd")
        for one in ("loc", "conf")
    )
    + _node("conf/sigmoid", "Sigmoid", "conf/flat")
    + _node(
        "prior",
        "PriorBox",
        "loc/BiasAdd",
        "image_tensor",
        flip="b: false",
        clip="b: false",
        variance=_floats(0.1, 0.1, 0.2, 0.2),
        width=_floats(180.0),
        height=_floats(100.0),
    )
    + _node(
        "detection_out",
        "DetectionOutput",
        "loc/flat",
        "conf/sigmoid",
        "prior",
        num_classes="i: 91",
        share_location="b: true",
        background_label_id="i: 0",
        nms_threshold="f: 0.6",
        top_k="i: 100",
        code_type='s: "CENTER_SIZE"',
        keep_top_k="i: 100",
        confidence_threshold="f: 0.01",
    )
)
