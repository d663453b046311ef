"""Devices for training and running networks."""

import torch


def best() -> torch.device:
    """The process' own GPU, or the CPU."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", torch.cuda.current_device())


def has_bf16(device: torch.device) -> bool:
    """Whether bf16 products are fast on the device: older GPUs lack them, and on CPUs without them they take thirty
    times as long as f32."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())
