"""The small models: sizes without common divisors, which together cover every branch of the format."""

from dataclasses import dataclass

import skeleton
from layout import ARKIT, PARTS, Config, face, motion, vocabulary


@dataclass(frozen=True)
class Model:
    """A config and how its file is made."""

    name: str
    storage: str
    config: Config
    encoders: bool = False
    tokenizer: bool = False
    upcycled: bool = False


def _hubert(units: int, **sizes: object) -> Config:
    hubert = {"conv_kernel": [10, 3, 3, 3, 3, 2, 2], "conv_stride": [5, 2, 2, 2, 2, 2, 2], "layer_norm_eps": 1e-5}
    return {"kind": "hubert", "sample_rate": 16000, "token_rate": 50, "units": units, "hubert": hubert | sizes}


def _mel(units: int, bands: int, deltas: int, network: Config | None = None) -> Config:
    mel = {"window": 400, "fft": 512, "bands": bands, "floor": 1e-5, "deltas": deltas}
    if network:
        mel["network"] = network
    return {"kind": "mel", "sample_rate": 16000, "token_rate": 50, "units": units, "mel": mel}


def _lm(buckets: int, distance: int, *, tied: bool = False, **sizes: int) -> Config:
    return sizes | {
        "relative_attention_num_buckets": buckets,
        "relative_attention_max_distance": distance,
        "layer_norm_epsilon": 1e-6,
        "feed_forward_proj": "gated-gelu",
        "tie_word_embeddings": tied,
    }


def _config(
    name: str,
    *,
    text: int,
    window: tuple[int, int, int],
    audio: Config,
    lm: Config,
    interp: Config,
    expressions: int | None,
    width: int,
    layers: tuple[int, int, int, int, int],
    templates: Config,
    rest: tuple[int, int, int, int],
    mouth: Config | None = None,
) -> Config:
    prefix, target, lookahead = window
    return {
        "name": name,
        "license": "MIT OR Apache-2.0",
        "frame_rate": 30,
        "keyframe_stride": 6,
        "prefix": prefix,
        "target": target,
        "max_target": prefix,
        "lookahead": lookahead,
        "audio": audio,
        "vocab": vocabulary(text, audio["units"]),
        "lm": lm,
        "interp": interp,
        "vq": motion(width, 52 if expressions is None else expressions, layers),
        "face": face(expressions),
        "templates": templates,
        "rest": dict(zip(PARTS, rest, strict=True)),
        "sampling": {"temperature": 1.0, "top_k": 50, "top_p": 1.0},
        "skeleton": {"parents": skeleton.PARENTS, "offsets_m": skeleton.OFFSETS_M},
        **({"mouth": mouth} if mouth else {}),
    }


HUBERT_K1_SMPLX = Model(
    "hubert_k1_smplx",
    "mixed",
    _config(
        "golden hubert_k1_smplx",
        text=101,
        window=(6, 3, 9),
        audio=_hubert(
            37,
            conv_dim=[11] * 7,
            hidden_size=20,
            intermediate_size=34,
            num_attention_heads=4,
            num_hidden_layers=3,
            num_conv_pos_embeddings=16,
            num_conv_pos_embedding_groups=4,
            do_normalize=True,
        ),
        lm=_lm(8, 20, d_model=26, d_kv=7, d_ff=39, num_heads=3, num_layers=3, num_decoder_layers=2, experts=3, top_k=1),
        interp={"d_model": 24, "num_heads": 3, "d_ff": 44, "temporal_layers": 2, "part_layers": 1, "max_frames": 77},
        expressions=10,
        width=18,
        layers=(2, 2, 2, 4, 4),
        templates={"audio_to_motion": [8, 77, "audio", 31, *PARTS, 1]},
        rest=(3, 250, 17, 99),
    ),
)

MEL_K2_ARKIT = Model(
    "mel_k2_arkit",
    "BF16",
    _config(
        "golden mel_k2_arkit",
        text=403,
        window=(7, 2, 5),
        audio=_mel(23, 13, 2, {"taps": 4, "widths": [17, 9]}),
        lm=_lm(
            10,
            33,
            tied=True,
            d_model=30,
            d_kv=9,
            d_ff=41,
            num_heads=3,
            num_layers=2,
            num_decoder_layers=3,
            experts=5,
            top_k=2,
        ),
        interp={"d_model": 21, "num_heads": 3, "d_ff": 37, "temporal_layers": 1, "part_layers": 2, "max_frames": 91},
        expressions=None,
        width=13,
        layers=(3, 1, 2, 3, 2),
        templates={
            "audio_to_motion": [9, "text", 40, "audio", 12, *PARTS, 1],
            "text_to_motion": [15, 6, "text", *PARTS, 1],
        },
        rest=(0, 41, 255, 128),
        mouth={
            "window": 230,
            "fft": 256,
            "bands": 11,
            "floor": 1e-7,
            "rows": 2,
            "ahead": 3,
            "taps": 5,
            "width": 19,
            "kernel": 3,
            "dilations": [1, 3],
            "channels": ["jawOpen", "mouthClose", "tongueOut", "mouthFunnel", "jawForward"],
        },
    ),
    encoders=True,
    tokenizer=True,
)

MEL_K1_UPCYCLED = Model(
    "mel_k1_upcycled",
    "F16",
    _config(
        "golden mel_k1_upcycled",
        text=57,
        window=(5, 5, 0),
        audio=_mel(19, 11, 0),
        lm=_lm(6, 13, d_model=22, d_kv=5, d_ff=35, num_heads=5, num_layers=2, num_decoder_layers=2, experts=4, top_k=1),
        interp={"d_model": 14, "num_heads": 2, "d_ff": 29, "temporal_layers": 1, "part_layers": 1, "max_frames": 60},
        expressions=3,
        width=10,
        layers=(1, 1, 1, 2, 1),
        templates={"audio_to_motion": ["audio", *PARTS, 1]},
        rest=(7, 7, 7, 7),
    ),
    upcycled=True,
)

HUBERT_K3_I8 = Model(
    "hubert_k3_i8",
    "I8",
    _config(
        "golden hubert_k3_i8",
        text=73,
        window=(4, 1, 9),
        audio=_hubert(
            29,
            conv_dim=[9, 13, 10, 7, 11, 9, 14],
            hidden_size=21,
            intermediate_size=31,
            num_attention_heads=3,
            num_hidden_layers=2,
            num_conv_pos_embeddings=15,
            num_conv_pos_embedding_groups=7,
            do_normalize=False,
        ),
        lm=_lm(
            12, 50, d_model=23, d_kv=11, d_ff=37, num_heads=2, num_layers=2, num_decoder_layers=2, experts=3, top_k=3
        ),
        interp={"d_model": 15, "num_heads": 5, "d_ff": 26, "temporal_layers": 1, "part_layers": 1, "max_frames": 50},
        expressions=5,
        width=11,
        layers=(2, 1, 1, 2, 2),
        templates={"audio_to_motion": [5, "audio", 6, *PARTS, 1]},
        rest=(200, 100, 50, 25),
    ),
)


def _part(name: str, channels: list[str], codes: int, levels: int, width: int, layers: int) -> Config:
    part: Config = {"name": name, "channels": channels, "codes": codes, "levels": levels}
    if channels:
        part |= {"width": width, "layers": layers}
    return part | {"rest": [(3 * level + 1) % codes for level in range(levels)]}


def _joints(of: tuple[int, ...], wanted: str = "") -> list[str]:
    return [skeleton.NAMES[joint] for joint in of if wanted in skeleton.NAMES[joint]]


LOWER = [*_joints(skeleton.LOWER), "root_velocity", "contacts"]
ARMS = tuple(joint for joint in skeleton.UPPER if joint >= 16)
TORSO = tuple(joint for joint in skeleton.UPPER if joint < 16)


def _frames(
    name: str, *, parts: list[Config], depth: Config, ahead: int, expressions: int | None, root: Config, **rest: Config
) -> Config:
    """A config of layout `frames`."""
    config: Config = _config(
        name,
        expressions=expressions,
        width=root["width"],
        layers=(1, 1, 1, 1, root["layers"]),
        rest=(0, 0, 0, 0),
        **rest,  # type: ignore[arg-type]
    )
    for key in ("codes", *PARTS):
        del config["vq"][key]
    del config["rest"]
    config["audio"]["ahead"] = ahead
    config["vocab"] = vocabulary(rest["text"], config["audio"]["units"], ())  # type: ignore[arg-type]
    return config | {"layout": "frames", "parts": parts, "depth": depth | {"layer_norm_epsilon": 1e-6}}


FRAMES_FOUR = Model(
    "frames_four",
    "F16",
    _frames(
        "golden frames_four",
        parts=[
            _part("lower", LOWER, 17, 2, 9, 2),
            _part("hands", _joints(skeleton.HANDS), 5, 3, 11, 1),
            _part("face", ["jaw", "expression_0", "expression_1", "expression_2"], 256, 1, 6, 1),
            _part("upper", _joints(skeleton.UPPER), 9, 4, 8, 3),
        ],
        depth={
            "d_model": 14,
            "num_heads": 2,
            "d_ff": 19,
            "num_layers": 2,
            "before": True,
            "heard": 3,
            "body_heard": 17,
        },
        ahead=2,
        expressions=3,
        root={"width": 10, "layers": 1},
        text=97,
        window=(5, 3, 0),
        audio=_mel(19, 11, 0),
        lm=_lm(6, 13, d_model=22, d_kv=5, d_ff=35, num_heads=5, num_layers=2, num_decoder_layers=2, experts=4, top_k=1),
        interp={"d_model": 14, "num_heads": 2, "d_ff": 29, "temporal_layers": 1, "part_layers": 1, "max_frames": 60},
        templates={"audio_to_motion": ["audio", "history", 1]},
    ),
)

FRAMES_SEVEN = Model(
    "frames_seven",
    "BF16",
    _frames(
        "golden frames_seven",
        parts=[
            _part("intent", [], 4, 1, 0, 0),
            _part("torso", _joints(TORSO), 11, 3, 7, 2),
            _part("arms", _joints(ARMS), 13, 4, 9, 1),
            _part("mouth", ["jaw", *ARKIT[14:40], *ARKIT[45:]], 23, 2, 10, 1),
            _part("eyes", [*ARKIT[:14], *ARKIT[40:45]], 6, 1, 5, 2),
            _part("hands", _joints(skeleton.HANDS), 12, 2, 8, 1),
            _part("lower", LOWER, 15, 3, 12, 2),
        ],
        depth={"d_model": 21, "num_heads": 3, "d_ff": 26, "num_layers": 3},
        ahead=3,
        expressions=None,
        root={"width": 11, "layers": 2},
        text=403,
        window=(7, 2, 5),
        audio=_mel(23, 13, 2, {"taps": 4, "widths": [17, 9], "blocks": {"kernel": 3, "count": 2}}),
        lm=_lm(
            10,
            33,
            d_model=30,
            d_kv=9,
            d_ff=41,
            num_heads=3,
            num_layers=2,
            num_decoder_layers=3,
            experts=5,
            top_k=2,
        ),
        interp={"d_model": 21, "num_heads": 3, "d_ff": 37, "temporal_layers": 1, "part_layers": 2, "max_frames": 91},
        templates={
            "audio_to_motion": [9, "text", 40, "audio", 12, "history", 1],
            "text_to_motion": [15, 6, "text", "history", 1],
        },
    ),
    encoders=True,
    tokenizer=True,
)

# The minimum of parts and levels: all channels in one part, of one body part.
FRAMES_ONE = Model(
    "frames_one",
    "I8",
    _frames(
        "golden frames_one",
        parts=[
            _part("face", ["jaw", "expression_0", "expression_1"], 19, 1, 7, 1),
            _part("hands", _joints(skeleton.HANDS), 23, 1, 6, 1),
            _part("upper", _joints(skeleton.UPPER), 256, 1, 5, 2),
            _part("lower", LOWER, 3, 1, 8, 1),
        ],
        depth={"d_model": 12, "num_heads": 3, "d_ff": 15, "num_layers": 1},
        ahead=0,
        expressions=2,
        root={"width": 9, "layers": 1},
        text=61,
        window=(4, 1, 0),
        audio=_mel(17, 9, 1),
        lm=_lm(8, 20, d_model=18, d_kv=5, d_ff=21, num_heads=3, num_layers=1, num_decoder_layers=1, experts=3, top_k=3),
        interp={"d_model": 12, "num_heads": 2, "d_ff": 19, "temporal_layers": 1, "part_layers": 1, "max_frames": 50},
        templates={"audio_to_motion": [5, "audio", "history", 1]},
    ),
)

MODELS = (HUBERT_K1_SMPLX, MEL_K2_ARKIT, MEL_K1_UPCYCLED, HUBERT_K3_I8, FRAMES_ONE, FRAMES_FOUR, FRAMES_SEVEN)
