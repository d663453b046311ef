"""Mixtures of experts: upcycling changes nothing, and the balancing loss is the paper's."""

import pytest
import torch

from layout import vocabulary
from umo_train.lm import moe
from umo_train.lm.model import LanguageModel

LM = {
    "d_model": 16,
    "d_kv": 4,
    "d_ff": 20,
    "num_heads": 2,
    "num_layers": 2,
    "num_decoder_layers": 2,
    "relative_attention_num_buckets": 8,
    "relative_attention_max_distance": 16,
    "layer_norm_epsilon": 1e-6,
    "feed_forward_proj": "gated-gelu",
    "tie_word_embeddings": False,
    "experts": 4,
}


@torch.no_grad()
@pytest.mark.parametrize("top_k", [1, 3])
def test_upcycling_leaves_the_output_unchanged(top_k: int) -> None:
    config = {"lm": LM | {"top_k": top_k}, "vocab": vocabulary(10, 5)}
    torch.manual_seed(0)
    dense, sparse = LanguageModel(config, dense=True), LanguageModel(config)
    ids, said = torch.randint(0, 200, (2, 30)), torch.randint(0, 200, (2, 11))
    before = dense(ids, said)
    assert not torch.allclose(sparse(ids, said), before)
    sparse.load_state_dict(moe.upcycled(dense.state_dict(), 4, seed=3))
    torch.testing.assert_close(sparse(ids, said), before, rtol=1e-5, atol=1e-5)
    # Even though different experts were used.
    assert all((layer.first_choices > 0).sum() > 1 for layer in moe.layers(sparse))


def test_upcycled_experts_are_copies_of_their_own() -> None:
    state = {"encoder.block.0.layer.1.DenseReluDense.wi_0.weight": torch.ones(3, 2)}
    out = moe.upcycled(state, 2, seed=0)
    first, second = (out[f"encoder.block.0.layer.1.moe.experts.{e}.wi_0.weight"] for e in range(2))
    first.zero_()
    assert second.eq(1).all() and state.popitem()[1].eq(1).all()
    router = out["encoder.block.0.layer.1.moe.router.weight"]
    assert router.shape == (2, 2)
    assert not router.equal(moe.upcycled(state, 2, seed=1).get("encoder.block.0.layer.1.moe.router.weight", router * 0))


def _layer(scores: list[list[float]], top_k: int) -> moe.MixtureOfExperts:
    """A layer whose router gives row i (a unit vector) the probabilities `scores[i]`, after one pass over the rows."""
    rows = len(scores)
    layer = moe.MixtureOfExperts(rows, 3, len(scores[0]), top_k)
    with torch.no_grad():
        layer.router.weight.copy_(torch.tensor(scores).log().T)
    layer(torch.eye(rows)[None])
    return layer


def test_balance_by_hand() -> None:
    # Experts get 2/3 and 1/3 of three rows; mean probabilities are 0.6 and 0.4: 2 (2/3 0.6 + 1/3 0.4).
    layer = _layer([[0.9, 0.1], [0.7, 0.3], [0.2, 0.8]], top_k=1)
    assert layer.balance.item() == pytest.approx(2 * (2 / 3 * 0.6 + 1 / 3 * 0.4), rel=1e-5)
    assert layer.first_choices.tolist() == [2, 1]


def test_balance_of_two_chosen_by_hand() -> None:
    # Gates are the chosen probabilities divided by their sum: 0.6 : 0.3 and 0.5 : 0.25.
    layer = _layer([[0.6, 0.3, 0.1], [0.25, 0.25 - 1e-4, 0.5 + 1e-4]], top_k=2)
    gates = [(2 / 3 + 1 / 3) / 2, (1 / 3) / 2, (2 / 3) / 2]
    means = [0.425, 0.275, 0.3]
    expected = 3 * sum(g * p for g, p in zip(gates, means, strict=True))
    assert layer.balance.item() == pytest.approx(expected, rel=1e-3)


def test_balance_is_least_when_even_and_pulls_towards_it() -> None:
    even = _layer([[0.9, 0.1], [0.1, 0.9]], top_k=1)
    assert even.balance.item() == pytest.approx(1.0, rel=1e-5)
    uneven = _layer([[0.9, 0.1], [0.8, 0.2]], top_k=1)
    assert uneven.balance.item() > 1.5
    uneven.balance.backward()
    # A step against the gradient lowers the favourite's scores.
    assert (uneven.router.weight.grad[0] > 0).all() and (uneven.router.weight.grad[1] < 0).all()


def test_balance_of_a_model_is_its_layers_mean() -> None:
    config = {"lm": LM | {"top_k": 1}, "vocab": vocabulary(10, 5)}
    torch.manual_seed(1)
    model = LanguageModel(config)
    model(torch.randint(0, 200, (2, 30)), torch.randint(0, 200, (2, 11)))
    terms = [layer.balance.item() for layer in moe.layers(model)]
    assert len(terms) == 4 and moe.balance(model).item() == pytest.approx(sum(terms) / 4)
    assert moe.balance(LanguageModel(config, dense=True)).item() == 0


@pytest.mark.parametrize("top_k", [1, 2])
def test_all_experts_for_every_row_say_the_same(top_k: int) -> None:
    """GPU and CPU algorithms agree, including gradients."""
    torch.manual_seed(1)
    layer = moe.MixtureOfExperts(12, 20, 4, top_k)
    rows = torch.randn(30, 12, requires_grad=True)
    chosen, index = torch.softmax(layer.router(rows), -1).topk(top_k, -1)
    apart, together = layer(rows), layer.by_all(rows, chosen / chosen.sum(-1, keepdim=True), index)
    torch.testing.assert_close(together, apart, rtol=1e-5, atol=1e-6)
    weights = [rows, *(p for expert in layer.experts for p in expert.parameters())]
    wanted = torch.randn(30, 12)
    of_apart = torch.autograd.grad((apart * wanted).sum(), weights, retain_graph=True)
    of_together = torch.autograd.grad((together * wanted).sum(), weights)
    for a, b in zip(of_apart, of_together, strict=True):
        torch.testing.assert_close(b, a, rtol=1e-4, atol=1e-5)
