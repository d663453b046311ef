"""The motion networks: weights for unnormalised channels, and the codebook."""

import pytest
import torch

from umo_train.motion.networks import Codebook, RootNetwork, VqVae


@torch.no_grad()
@pytest.mark.parametrize("layers", [2, 4])
def test_folded_weights_give_the_same_inside_the_borders(layers: int) -> None:
    torch.manual_seed(0)
    model = VqVae(12, 9, layers, 40).eval()
    model.mean.normal_(std=3.0)
    model.scale.uniform_(0.1, 2.0)
    plain = VqVae(12, 9, layers, 40).eval()
    left = plain.load_state_dict(model.folded(), strict=False)
    assert set(left.missing_keys) == {"mean", "scale", "quantizer.count", "quantizer.total"}
    motion = model.mean + model.scale * torch.randn(2, 50, 9)
    ours, folded = model.latents(motion), plain.latents(motion)
    # Three convolutions per layer propagate the zeros beside the motion.
    reach = 3 * layers
    torch.testing.assert_close(folded[:, reach:-reach], ours[:, reach:-reach], rtol=1e-4, atol=1e-4)
    assert not torch.allclose(folded[:, :1], ours[:, :1], atol=1e-2)
    # Codes near latents, not random tables.
    table = ours[0, reach : reach + 20].repeat(2, 1) + 0.01 * torch.randn(40, 12)
    model.quantizer.embedding.weight.copy_(table)
    plain.quantizer.embedding.weight.copy_(table)
    codes = model.codes(motion)
    assert codes.unique().numel() > 10
    assert (plain.codes(motion) == codes)[:, reach:-reach].float().mean() > 0.99
    torch.testing.assert_close(plain.motion(codes), model.motion(codes), rtol=1e-4, atol=1e-4)


def test_folding_leaves_the_model_as_it_is() -> None:
    model = VqVae(6, 5, 2, 8)
    model.scale.fill_(3.0)
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    model.folded()
    assert all(torch.equal(before[name], tensor) for name, tensor in model.state_dict().items())


def _clusters(seed: int, count: int = 512) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows around 6 distant points, and the points."""
    places = 10 * torch.randn(6, 4, generator=torch.Generator().manual_seed(99))
    generator = torch.Generator().manual_seed(seed)
    chosen = places[torch.randint(6, (count,), generator=generator)]
    return chosen + 0.1 * torch.randn(count, 4, generator=generator), places


def test_codebook_learns_clusters() -> None:
    torch.manual_seed(0)
    book = Codebook(16, 4)
    for step in range(300):
        rows, places = _clusters(step)
        book.follow(rows, book.nearest(rows))
    assert torch.cdist(places, book.embedding.weight).min(1).values.max() < 0.15
    rows, _ = _clusters(1000)
    error = (rows - book.embedding.weight[book.nearest(rows)]).norm(dim=1)
    assert error.max() < 1.0


def test_nearest_is_by_euclidean_distance() -> None:
    book = Codebook(16, 4)
    rows = torch.randn(100, 4, generator=torch.Generator().manual_seed(1))
    assert torch.equal(book.nearest(rows), torch.cdist(rows, book.embedding.weight).argmin(1))


def test_codes_out_of_use_start_anew_among_the_rows() -> None:
    torch.manual_seed(0)
    book = Codebook(8, 4)
    rows, places = _clusters(0)
    book.follow(rows, book.nearest(rows))
    with torch.no_grad():
        book.embedding.weight[3] = 1e3
        book.count[3], book.total[3] = 1.0, 1e3
    for step in range(250):
        rows, _ = _clusters(step)
        book.follow(rows, book.nearest(rows))
        # Its count of 1 falls by a hundredth a step, to a tenth in 230.
        away = bool(book.embedding.weight[3].norm() > 500)
        assert away == (step < 229), step
    assert torch.cdist(book.embedding.weight[3:4], places).min() < 1.0


@torch.no_grad()
def test_root_network_sees_21_frames_each_way() -> None:
    torch.manual_seed(0)
    model = RootNetwork(8, 61, 4).double()
    lower = torch.randn(1, 60, 61, dtype=torch.float64)
    changed = lower.clone()
    # Large enough that the remainder at the far end is visible.
    changed[:, 30] += 1e6
    moved = (model(changed) - model(lower)).abs().sum((0, 2)) > 1e-9
    frames = moved.nonzero()[:, 0]
    # 12 convolutions in, 4 + 4 + 1 out (SPEC 2.8).
    assert frames.min() == 30 - 21 and frames.max() == 30 + 21
