"""Training for int8: the rounded tensors, their values, and that gradients pass through."""

import torch

from frames_data import CONFIG, PARTS, codes
from umo_train.frames.model import FrameModel
from umo_train.lm import moe
from umo_train.lm.rounded import crest_factor, crest_of_gates, round_products, rounded


def test_rows_are_multiples_of_a_127th_of_their_largest() -> None:
    x = torch.randn(5, 40, generator=torch.Generator().manual_seed(0))
    x[3] = 0.0
    y = rounded(x)
    steps = y / (x.abs().amax(1, keepdim=True) / 127).clamp(min=1e-12)
    torch.testing.assert_close(steps, steps.round(), rtol=0, atol=1e-3)
    assert ((y - x).abs() <= x.abs().amax(1, keepdim=True) / 254 * 1.001).all() and y[3].eq(0).all()
    # Rounding is idempotent.
    torch.testing.assert_close(rounded(y), y)


def test_gradients_go_through_as_if_nothing_were_rounded() -> None:
    x = torch.randn(4, 6, requires_grad=True)
    weight = torch.randn(4, 6)
    (gradient,) = torch.autograd.grad((rounded(x) * weight).sum(), x)
    torch.testing.assert_close(gradient, weight)


def test_a_rounded_model_is_one_with_rounded_weights_and_inputs() -> None:
    torch.manual_seed(2)
    linear = torch.nn.Sequential(torch.nn.Linear(8, 3))
    x = torch.randn(5, 8)
    expected = torch.nn.functional.linear(rounded(x), rounded(linear[0].weight), linear[0].bias)
    assert not torch.equal(linear(x), expected)
    round_products(linear)
    torch.testing.assert_close(linear(x), expected)


def test_what_routes_and_what_is_kept_is_not_rounded() -> None:
    torch.manual_seed(3)
    config = CONFIG | {"depth": CONFIG["depth"] | {"heard": 4}}
    model = FrameModel(config, PARTS)
    round_products(model)
    named = dict(model.named_modules())
    plain = {name for name, module in named.items() if isinstance(module, torch.nn.Linear) and not _replaced(module)}
    routers = {name for name in named if name.endswith(".router")}
    heads = {f"depth.head.{part.name}" for part in PARTS}
    assert routers and plain == routers | {"depth.input", "depth.heard"}
    assert all(layer.rounded for layer in moe.layers(model))
    # Heads are products of their weights only in this network, whose inputs pass unrounded.
    assert heads <= set(named)
    history = codes(2, CONFIG["prefix"])
    ids = torch.tensor([[43, 44, *range(68, 68 + CONFIG["prefix"])]]).expand(2, -1)
    logits, _ = model(ids, history, codes(2, 3, seed=1))
    sum(x.square().mean() for x in logits.values()).backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.depth.layers.parameters())


def test_the_crest_factor_is_the_peak_over_the_root_mean_square() -> None:
    peak = torch.zeros(3, 8)
    peak[:, 2] = torch.tensor([1.0, -2.0, 0.5])
    torch.testing.assert_close(crest_factor(peak), torch.tensor(8.0).log())
    torch.testing.assert_close(crest_factor(torch.full((3, 8), -0.3)), torch.tensor(0.0))
    assert crest_factor(torch.zeros(3, 8)).isfinite()


def test_the_crest_of_gates_is_that_of_the_products_behind_them_and_lowers_it() -> None:
    torch.manual_seed(4)
    model = FrameModel(CONFIG, PARTS)
    history, said = codes(2, CONFIG["prefix"]), codes(2, 3, seed=1)
    ids = torch.tensor([[43, 44, *range(68, 68 + CONFIG["prefix"])]]).expand(2, -1)
    model(ids, history, said)
    # Nothing is rounded yet.
    assert crest_of_gates(model) == 0
    round_products(model)
    found = []
    optimizer = torch.optim.SGD(model.depth.parameters(), 0.05)
    for _ in range(5):
        model(ids, history, said)
        crest = crest_of_gates(model)
        found.append(crest.item())
        optimizer.zero_grad()
        crest.backward()
        optimizer.step()
    assert found == sorted(found, reverse=True) and found[-1] < found[0]
    with torch.no_grad():
        model(ids, history, said)
    assert crest_of_gates(model) == 0


def _replaced(module: torch.nn.Module) -> bool:
    return "forward" in vars(module)
