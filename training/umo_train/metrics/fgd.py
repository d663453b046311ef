"""Frechet gesture distance between sets of motion, in the feature space of an auto-encoder trained by this package."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from scipy.linalg import eigh
from torch import nn

from umo_train.metrics.item import Motion
from umo_train.skeleton import JOINTS_OF

# Frames of a window and between window starts, as in BEAT's evaluation (34 of them in its windows).
WINDOW = 34
HOP = 5
BODY = ("upper", "hands", "lower")
# The package's auto-encoder, so that distances of different runs are comparable: retraining changes them by half.
# Trained on the performer's motion in the default model's training split (README).
JUDGE = Path(__file__).with_name("judge.safetensors")
WIDTH, FEATURES = 96, 48


def channels(motion: Motion, parts: Sequence[str]) -> np.ndarray:
    """The auto-encoder's input `[T, C]`: rotations, and the face's coefficients. Velocity and contacts are left out,
    since not every source of motion has them."""
    face = [motion["face"]] if "face" in parts else []
    body = [motion[part][:, : 6 * len(JOINTS_OF[part])] for part in parts if part != "face"]
    return np.concatenate([*face, *body], 1).astype(np.float32)


def windows(motions: Sequence[Motion], parts: Sequence[str] = BODY, hop: int = HOP) -> np.ndarray:
    """Overlapping windows of all motions `[N, WINDOW, C]`; shorter motions have none."""
    cut = [
        np.lib.stride_tricks.sliding_window_view(channels(motion, parts), WINDOW, axis=0)[::hop].swapaxes(1, 2)
        for motion in motions
        if len(motion["face"]) >= WINDOW
    ]
    if not cut:
        raise ValueError(f"no motion of at least {WINDOW} frames")
    return np.concatenate(cut)


class AutoEncoder(nn.Module):
    """Three convolutions of stride 2 down to one vector per window, and their mirror image."""

    def __init__(self, width: int, parts: Sequence[str]) -> None:
        super().__init__()
        self.parts = tuple(parts)
        self.register_buffer("mean", torch.zeros(width))
        self.register_buffer("scale", torch.ones(width))
        sizes = [width, WIDTH, WIDTH, WIDTH]
        lengths = [WINDOW, 17, 9, 5]
        down = [layer for i in range(3) for layer in (nn.Conv1d(sizes[i], sizes[i + 1], 3, 2, 1), nn.LeakyReLU(0.2))]
        self.encoder = nn.Sequential(*down, nn.Flatten(), nn.Linear(WIDTH * 5, FEATURES))
        up: list[nn.Module] = [nn.Linear(FEATURES, WIDTH * 5), nn.Unflatten(1, (WIDTH, 5))]
        for length in lengths[2::-1]:
            up += [
                nn.LeakyReLU(0.2),
                nn.Upsample(length),
                nn.Conv1d(WIDTH, WIDTH if length < WINDOW else width, 3, 1, 1),
            ]
        self.decoder = nn.Sequential(*up)

    def normal(self, x: torch.Tensor) -> torch.Tensor:
        """`[N, T, C]` to normalised `[N, C, T]`."""
        return ((x - self.mean) / self.scale).transpose(1, 2)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Features `[N, FEATURES]` and the reconstruction of `normal(x)`."""
        features = self.encoder(self.normal(x))
        return features, self.decoder(features)

    @torch.no_grad()
    def features(self, motions: Sequence[Motion]) -> np.ndarray:
        """Features of all windows `[N, FEATURES]`, in f64 for the covariances."""
        pieces = torch.from_numpy(windows(motions, self.parts)).split(512)
        return torch.cat([self.encoder(self.normal(piece)) for piece in pieces]).double().numpy()

    def save(self, path: Path) -> None:
        tensors = {name: tensor.contiguous() for name, tensor in self.state_dict().items()}
        save_file(tensors, path, {"format": "umo-motion-autoencoder", "parts": json.dumps(self.parts)})

    @classmethod
    def load(cls, path: Path) -> "AutoEncoder":
        with safe_open(path, "pt") as file:
            if (file.metadata() or {}).get("format") != "umo-motion-autoencoder":
                raise ValueError(f"{path}: not a motion auto-encoder")
            tensors = {name: file.get_tensor(name) for name in file.keys()}
            model = cls(len(tensors["mean"]), json.loads(file.metadata()["parts"]))
        model.load_state_dict(tensors)
        return model.eval()


def train_autoencoder(
    motions: Sequence[Motion], seed: int = 0, epochs: int = 20, parts: Sequence[str] = BODY, batch: int = 64
) -> AutoEncoder:
    """Trains on motions; deterministic for a seed on one machine. The loss is the mean squared error of the normalised
    channels, and of their frame-to-frame differences relative to the size of these differences."""
    torch.manual_seed(seed)
    data = torch.from_numpy(windows(motions, parts))
    model = AutoEncoder(data.shape[2], parts)
    flat = data.flatten(0, 1)
    model.mean.copy_(flat.mean(0))
    # Nearly constant channels must not be amplified: a hundredth of a radian is invisible.
    model.scale.copy_(flat.std(0).clamp_min(0.01))
    # Consecutive frames differ little: weight motion as much as position.
    movement = model.normal(data[:: max(len(data) // 512, 1)]).diff(dim=2).square().mean()
    optimizer = torch.optim.AdamW(model.parameters(), 1e-3, weight_decay=1e-4)
    steps = epochs * -(-len(data) // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    for _ in range(epochs):
        for rows in torch.randperm(len(data)).split(batch):
            target = model.normal(data[rows])
            _, made = model(data[rows])
            loss = (made - target).square().mean() + (made.diff(dim=2) - target.diff(dim=2)).square().mean() / movement
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            schedule.step()
    return model.eval()


def frechet(a: np.ndarray, b: np.ndarray) -> float:
    """Squared Frechet distance of the normal distributions fitted to rows `[N, F]` and `[M, F]`.

    The trace of `sqrt(A B)` is the sum of the square roots of the eigenvalues of `sqrt(A) B sqrt(A)`, which is
    symmetric: unlike a general matrix square root this stays real with fewer rows than features, when the covariances
    are singular.
    """
    if min(len(a), len(b)) < 2:
        raise ValueError("a covariance needs two rows at least")
    mean = a.mean(0) - b.mean(0)
    cov_a, cov_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    values, vectors = eigh(np.atleast_2d(cov_a))
    root = (vectors * np.sqrt(values.clip(0))) @ vectors.T
    cross = eigh(root @ np.atleast_2d(cov_b) @ root, eigvals_only=True)
    distance = mean @ mean + np.trace(np.atleast_2d(cov_a)) + np.trace(np.atleast_2d(cov_b))
    return float(max(distance - 2 * np.sqrt(cross.clip(0)).sum(), 0.0))


def fgd(model: AutoEncoder, motions: Sequence[Motion], reference: Sequence[Motion]) -> float:
    """Distance of motions from a reference; smaller is closer."""
    return frechet(model.features(motions), model.features(reference))


def shuffled(motion: Motion, rng: np.random.Generator, chunk: int = 30) -> dict[str, np.ndarray]:
    """The motion with its chunks (a second, the model's chunk) in another order: correct poses, wrong sequence."""
    count = len(motion["face"])
    pieces = np.array_split(np.arange(count), max(count // chunk, 1))
    order = np.concatenate([pieces[i] for i in rng.permutation(len(pieces))])
    return {part: values[order] for part, values in motion.items()}
