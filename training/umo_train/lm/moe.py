"""Sparse mixture of experts (paper 3.2): gated feed-forwards behind a router, and the statistics of its choices."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from umo_train.lm.rounded import rounded


class FeedForward(nn.Module):
    """T5's gated GELU (tanh form)."""

    def __init__(self, d_model: int, d_ff: int) -> None:
        super().__init__()
        self.wi_0 = nn.Linear(d_model, d_ff, bias=False)
        self.wi_1 = nn.Linear(d_model, d_ff, bias=False)
        self.wo = nn.Linear(d_ff, d_model, bias=False)
        for linear in (self.wi_0, self.wi_1, self.wo):
            nn.init.normal_(linear.weight, std=linear.in_features**-0.5)

    def forward(self, hidden: Tensor) -> Tensor:
        return self.wo(functional.gelu(self.wi_0(hidden), approximate="tanh") * self.wi_1(hidden))


class MixtureOfExperts(nn.Module):
    """Feed-forwards behind a bias-free softmax router; a row goes to its `top_k` most probable experts, weighted by
    their probabilities normalised over the chosen."""

    PIECE = 256

    def __init__(self, d_model: int, d_ff: int, experts: int, top_k: int) -> None:
        super().__init__()
        self.router = nn.Linear(d_model, experts, bias=False)
        nn.init.normal_(self.router.weight, std=d_model**-0.5)
        self.experts = nn.ModuleList([FeedForward(d_model, d_ff) for _ in range(experts)])
        self.top_k = top_k
        # Whether products are rounded as in int8 (`umo_train/lm/rounded.py`).
        self.rounded = False
        # From the last forward pass: the balancing loss of equation (lmoe), and how often each expert was the first
        # choice.
        self.balance: Tensor | None = None
        self.first_choices: Tensor | None = None

    def forward(self, hidden: Tensor) -> Tensor:
        rows = hidden.reshape(-1, hidden.shape[-1])
        # In f32: a router decides by small differences.
        with torch.autocast(rows.device.type, enabled=False):
            probabilities = torch.softmax(functional.linear(rows.float(), self.router.weight.float()), -1)
        chosen, index = probabilities.topk(self.top_k, -1)
        weights = chosen / chosen.sum(-1, keepdim=True)
        self._measure(probabilities, weights, index)
        if rows.is_cuda:
            return self.by_all(rows, weights, index).reshape(hidden.shape)
        flat = index.flatten()
        order = flat.argsort(stable=True)
        counts = flat.bincount(minlength=len(self.experts))
        # Each expert's rows are padded to a multiple: matmul on a CPU is set up again for every new shape.
        room = (counts + self.PIECE - 1) // self.PIECE * self.PIECE
        shift = room.cumsum(0) - room - (counts.cumsum(0) - counts)
        place = torch.arange(len(order), device=order.device) + shift[flat[order]]
        source = torch.zeros(int(room.sum()), dtype=order.dtype, device=order.device)
        source[place] = order // self.top_k
        gathered = rows[source].split(room.tolist())
        sorted_outputs = torch.cat([expert(part) for expert, part in zip(self.experts, gathered, strict=True)])
        # Back to the order of rows: each row's k outputs are adjacent.
        back = torch.empty_like(order).scatter_(0, order, place)
        outputs = sorted_outputs[back]
        if self.top_k > 1:
            outputs = outputs * weights.reshape(-1, 1).to(outputs.dtype)
            outputs = outputs.reshape(len(rows), self.top_k, -1).sum(1)
        return outputs.reshape(hidden.shape)

    def by_all(self, rows: Tensor, weights: Tensor, index: Tensor) -> Tensor:
        """Computes every expert for every row `[n, d]` and selects the chosen outputs: a GPU has spare arithmetic, and
        no shape depends on data, so it never waits."""
        share = torch.zeros(len(rows), len(self.experts), dtype=rows.dtype, device=rows.device)
        share = share.scatter(1, index, weights.to(rows.dtype))
        gate, up, out = (
            torch.stack([getattr(expert, name).weight for expert in self.experts]) for name in ("wi_0", "wi_1", "wo")
        )
        if self.rounded:
            rows, gate, up, out = (rounded(x) for x in (rows, gate, up, out))
        inner = functional.gelu(rows @ gate.flatten(0, 1).T, approximate="tanh") * (rows @ up.flatten(0, 1).T)
        inner = inner.unflatten(1, (len(self.experts), -1))
        if self.rounded:
            inner = rounded(inner)
        return (inner * share[..., None]).flatten(1) @ out.transpose(1, 2).flatten(0, 1)

    def _measure(self, probabilities: Tensor, weights: Tensor, index: Tensor) -> None:
        experts = len(self.experts)
        dispatched = torch.zeros_like(probabilities).scatter(1, index, weights.detach())
        self.balance = experts * (dispatched.mean(0) * probabilities.mean(0)).sum()
        self.first_choices = torch.bincount(index[:, 0], minlength=experts).detach()


def upcycled(state: dict[str, Tensor], experts: int, seed: int) -> dict[str, Tensor]:
    """Converts a dense T5's tensors to a sparse one's (sparse upcycling): every expert is a copy of the dense
    feed-forward, so that the output is unchanged whatever the fresh routers choose."""
    generator = torch.Generator().manual_seed(seed)
    out = {}
    for name, tensor in state.items():
        block, dense, matrix = name.partition(".DenseReluDense.")
        if not dense:
            out[name] = tensor
            continue
        for expert in range(experts):
            out[f"{block}.moe.experts.{expert}.{matrix}"] = tensor.clone()
        if matrix == "wi_0.weight":
            d_model = tensor.shape[1]
            router = torch.randn(experts, d_model, generator=generator) * d_model**-0.5
            out[f"{block}.moe.router.weight"] = router.to(tensor.dtype)
    return out


def layers(model: nn.Module) -> list[MixtureOfExperts]:
    return [module for module in model.modules() if isinstance(module, MixtureOfExperts)]


def balance(model: nn.Module) -> Tensor:
    """The mean of the balancing loss over all sparse layers of the last forward pass; 0 for a dense model."""
    terms = [layer.balance for layer in layers(model) if layer.balance is not None]
    return torch.stack(terms).mean() if terms else torch.zeros(())
