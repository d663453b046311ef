"""The two audio tokenizers: Hugging Face's HuBERT, a log-mel front end on torch's FFT, and nearest centroids."""

import math

import torch
from torch import Tensor, nn
from transformers import HubertConfig, HubertModel, Wav2Vec2FeatureExtractor

from layout import Config
from margin import Margin

# Layers after the stored ones, with random weights: `hidden_states[L]` must not depend on them.
UNSTORED_LAYERS = 2


class Hubert(nn.Module):
    """`HubertModel` with the output of layer L as the feature."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        sizes = dict(config["audio"]["hubert"])
        self.layers: int = sizes.pop("num_hidden_layers")
        self.extractor = Wav2Vec2FeatureExtractor(do_normalize=sizes.pop("do_normalize"))
        self.model = HubertModel(
            HubertConfig(
                **sizes,
                num_hidden_layers=self.layers + UNSTORED_LAYERS,
                feat_extract_norm="group",
                do_stable_layer_norm=False,
                conv_bias=False,
                apply_spec_augment=False,
                mask_time_prob=0.0,
                attn_implementation="eager",
            )
        ).eval()
        state = {name.removeprefix("audio.hubert."): t for name, t in tensors.items() if "hubert" in name}
        # Hugging Face stores direction and length separately; a folded weight is a direction with its own length.
        folded = state.pop("encoder.pos_conv_embed.conv.weight")
        weight_norm = "encoder.pos_conv_embed.conv.parametrizations.weight"
        state[f"{weight_norm}.original0"] = folded.norm(dim=(0, 1), keepdim=True)
        state[f"{weight_norm}.original1"] = folded
        missing, unexpected = self.model.load_state_dict(state, strict=False)
        unstored = tuple(f"encoder.layers.{self.layers + i}." for i in range(UNSTORED_LAYERS))
        assert not unexpected and all(name.startswith(unstored) for name in missing), (missing, unexpected)

    def forward(self, audio: Tensor) -> Tensor:
        samples = self.extractor(audio.numpy(), sampling_rate=16000, return_tensors="pt").input_values
        dtype = next(self.model.parameters()).dtype
        output = self.model(samples.to(dtype), output_hidden_states=True)
        # One state before the first layer and one after each: state L is the output of layer L.
        assert len(output.hidden_states) == self.layers + UNSTORED_LAYERS + 1
        assert torch.equal(output.hidden_states[-1], output.last_hidden_state)
        return output.hidden_states[self.layers][0]


class Mel(nn.Module):
    """Log-mel bands with causal deltas, normalised; then convolutions over the last of them, if configured."""

    window: Tensor
    filters: Tensor
    mean: Tensor
    scale: Tensor

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.sizes: Config = config["audio"]["mel"]
        self.hop: int = config["audio"]["sample_rate"] // config["audio"]["token_rate"]
        for name in ("window.weight", "filters.weight", "mean", "scale"):
            self.register_buffer(name.split(".")[0], tensors[f"audio.mel.{name}"])
        self.network = nn.ModuleList()
        taps = self.sizes.get("network", {"taps": 1})["taps"]
        for i in range(len(self.sizes.get("network", {"widths": []})["widths"])):
            name = f"audio.mel.network.{i}"
            weight = tensors[f"{name}.weight"].unflatten(1, (taps, -1)).transpose(1, 2)
            layer = nn.Conv1d(*weight.shape[1::-1], taps)
            layer.load_state_dict({"weight": weight, "bias": tensors[f"{name}.bias"]})
            self.network.append(layer)
            taps = 1
        self.blocks = nn.ModuleList()
        for i in range(self.sizes.get("network", {}).get("blocks", {"count": 0})["count"]):
            pair = []
            for j in range(2):
                weight, bias = (tensors[f"audio.mel.network.blocks.{i}.{j}.{kind}"] for kind in ("weight", "bias"))
                conv = nn.Conv1d(*weight.shape[1::-1], weight.shape[2])
                conv.load_state_dict({"weight": weight, "bias": bias})
                pair.append(conv)
            self.blocks.append(nn.ModuleList(pair))

    @torch.no_grad()
    def forward(self, audio: Tensor) -> Tensor:
        rows = self.bands(audio)
        if not self.network:
            return rows
        silence = torch.zeros_like(rows[:1])
        silence[:, : self.sizes["bands"]] = math.log(self.sizes["floor"])
        # Long enough that every layer sees only silence before the first row.
        before = ((silence - self.mean) * self.scale).repeat(100, 1)
        x = torch.cat([before, rows]).T[None]
        for i, layer in enumerate(self.network):
            x = layer(x if i == 0 else x.relu())
            if i == 0 and self.blocks:
                x = x.relu()
                for causal, pointwise in self.blocks:
                    x = x + pointwise(causal(nn.functional.pad(x, (causal.kernel_size[0] - 1, 0))).relu())
        return x[0].T[-len(rows) :]

    def bands(self, audio: Tensor) -> Tensor:
        """Normalised log-mel features."""
        frames = audio.to(self.window.dtype).unfold(0, self.sizes["window"], self.hop) * self.window
        power = torch.fft.rfft(frames, n=self.sizes["fft"]).abs() ** 2
        bands = power @ self.filters.T
        features = [torch.log(bands.clamp(min=self.sizes["floor"]))]
        silence = torch.log(torch.full_like(features[0][:2], self.sizes["floor"])[:1]).repeat(2, 1)
        for _ in range(self.sizes["deltas"]):
            extended = torch.cat([silence, features[-1]])
            features.append((extended[2:] - extended[:-2]) / 2.0)
            silence = torch.zeros_like(silence)
        return (torch.cat(features, -1) - self.mean) * self.scale


def front_end(config: Config, tensors: dict[str, Tensor]) -> Hubert | Mel:
    return Hubert(config, tensors) if config["audio"]["kind"] == "hubert" else Mel(config, tensors)


def nearest(rows: Tensor, table: Tensor, margin: Margin) -> Tensor:
    """Index of each row's nearest table row."""
    squared = torch.cdist(rows, table, compute_mode="donot_use_mm_for_euclid_dist") ** 2
    margin.nearest(squared)
    return squared.argmin(-1)
