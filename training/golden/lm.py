"""Hugging Face's T5 with its feed-forwards replaced by a mixture of Hugging Face's own feed-forwards."""

import torch
from torch import Tensor, nn
from transformers import T5Config, T5ForConditionalGeneration
from transformers.models.t5.modeling_t5 import T5DenseGatedActDense

from layout import PARTS, Config
from margin import Margin


class MixtureOfExperts(nn.Module):
    """Softmax router, top-k experts, with their probabilities normalised over the chosen."""

    def __init__(self, config: T5Config, experts: int, top_k: int) -> None:
        super().__init__()
        self.router = nn.Linear(config.d_model, experts, bias=False)
        self.experts = nn.ModuleList([T5DenseGatedActDense(config) for _ in range(experts)])
        self.top_k = top_k
        self.margin = Margin()
        self.chosen: set[int] = set()

    def forward(self, hidden: Tensor) -> Tensor:
        logits = self.router(hidden)
        self.margin.largest(logits, self.top_k)
        weights, index = torch.softmax(logits, -1).topk(self.top_k, -1)
        weights = weights / weights.sum(-1, keepdim=True)
        self.chosen |= set(index.flatten().tolist())
        outputs = torch.stack([expert(hidden) for expert in self.experts], -2)
        picked = outputs.gather(-2, index[..., None].expand(*index.shape, hidden.shape[-1]))
        return (weights[..., None] * picked).sum(-2)


class LanguageModel(nn.Module):
    """Encoder, decoder and the forced structure. `dense` uses Hugging Face's model unchanged."""

    def __init__(self, config: Config, tensors: dict[str, Tensor], *, dense: bool) -> None:
        super().__init__()
        sizes, self.vocab = config["lm"], config["vocab"]
        own = ("experts", "top_k")
        t5 = T5Config(
            **{name: value for name, value in sizes.items() if name not in own},
            vocab_size=self.vocab["size"],
            pad_token_id=self.vocab["pad"],
            eos_token_id=self.vocab["eos"],
            decoder_start_token_id=self.vocab["decoder_start"],
            dropout_rate=0.0,
            attn_implementation="eager",
        )
        self.model = T5ForConditionalGeneration(t5).eval()
        assert t5.scale_decoder_outputs == sizes["tie_word_embeddings"]
        if not sizes["tie_word_embeddings"]:
            # transformers 5 ties the head to the embedding regardless of the config; Flan-T5 has a separate one.
            self.model.lm_head = nn.Linear(t5.d_model, t5.vocab_size, bias=False)
        if not dense:
            for stack in (self.model.encoder, self.model.decoder):
                for block in stack.block:
                    block.layer[-1].DenseReluDense = MixtureOfExperts(t5, sizes["experts"], sizes["top_k"])
        self.model.load_state_dict(_state(tensors, dense=dense, tied=sizes["tie_word_embeddings"]))
        self.model.eval()

    def begin(self) -> Margin:
        """Starts one margin that every router of the model reports to."""
        margin = Margin()
        for module in self.modules():
            if isinstance(module, MixtureOfExperts):
                module.margin = margin
        return margin

    def experts_used(self) -> list[int]:
        """Number of different experts chosen so far by each feed-forward layer."""
        return [len(module.chosen) for module in self.modules() if isinstance(module, MixtureOfExperts)]

    def encode(self, input_ids: Tensor) -> Tensor:
        return self.model.encoder(input_ids=input_ids[None]).last_hidden_state[0]

    def decode(self, input_ids: Tensor, decoder_input_ids: Tensor) -> Tensor:
        output = self.model(input_ids=input_ids[None], decoder_input_ids=decoder_input_ids[None], use_cache=False)
        return output.logits[0]

    def structure(self, target: int) -> list[range]:
        """Allowed ids at each position after the decoder's start."""
        positions = []
        for part in PARTS:
            ids = self.vocab[part]
            free = range(ids["first"], ids["first"] + ids["codes"])
            positions += [range(ids["start"], ids["start"] + 1), *[free] * target, range(ids["end"], ids["end"] + 1)]
        return positions

    def generate(self, input_ids: Tensor, target: int, margin: Margin) -> dict[str, Tensor]:
        """Greedy codes, each position by a forward pass over everything before it."""
        ids = [self.vocab["decoder_start"]]
        for allowed in self.structure(target):
            if len(allowed) == 1:
                ids.append(allowed.start)
                continue
            logits = self.decode(input_ids, torch.tensor(ids))[-1, allowed.start : allowed.stop]
            margin.largest(logits)
            ids.append(allowed.start + int(logits.argmax()))
        self._agrees_with_hugging_face(input_ids, ids, target)
        codes = {}
        for i, part in enumerate(PARTS):
            at = 2 + i * (target + 2)
            codes[part] = torch.tensor(ids[at : at + target]) - self.vocab[part]["first"]
        return codes

    def _agrees_with_hugging_face(self, input_ids: Tensor, ids: list[int], target: int) -> None:
        """`generate` of transformers, with its cache and the same constraint, must choose the same ids."""
        positions = self.structure(target)
        t5 = self.model.config
        output = self.model.generate(
            input_ids=input_ids[None],
            attention_mask=torch.ones_like(input_ids)[None],
            do_sample=False,
            num_beams=1,
            # transformers 5.23 sizes the cache by the encoder's layers, too few for a deeper decoder.
            use_cache=t5.num_decoder_layers <= t5.num_layers,
            max_new_tokens=len(positions),
            prefix_allowed_tokens_fn=lambda _, so_far: list(positions[len(so_far) - 1]),
        )
        assert output[0].tolist() == ids, "transformers' generate chose other ids"


def _state(tensors: dict[str, Tensor], *, dense: bool, tied: bool) -> dict[str, Tensor]:
    """Renames our tensors to Hugging Face's; a dense model takes the first expert and no router."""
    state = {}
    for name, tensor in tensors.items():
        if not name.startswith("lm."):
            continue
        name = name.removeprefix("lm.")
        if dense and ".moe." in name:
            if ".experts.0." not in name:
                continue
            name = name.replace(".experts.0.", ".")
        state[name.replace(".moe.", ".DenseReluDense.")] = tensor
    state["encoder.embed_tokens.weight"] = state["decoder.embed_tokens.weight"] = state["shared.weight"]
    if tied:
        state["lm_head.weight"] = state["shared.weight"]
    return state
