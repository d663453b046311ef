"""Random weights that keep activations near 1 in every layer, so that relative errors are meaningful."""

import math
import zlib

import torch
from torch import Tensor

from layout import CODES, PARTS, Config, Shapes, bands_width, is_frames, moving

# Factors on the usual 1/sqrt(fan in). Routers are sharp so that choices are clear; query weights of T5, which does not
# scale attention, are divided by sqrt(d_kv) below.
GAINS = {
    ".router.weight": 3.0,
    ".SelfAttention.q.weight": 1.5,
    ".EncDecAttention.q.weight": 1.5,
    "attention.q.weight": 1.5,
    ".wi_0.weight": 1.3,
    ".wo.weight": 1.6,
    ".conv.weight": 1.6,
    ".in_proj_weight": 1.4,
    "lm_head.weight": 1.5,
}
PART_JOINTS = {"face": 1, "hands": 30, "upper": 13, "lower": 9}
EMBEDDINGS = {
    "lm.shared.weight": 1.0,
    "relative_attention_bias.weight": 1.0,
    "interp.embed": 0.5,
    "interp.mask": 0.5,
    "lm.frames.embed": 0.4,
    "lm.frames.type": 1.0,
    "depth.embed": 0.7,
    "depth.position": 0.7,
    "depth.before": 0.7,
    "interp.frame_type": 0.6,
    "interp.position": 0.8,
    "quantizer.embedding": 1.0,
}


def seeded(*key: object) -> torch.Generator:
    """A generator that depends only on its key, so that draws are independent of each other."""
    return torch.Generator().manual_seed(zlib.crc32("/".join(map(str, key)).encode()))


def draw(config: Config, shapes: Shapes, seed: int) -> dict[str, Tensor]:
    """All float tensors except those that depend on data (centroids, mel normalisation), which start at zero."""
    tensors = {name: _draw(config, name, shape, seed) for name, shape in shapes.items()}
    rate = config["audio"]["sample_rate"]
    if config["audio"]["kind"] == "mel":
        width = bands_width(config)
        tensors |= mel_constants("audio.mel", config["audio"]["mel"], rate)
        tensors |= {"audio.mel.mean": torch.zeros(width), "audio.mel.scale": torch.ones(width)}
    if "mouth" in config:
        tensors |= mel_constants("mouth", config["mouth"], rate)
        _centre_on_speech(tensors)
    if is_frames(config):
        _centre_parts_on_rest(config, tensors)
    for part in ("root",) if is_frames(config) else (*PARTS, "root"):
        _centre_on_rest(config, part, tensors)
    return tensors


def _draw(config: Config, name: str, shape: tuple[int, ...], seed: int) -> Tensor:
    noise = torch.randn(shape, generator=seeded(seed, name))
    for key, scale in EMBEDDINGS.items():
        if key in name:
            return noise * scale
    if name.endswith("bias"):
        return noise * 0.2
    if len(shape) == 1:
        return 1.0 + noise * 0.2
    gain = next((gain for suffix, gain in GAINS.items() if name.endswith(suffix)), 1.0)
    if name.startswith("interp.head."):
        gain = 2.0
    if name.startswith("depth.head."):
        gain = 1.5
    if name.endswith("Attention.q.weight"):
        gain /= math.sqrt(config["lm"]["d_kv"])
    return noise * gain / math.sqrt(math.prod(shape[1:]))


def _centre_parts_on_rest(config: Config, tensors: dict[str, Tensor]) -> None:
    """As `_centre_on_rest`, for the parts of layout `frames`, whose channels start with their joints' rotations."""
    for part in moving(config):
        last = f"vq.{part['name']}.decoder.main.{2 + 2 * part['layers']}"
        # A vector is the sum of one per level, each as large as the single one of layout `parts`.
        tensors[f"{last}.weight"] *= 0.12
        single = {*config["face"]["names"], "root_velocity", "contacts"}
        joints = sum(name not in single for name in part["channels"])
        assert not any(name in single for name in part["channels"][:joints]), "joints come first"
        tensors[f"{last}.bias"][: 6 * joints] += torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).repeat(joints)


def _centre_on_rest(config: Config, part: str, tensors: dict[str, Tensor]) -> None:
    """Makes a decoder's last layer vary around the rest pose: rotations far from half a turn, a standing height."""
    vq = config["vq"][part]
    last = f"vq.{part}.decoder.main.{2 + 2 * vq['layers']}"
    tensors[f"{last}.weight"] *= 0.25
    joints = PART_JOINTS["lower" if part == "root" else part]
    bias = tensors[f"{last}.bias"]
    bias[: 6 * joints] += torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).repeat(joints)
    if part == "root":
        bias[55] += 0.9


def _centre_on_speech(tensors: dict[str, Tensor]) -> None:
    """Rows of magnitude 1, channels around the middle of their range, a voice that comes and goes."""
    width = len(tensors["mouth.mean"])
    tensors["mouth.mean"], tensors["mouth.scale"] = torch.full((width,), -4.0), torch.full((width,), 0.3)
    tensors["mouth.rest"] = tensors["mouth.rest"].sub(1.0).abs()
    tensors["mouth.head.weight"][:-1] *= 0.3
    tensors["mouth.head.bias"][:-1] += 0.4
    tensors["mouth.head.weight"][-1] *= 3.0


def mel_constants(name: str, mel: Config, sample_rate: int) -> dict[str, Tensor]:
    """A Hann window, and triangles with equal mel spacing from 50 Hz to 7,600 Hz."""
    low, high = (2595.0 * math.log10(1.0 + hz / 700.0) for hz in (50.0, 7600.0))
    edges = 700.0 * (10.0 ** (torch.linspace(low, high, mel["bands"] + 2, dtype=torch.float64) / 2595.0) - 1.0)
    bins = torch.arange(mel["fft"] // 2 + 1, dtype=torch.float64) * sample_rate / mel["fft"]
    rising = (bins[None] - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - bins[None]) / (edges[2:] - edges[1:-1])[:, None]
    return {
        f"{name}.window.weight": torch.hann_window(mel["window"]),
        f"{name}.filters.weight": torch.minimum(rising, falling).clamp(min=0.0).float(),
    }


def upcycle(tensors: dict[str, Tensor]) -> None:
    """Copies the first expert of each layer to all others."""
    for name in tensors:
        if ".moe.experts." in name:
            head, tail = name.split(".moe.experts.")
            tensors[name] = tensors[f"{head}.moe.experts.0.{tail.split('.', 1)[1]}"].clone()


def pick_rows(rows: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """`count` rows of real data, each slightly perturbed: centroids with real data between them."""
    assert len(rows) >= count, f"{len(rows)} rows for {count} centroids"
    chosen = rows[torch.randperm(len(rows), generator=generator)[:count]]
    return chosen + 0.2 * rows.std() * torch.randn(chosen.shape, generator=generator)


def audio(samples: int, generator: torch.Generator) -> Tensor:
    """Sliding harmonics that swell and fade over noise, a small offset, and (if long) a stretch of exact zeros."""
    seconds = torch.arange(samples, dtype=torch.float64) / 16000.0
    picks = torch.rand(8, generator=generator, dtype=torch.float64)
    pitch = 90.0 + 200.0 * picks[0]
    phase = 2.0 * math.pi * (pitch * seconds + 25.0 * torch.sin(2.0 * math.pi * (0.5 + picks[1]) * seconds))
    voice = sum(torch.sin(h * phase + 6.0 * picks[h]) / h for h in range(1, 8))
    swell = 0.5 + 0.5 * torch.sin(2.0 * math.pi * ((2.0 + 3.0 * picks[2]) * seconds + picks[3]))
    noise = torch.randn(samples, generator=generator, dtype=torch.float64)
    wave = 0.2 * swell * voice + (0.005 + 0.05 * (1.0 - swell)) * noise + 0.02
    if samples > 12000:
        wave[4000:5500] = 0.0
    return wave.float()


def motion(frames: int, channels: int, joints: int, generator: torch.Generator) -> Tensor:
    """Smooth channels around the rest pose, `[frames, channels]`."""
    noise = torch.randn((channels, 1, frames + 6), generator=generator)
    smooth = torch.nn.functional.conv1d(noise, torch.full((1, 1, 7), 0.25))[:, 0].T.contiguous()
    rest = torch.zeros(channels)
    rest[: 6 * joints] = torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).repeat(joints)
    return rest + 0.5 * smooth


def body(config: Config, frames: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Smooth channels of the four body parts."""
    names = len(config["face"]["names"])
    widths = {"face": 6 + names, "hands": 180, "upper": 78, "lower": 61}
    return {part: motion(frames, widths[part], joints, generator) for part, joints in PART_JOINTS.items()}


def codes(count: int, generator: torch.Generator) -> Tensor:
    """Codes of one part, I64."""
    return torch.randint(0, CODES, (count,), generator=generator)
