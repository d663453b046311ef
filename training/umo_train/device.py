"""Where the networks are trained and run."""

import torch


def best() -> torch.device:
    """A process' own GPU, the CPU where there is none."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", torch.cuda.current_device())


def has_bf16(device: torch.device) -> bool:
    """Whether sums of bf16 products run there: older GPUs have no such units."""
    return device.type != "cuda" or torch.cuda.is_bf16_supported(including_emulation=False)
