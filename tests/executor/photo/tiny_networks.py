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


def grounding_dino(transformers: Any, folder: Path, *, mm: bool = False) -> Any:
    """Write a Grounding DINO, or an MM-Grounding-DINO, of 0.2 million weights, and return it."""
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
    classes = (
        ("MMGroundingDinoConfig", "MMGroundingDinoForObjectDetection")
        if mm
        else ("GroundingDinoConfig", "GroundingDinoForObjectDetection")
    )
    config_class, network_class = (getattr(transformers, name) for name in classes)
    config = config_class(
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
    network = network_class(config).eval()
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


def zoedepth(transformers: Any, folder: Path) -> Any:
    """Write a ZoeDepth of ninety thousand weights, and return it."""
    backbone = transformers.BeitConfig(
        image_size=64,
        num_hidden_layers=4,
        hidden_size=32,
        intermediate_size=32,
        num_attention_heads=2,
        patch_size=16,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        use_relative_position_bias=True,
    )
    config = transformers.ZoeDepthConfig(
        backbone_config=backbone,
        neck_hidden_sizes=[8, 8, 8, 8],
        fusion_hidden_size=8,
        bottleneck_features=8,
        num_relative_features=8,
        bin_embedding_dim=8,
        num_attractors=[4, 4, 2, 1],
        bin_configurations=[{"n_bins": 8, "min_depth": 0.001, "max_depth": 10.0}],
        patch_transformer_hidden_size=16,
        patch_transformer_intermediate_size=16,
        patch_transformer_num_attention_heads=2,
        num_attention_heads=2,
    )
    network = transformers.ZoeDepthForDepthEstimation(config).eval()
    network.save_pretrained(folder)
    processor = transformers.ZoeDepthImageProcessorPil(size={"height": 64, "width": 64}, ensure_multiple_of=16)
    processor.save_pretrained(folder)
    return network


def depth_pro(transformers: Any, folder: Path, *, hfov_deg: float = 60.0) -> Any:
    """Write a Depth Pro of thirty thousand weights that guesses about one opening angle, and return it."""
    encoder = {
        "model_type": "dinov2",
        "hidden_size": 16,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "patch_size": 4,
        "image_size": 16,
        "mlp_ratio": 1,
    }
    config = transformers.DepthProConfig(
        patch_size=16,
        image_model_config=encoder,
        patch_model_config=encoder,
        fov_model_config=encoder,
        fusion_hidden_size=8,
        intermediate_hook_ids=[1, 0],
        intermediate_feature_dims=[8, 8],
        scaled_images_ratios=[0.5, 1.0],
        scaled_images_overlap_ratios=[0.0, 0.25],
        scaled_images_feature_dims=[8, 8],
        use_fov_model=True,
        num_fov_head_layers=1,
    )
    network = transformers.DepthProForDepthEstimation(config).eval()
    *_, last = (one for one in network.head.modules() if hasattr(one, "bias") and one.bias is not None)
    last.bias.data.fill_(0.3)
    last.weight.data *= 0.01
    *_, angle = (one for one in network.fov_model.head.modules() if hasattr(one, "bias") and one.bias is not None)
    angle.bias.data.fill_(hfov_deg)
    angle.weight.data *= 0.01
    network.save_pretrained(folder)
    _scaled_to(transformers, folder, 64)
    return network


def _scaled_to(transformers: Any, folder: Path, side_px: int) -> None:
    size = {"height": side_px, "width": side_px}
    processor = transformers.ViTImageProcessorPil(size=size, image_mean=[0.4, 0.5, 0.6], image_std=[0.2, 0.3, 0.4])
    processor.save_pretrained(folder)


def sam2(transformers: Any, folder: Path) -> Any:
    """Write a SAM 2 of a hundred thousand weights, and return it."""
    hiera = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 8,
        "num_attention_heads": 1,
        "image_size": [64, 64],
        "blocks_per_stage": [1, 1, 2, 1],
        "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 1, 1, 1],
        "window_size_per_stage": [8, 4, 4, 4],
        "global_attention_blocks": [3],
        "window_positional_embedding_background_size": [4, 4],
    }
    vision = {
        "backbone_config": hiera,
        "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        "fpn_hidden_size": 32,
    }
    config = transformers.Sam2Config(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 32, "image_size": 64, "mask_input_channels": 8},
        mask_decoder_config=_MASK_DECODER,
    )
    network = transformers.Sam2Model(config).eval()
    network.save_pretrained(folder)
    _scaled_to(transformers, folder, 64)
    return network


_MASK_DECODER = {
    "hidden_size": 32,
    "mlp_dim": 16,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "iou_head_hidden_dim": 16,
}
_SAM3_VISION = {
    "backbone_config": {
        "model_type": "sam3_vit_model",
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": 56,
        "patch_size": 14,
        "pretrain_image_size": 56,
        "window_size": 2,
        "global_attn_indexes": [1],
    },
    "fpn_hidden_size": 32,
    "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
}


def sam3_tracker(transformers: Any, folder: Path) -> Any:
    """Write the part of a SAM 3 that takes boxes, of eighty thousand weights, and return it."""
    config = transformers.Sam3TrackerConfig(
        vision_config={"model_type": "sam3_vision_model", **_SAM3_VISION},
        prompt_encoder_config={"hidden_size": 32, "image_size": 56, "patch_size": 14, "mask_input_channels": 8},
        mask_decoder_config=_MASK_DECODER,
    )
    network = transformers.Sam3TrackerModel(config).eval()
    network.save_pretrained(folder)
    _scaled_to(transformers, folder, 56)
    return network


def sam3(transformers: Any, folder: Path) -> Any:
    """Write a SAM 3 that looks for names, of two hundred thousand weights, and return it."""
    small = {"hidden_size": 32, "intermediate_size": 16, "num_attention_heads": 2, "num_layers": 1}
    text = {
        "model_type": "clip_text_model",
        "vocab_size": 64,
        "hidden_size": 16,
        "intermediate_size": 16,
        "projection_dim": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "max_position_embeddings": 16,
        "bos_token_id": 2,
        "eos_token_id": 3,
        "pad_token_id": 0,
    }
    config = transformers.Sam3Config(
        vision_config=_SAM3_VISION,
        text_config=text,
        geometry_encoder_config=small,
        detr_encoder_config=small,
        detr_decoder_config={**small, "num_queries": 6},
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 2},
    )
    network = transformers.Sam3Model(config).eval()
    network.save_pretrained(folder)
    _scaled_to(transformers, folder, 56)
    _tokenizer(transformers, folder)
    return network


_MEMORY = {
    "memory_attention_hidden_size": 32,
    "memory_attention_num_layers": 1,
    "memory_attention_feed_forward_hidden_size": 16,
    "memory_attention_rope_feat_sizes": [4, 4],
    "memory_encoder_hidden_size": 32,
    "memory_encoder_output_channels": 16,
    "mask_downsampler_embed_dim": 32,
    "memory_fuser_num_layers": 1,
    "memory_fuser_embed_dim": 32,
    "memory_fuser_intermediate_dim": 16,
}
_PARTS = ("vision_config", "prompt_encoder_config", "mask_decoder_config")


def sam2_video(transformers: Any, folder: Path) -> Any:
    """Write the video model that a SAM 2 is published as, and return the SAM 2 with random weights of its own."""
    network = sam2(transformers, folder)
    written = network.config.to_dict()
    config = transformers.Sam2VideoConfig(**{one: written[one] for one in _PARTS}, image_size=64, **_MEMORY)
    transformers.Sam2VideoModel(config).save_pretrained(folder)
    return network


def sam3_video(transformers: Any, folder: Path) -> None:
    """Write the video model that a SAM 3 is published as: one that looks for names, and one that takes boxes."""
    tracker = sam3_tracker(transformers, folder).config.to_dict()
    detector = sam3(transformers, folder).config.to_dict()
    parts = {one: tracker[one] for one in _PARTS}
    config = transformers.Sam3VideoConfig(
        detector_config=detector,
        tracker_config={"model_type": "sam3_tracker_video", **parts, "image_size": 56, **_MEMORY},
    )
    transformers.Sam3VideoModel(config).save_pretrained(folder)
    safetensors = __import__("safetensors.torch").torch
    file = folder / "model.safetensors"
    # The library writes one prefix twice; the published file has it once.
    once = {
        key.replace("tracker_model.tracker_model.", "tracker_model."): value
        for key, value in safetensors.load_file(file).items()
    }
    safetensors.save_file(once, file, {"format": "pt"})


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
