"""Where the networks are trained and run."""

import torch


def best() -> torch.device:
    """A process' own GPU, the CPU where there is none."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", torch.cuda.current_device())


def has_bf16(device: torch.device) -> bool:
    """Whether products of bf16 are quick there: older GPUs have no such units, and CPUs without them take thirty times
    as long as for f32."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())
