"""VQ and root networks as `nn.Sequential`s numbered like EMAGE's, and their channels as a moving skeleton."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

import skeleton
from audio import nearest
from layout import PARTS, Config
from margin import Margin

JOINTS_OF = {"face": (skeleton.JAW,), "hands": skeleton.HANDS, "upper": skeleton.UPPER, "lower": skeleton.LOWER}
VELOCITY = slice(54, 57)
# Axis-angle changes sign at half a turn, and Gram-Schmidt loses digits on short or nearly parallel rows.
LARGEST_ANGLE = 3.0
SHORTEST_ROW = 0.2


def _conv(inputs: int, outputs: int) -> nn.Conv1d:
    return nn.Conv1d(inputs, outputs, 3, padding=1)


class Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.model = nn.Sequential(_conv(width, width), nn.LeakyReLU(0.2), _conv(width, width))

    def forward(self, x: Tensor) -> Tensor:
        return x + self.model(x)


def encoder(width: int, channels: int, layers: int) -> nn.Sequential:
    """Each layer is a convolution, its activation and a residual block."""
    inputs = [channels] + [width] * (layers - 1)
    return nn.Sequential(*[m for n in inputs for m in (_conv(n, width), nn.LeakyReLU(0.2), Residual(width))])


def decoder(width: int, channels: int, layers: int) -> nn.Sequential:
    """Two residual blocks, `layers` convolutions of which the last changes to the output width, and one more at that
    width.
    """
    outputs = [width] * (layers - 1) + [channels]
    widen = [m for n in outputs for m in (_conv(width, n), nn.LeakyReLU(0.2))]
    return nn.Sequential(Residual(width), Residual(width), *widen, _conv(channels, channels))


def load(module: nn.Module, prefix: str, tensors: dict[str, Tensor]) -> nn.Module:
    module.load_state_dict({k.removeprefix(prefix): t for k, t in tensors.items() if k.startswith(prefix)})
    return module


class Motion(nn.Module):
    """Four VQ decoders (and encoders, if the file has them) and the root network."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        vq = config["vq"]
        self.decoders, self.encoders, self.codebooks = nn.ModuleDict(), nn.ModuleDict(), nn.ModuleDict()
        for name in (*PARTS, "root"):
            sizes = (vq["width"], vq[name]["channels"], vq[name]["layers"])
            self.decoders[name] = load(decoder(*sizes), f"vq.{name}.decoder.main.", tensors)
            if f"vq.{name}.encoder.main.0.weight" in tensors:
                self.encoders[name] = load(encoder(*sizes), f"vq.{name}.encoder.main.", tensors)
            if name != "root":
                book = nn.Embedding(vq["codes"], vq["width"])
                self.codebooks[name] = load(book, f"vq.{name}.quantizer.embedding.", tensors)
        self.eval()

    def latents(self, part: str, channels: Tensor) -> Tensor:
        return self.encoders[part](channels.T[None])[0].T

    def encode(self, part: str, channels: Tensor, margin: Margin) -> Tensor:
        """Motion `[T, C]` to codes `[T]`."""
        book = self.codebooks[part].get_parameter("weight")
        return nearest(self.latents(part, channels), book, margin)

    def decode(self, codes: dict[str, Tensor]) -> dict[str, Tensor]:
        """Codes to the channels of each VQ decoder, without the root network."""
        return {part: self.decoders[part](self.codebooks[part](codes[part]).T[None])[0].T for part in PARTS}

    def pose(self, channels: dict[str, Tensor], margin: Margin) -> tuple[Tensor, Tensor]:
        """Axis-angle of 55 joints `[T, 55, 3]` and root translation `[T, 3]`; joints without a part stay at rest."""
        frames = len(channels["face"])
        dtype = channels["face"].dtype
        rotations = torch.zeros(frames, skeleton.JOINTS, 3, dtype=dtype)
        for part, joints in JOINTS_OF.items():
            matrices = rotation_matrices(channels[part][:, : 6 * len(joints)], margin)
            axis_angle = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec()
            margin.require(np.linalg.norm(axis_angle, axis=-1).max() < LARGEST_ANGLE)
            rotations[:, joints] = torch.from_numpy(axis_angle).reshape(frames, -1, 3).to(dtype)
        return rotations, self.translation(channels["lower"])

    def translation(self, lower: Tensor) -> Tensor:
        """Velocity integrated at 1/30 s from 0; height from the network."""
        rows = torch.from_numpy(rotation_matrices(lower[:, :54], Margin())[:, :, :2]).flatten(1).to(lower.dtype)
        inputs = torch.cat([rows, torch.zeros_like(lower[:, VELOCITY]), lower[:, VELOCITY.stop :]], 1)
        root = self.decoders["root"](self.encoders["root"](inputs.T[None]))[0].T
        moved = torch.cat([torch.zeros_like(root[:1]), root[:-1].cumsum(0) / 30.0])
        return torch.stack([moved[:, 54], root[:, 55], moved[:, 56]], 1)


def rotation_matrices(six: Tensor, margin: Margin) -> np.ndarray:
    """`[T, 6 J]` to `[T, J, 3, 3]` f64: Gram-Schmidt on two rows, by a QR decomposition with positive diagonal."""
    columns = six.double().numpy().reshape(len(six), -1, 2, 3).swapaxes(-1, -2)
    q, r = np.linalg.qr(columns)
    diagonal = np.diagonal(r, axis1=-2, axis2=-1)
    margin.require(np.abs(diagonal).min() > SHORTEST_ROW)
    first, second = np.moveaxis(q * np.sign(diagonal)[..., None, :], -1, 0)
    return np.stack([first, second, np.cross(first, second)], -2)
