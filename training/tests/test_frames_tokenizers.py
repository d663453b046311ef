"""Residual tokenizers: levels, revival, dropout, the losses, feet and root, and continuing from a checkpoint."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from umo_train.frames import chain, feet, parts, root, tokenizers
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.frames.root import RootItem, RootPlan
from umo_train.frames.tokenizers import PartLoss, ResidualPlan
from umo_train.motion.networks import RootNetwork
from umo_train.performer.rotation import about, euler
from umo_train.skeleton import CHANNELS, CONTACT, CONTACT_JOINTS, VELOCITY, places, rotation_6d, rotations

ARM = Part("arm", ("left_shoulder", "left_elbow", "left_wrist"), 16, 3, 8, 2)
LOWER = Part("lower", tuple(name for name, _ in parts.named([])["lower"]), 16, 2, 8, 2)
SHAPES = Part("mouth", ("jawOpen", "mouthPucker", "mouthLeft"), 16, 3, 8, 2)
PLAN = ResidualPlan(steps=40, stride=3, batch=4, frames=24, rate=3e-3)
# Frames that define the scale of errors.
SPREAD = torch.from_numpy(np.random.default_rng(5).standard_normal((500, 18)).astype(np.float32))


def _motions(count: int = 5, channels: int = 18) -> list[np.ndarray]:
    """Waves of different speeds, with few degrees of freedom."""
    random = np.random.default_rng(0)
    mix = random.standard_normal((4, channels))
    time = np.arange(80)[:, None]
    out = []
    for _ in range(count):
        waves = np.sin(time * random.uniform(0.05, 0.4, 4) + random.uniform(0, 6, 4))
        out.append((waves @ mix * 0.3 + 0.5).astype(np.float32))
    return out


def _model(seed: int = 0) -> ResidualVqVae:
    torch.manual_seed(seed)
    model = ResidualVqVae(ARM, 18)
    for i, level in enumerate(model.levels):
        level.embedding.weight.mul_(0.5**i)
    return model


def test_each_level_says_the_nearest_to_what_is_left() -> None:
    model = _model()
    rows = torch.randn(50, 8)
    codes, vectors, asked = model.quantized(rows)
    left = rows.numpy().astype(np.float64)
    for i, level in enumerate(model.levels):
        table = level.embedding.weight.numpy().astype(np.float64)
        nearest = np.square(left[:, None] - table).sum(-1).argmin(1)
        assert codes[:, i].tolist() == nearest.tolist()
        np.testing.assert_allclose(asked[:, i].numpy(), left, atol=1e-5)
        left = left - table[nearest]
    torch.testing.assert_close(vectors.sum(1), model.vectors(codes))
    torch.testing.assert_close(model.vectors(codes[:, :2]), vectors[:, :2].sum(1))


def test_levels_that_are_not_used_have_no_vector() -> None:
    _, vectors, _ = _model().quantized(torch.randn(4, 8), torch.tensor([1, 2, 3, 1]))
    present = (vectors != 0).any(-1)
    assert present.tolist() == [[True, False, False], [True, True, False], [True] * 3, [True, False, False]]


def test_dropout_is_of_levels_and_of_a_share_of_examples() -> None:
    plan = replace(PLAN, batch=6000, dropout=0.4)
    used = tokenizers.used_levels(plan, 4, np.random.default_rng(0))
    share = np.bincount(used, minlength=5) / 6000
    # The quarter of the examples with fewer levels samples any number of them.
    np.testing.assert_allclose(share, [0, 0.1, 0.1, 0.1, 0.7], atol=0.02)
    assert (tokenizers.used_levels(replace(plan, dropout=0.0), 4, np.random.default_rng(0)) == 4).all()


def test_dropout_reaches_the_decoder() -> None:
    """With all levels but the first dropped, the others' vectors have no influence on the loss."""
    x = torch.from_numpy(np.stack([m[:24] for m in _motions(4)]))
    loss = PartLoss(ARM, PLAN, SPREAD)

    def of(dropout: float, scale: float) -> float:
        model = _model()
        model.levels[2].embedding.weight.mul_(scale)
        plan = replace(PLAN, dropout=dropout, commitment=0.0, sparse=0.0)
        # A seed with which every example has fewer than three levels.
        chance = next(c for c in map(np.random.default_rng, range(99)) if _fewer(plan, c))
        return tokenizers.loss_of(model, plan, x, loss, chance, coded=True, phase=0)[0].item()

    assert of(1.0, 1.0) == of(1.0, 30.0)
    assert of(0.0, 1.0) != of(0.0, 30.0)


def _fewer(plan: ResidualPlan, chance: np.random.Generator) -> bool:
    state = chance.bit_generator.state
    few = plan.dropout == 0 or bool((tokenizers.used_levels(plan, 3, chance) < 3).all())
    chance.bit_generator.state = state
    return few


def test_every_level_that_is_used_commits_to_what_it_says() -> None:
    x = torch.from_numpy(np.stack([m[:24] for m in _motions(4)]))
    loss = PartLoss(ARM, PLAN, SPREAD)
    model = _model()
    z = model.latents(x).flatten(0, 1)
    codes, _, _ = model.quantized(z)
    wanted = [(z - model.vectors(codes[:, :n])).square().mean().item() for n in (1, 2, 3)]
    plan = replace(PLAN, dropout=0.0, sparse=0.0)
    _, values = tokenizers.loss_of(model, plan, x, loss, np.random.default_rng(0), coded=True, phase=0)
    assert values["commitment"] == pytest.approx(np.mean(wanted), rel=1e-4)
    (total, _), (less, _) = (
        tokenizers.loss_of(
            _model(), replace(plan, commitment=c), x, loss, np.random.default_rng(0), coded=True, phase=0
        )
        for c in (1.0, 0.0)
    )
    assert (total - less).item() == pytest.approx(np.mean(wanted), rel=1e-3)


def test_codes_out_of_use_are_revived_on_every_level() -> None:
    model = _model()
    for level in model.levels:
        # Far from every latent, and long unused.
        level.embedding.weight[4:] = 1e4
        level.count.zero_()
        level.total.zero_()
    x = torch.from_numpy(np.stack([m[:24] for m in _motions(4)]))
    loss = PartLoss(ARM, PLAN, SPREAD)
    for _ in range(3):
        tokenizers.loss_of(model, PLAN, x, loss, np.random.default_rng(0), coded=True, phase=0)
    for level in model.levels:
        assert level.embedding.weight.abs().max() < 100
    codes, _, _ = model.quantized(model.latents(x).flatten(0, 1))
    # Dead codes are in use again.
    assert (codes[:, 0] >= 4).any()


def test_codebooks_start_from_what_levels_leave() -> None:
    torch.manual_seed(0)
    model = ResidualVqVae(ARM, 18)
    tokenizers.start_codebooks(model, PLAN, _motions(), np.random.default_rng(0))
    z = model.latents(torch.from_numpy(np.stack(_motions()))).flatten(0, 1)
    codes, vectors, _ = model.quantized(z)
    left = [(z - vectors[:, :n].sum(1)).square().sum().item() for n in range(4)]
    assert all(after < 0.6 * before for before, after in pairwise(left))
    assert min(len(codes[:, i].unique()) for i in range(3)) > 12


def test_the_file_holds_what_was_trained() -> None:
    """Folded weights work on unnormalised channels, equal except at the first and the last frames."""
    model = _model().eval()
    model.mean.uniform_(-1, 1)
    model.scale.uniform_(0.5, 2)
    folded = model.folded()
    other = ResidualVqVae(ARM, 18).eval()
    state = {key: value for key, value in folded.items() if not key.startswith("quantizer")}
    missing = other.load_state_dict(state, strict=False)
    assert not missing.unexpected_keys
    assert folded["quantizer.embedding.weight"].shape == (3 * 16, 8)
    for i, level in enumerate(other.levels):
        level.embedding.weight.copy_(folded["quantizer.embedding.weight"][16 * i : 16 * i + 16])
    motion = torch.randn(1, 40, 18)
    torch.testing.assert_close(other.latents(motion)[:, 8:-8], model.latents(motion)[:, 8:-8], rtol=1e-3, atol=1e-4)
    codes = torch.randint(16, (1, 40, 3))
    torch.testing.assert_close(other.motion(codes), model.motion(codes), rtol=1e-3, atol=1e-4)


class _Stop(Exception):
    pass


def _stopping(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    add = tokenizers.Log.add

    def stop(log: tokenizers.Log, step: int, values: dict[str, float]) -> None:
        if step == after:
            raise _Stop
        add(log, step, values)

    monkeypatch.setattr(tokenizers.Log, "add", stop)


def _same(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


# Interrupted with codes, and before there are any.
@pytest.mark.parametrize(("every", "after"), [(15, 20), (1, 1)])
def test_a_resumed_tokenizer_ends_where_an_uninterrupted_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int, after: int
) -> None:
    monkeypatch.setattr(tokenizers, "SAVE_EVERY", every)
    whole = tokenizers.train_part(PLAN, ARM, _motions(), tmp_path / "whole")
    with monkeypatch.context() as patch:
        _stopping(patch, after)
        with pytest.raises(_Stop):
            tokenizers.train_part(PLAN, ARM, _motions(), tmp_path / "parts")
    torch.manual_seed(123)
    assert _same(whole, tokenizers.train_part(PLAN, ARM, _motions(), tmp_path / "parts"))


def test_a_tokenizer_learns_and_every_level_adds_to_it(tmp_path: Path) -> None:
    plan = replace(PLAN, steps=200, rate=5e-3)
    angles = (motion.reshape(-1, 3, 3) - 0.5 for motion in _motions(12, 9))
    motions = [rotation_6d(euler(turns)).reshape(-1, 18).astype(np.float32) for turns in angles]
    model = tokenizers.train_part(plan, ARM, motions, tmp_path)
    codes = tokenizers.tokenize(model, motions[0])
    assert codes.shape == (80, 3) and codes.dtype == np.int16
    weight, chained = parts.chained_weights(ARM), chain.Chained(ARM)

    def error(said: np.ndarray) -> float:
        one, other = (chained(torch.from_numpy(rows)).numpy() for rows in (said, motions[0]))
        return float((weight * np.square(one - other)).sum(1).mean())

    nothing = error(np.repeat(motions[0].mean(0)[None], 80, 0))
    by_level = [error(tokenizers.decoded(model, codes, levels)) for levels in (1, 2, 3)]
    assert by_level[2] < by_level[1] < by_level[0] < 0.5 * nothing
    # Keyframes alone still represent the motion.
    assert error(tokenizers.decoded(model, codes, stride=3)) < 0.5 * nothing


def test_errors_of_speed_and_acceleration_count() -> None:
    """A trembling error costs more than a steady one of the same size."""
    loss = PartLoss(SHAPES, PLAN, SPREAD[:, :3])
    x = torch.zeros(1, 30, 3)
    steady = x + 0.01
    trembling = x + 0.01 * (-1.0) ** torch.arange(30)[:, None]
    (one, values), (other, shaken) = loss(steady, x), loss(trembling, x)
    assert values["error"] == pytest.approx(shaken["error"], rel=1e-5) and values["velocity"] == 0
    # Differences of 2 and 4 times the size.
    wanted = 1 + PLAN.velocity * 4 + PLAN.acceleration * 16
    assert (other / one).item() == pytest.approx(wanted, rel=1e-4)


def test_errors_that_undo_each_other_along_a_part_cost_less() -> None:
    """Errors are measured by a joint's world direction, not its rotation relative to the previous one."""
    loss = PartLoss(ARM, PLAN, SPREAD)
    still = torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(1, 30, 3)
    turn = torch.tensor([np.cos(0.1), np.sin(0.1), 0, -np.sin(0.1), np.cos(0.1), 0]).float()
    back = turn * torch.tensor([1.0, -1, 1, -1, 1, 1])
    undone, added = still.clone(), still.clone()
    undone[..., :6], undone[..., 6:12] = turn, back
    added[..., :6], added[..., 6:12] = turn, turn
    one, two = loss(undone, still)[1]["error"], loss(added, still)[1]["error"]
    assert 0 < one < 0.3 * two


def _standing(frames: int) -> dict[str, np.ndarray]:
    out = {}
    for region, width in CHANNELS.items():
        joints = {"face": 1, "hands": 30, "upper": 13, "lower": 9}[region]
        rows = np.zeros((frames, width), np.float32)
        rows[:, : 6 * joints] = np.tile([1, 0, 0, 0, 1, 0], joints)
        out[region] = rows
    out["lower"][:, CONTACT] = 1
    return out


def test_feet_are_where_the_skeleton_has_them() -> None:
    motion = _standing(7)
    motion["lower"][:, :54] += np.random.default_rng(3).normal(0, 0.2, (7, 54)).astype(np.float32)
    wanted = places(rotations(motion), np.zeros((7, 3)))
    wanted = wanted[:, list(CONTACT_JOINTS)] - wanted[:, :1]
    found = feet.places(torch.from_numpy(motion["lower"])[None])[0]
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-5)


def _turning(lower: np.ndarray, column: int) -> np.ndarray:
    """The joint of a column rotated more and more about the vertical."""
    out, angle = lower.copy(), 0.01 * np.arange(len(lower))
    zero = np.zeros_like(angle)
    out[:, column : column + 6] = np.stack([np.cos(angle), zero, -np.sin(angle), zero, zero + 1, zero], 1)
    return out


def test_planted_feet_that_slide_cost_and_lifted_ones_do_not() -> None:
    lower = _standing(20)["lower"]
    loss = PartLoss(LOWER, PLAN, torch.from_numpy(np.random.default_rng(1).normal(0, 1, (99, 61)).astype(np.float32)))
    lifted = lower.copy()
    lifted[:, CONTACT] = 0
    found = []
    for planted in (lower, lifted):
        beside = torch.from_numpy(tokenizers.with_feet(planted, planted))[None]
        x, y = (torch.from_numpy(rows)[None] for rows in (planted, _turning(planted, 0)))
        found.append(loss(y, x, beside)[1])
    assert found[0]["slide"] > 1e-4 and found[1]["slide"] == 0
    assert tokenizers.feet_of(LOWER) and not tokenizers.feet_of(ARM)


def test_feet_slide_under_the_pelvis_that_was_said() -> None:
    """A part with legs only is compared with the performer's foot positions, on the decoded pelvis."""
    legs = Part("legs", LOWER.channels[1:], 16, 2, 8, 2)
    lower = _standing(20)["lower"]
    spread = torch.from_numpy(np.random.default_rng(1).normal(0, 1, (99, 55)).astype(np.float32))
    loss = PartLoss(legs, PLAN, spread)
    x = torch.from_numpy(lower[:, 6:])[None]
    for said, slides in ((lower, False), (_turning(lower, 0), True)):
        beside = torch.from_numpy(tokenizers.with_feet(lower, said))[None]
        assert (loss(x, x, beside)[1]["slide"] > 1e-5) == slides


def test_feet_that_go_together_are_told_from_those_that_part() -> None:
    planted = torch.ones(1, 10, 4, dtype=torch.bool)
    error = torch.zeros(1, 10, 4, 3)
    error[..., 0] = 0.01 * torch.arange(10)[:, None]
    apart, together = tokenizers.slides(error, planted)
    assert float(apart) == pytest.approx(0, abs=1e-9) and float(together) == pytest.approx(0.09, rel=1e-3)
    error[:, :, 2:] *= -1
    apart, together = tokenizers.slides(error, planted)
    assert float(apart) == pytest.approx(0.09, rel=1e-3) and float(together) == pytest.approx(0, abs=1e-9)
    # One foot alone never moves relative to another.
    planted[..., 2:] = False
    assert float(tokenizers.slides(error, planted)[0]) == pytest.approx(0, abs=1e-9)


def test_the_root_network_sees_no_velocity() -> None:
    lower = torch.from_numpy(_standing(3)["lower"])[None] * 1.7
    lower[..., VELOCITY] = 9.0
    seen = root.rooted(lower)
    assert (seen[..., VELOCITY] == 0).all()
    torch.testing.assert_close(seen[..., :6], torch.tensor([1.0, 0, 0, 0, 1, 0]).expand(1, 3, 6))
    assert (lower[..., VELOCITY] == 9.0).all()


def _swaying(frames: int, seed: int) -> RootItem:
    """A swaying pelvis over fixed feet: hips and ankles rotate the other way."""
    random = np.random.default_rng(seed)
    lower = _standing(frames)["lower"]
    t = np.arange(frames) / 30
    side, fore = (0.03 * np.sin(t * random.uniform(1, 3) + random.uniform(0, 6)) for _ in range(2))
    turn = about("z", side) @ about("x", fore)
    for joint, local in ((1, turn), (2, turn), (5, np.swapaxes(turn, -1, -2)), (6, np.swapaxes(turn, -1, -2))):
        lower[:, 6 * joint : 6 * joint + 6] = rotation_6d(local)
    at = feet.places(torch.from_numpy(lower))[:, 0].numpy()
    lower[:-1, VELOCITY] = -30 * np.diff(at, axis=0)
    return RootItem(lower, (), 0.02 - at[:, 1])


@pytest.mark.parametrize(("width", "layers"), [(6, 1), (11, 3)])
def test_the_root_goes_as_planted_feet_want(tmp_path: Path, width: int, layers: int) -> None:
    items = [_swaying(150, seed) for seed in range(6)]
    model = root.solved(RootPlan(width, layers), items[:-1], tmp_path)
    new = items[-1]
    with torch.no_grad():
        y = model(root.rooted(torch.from_numpy(new.lower)[None]))[0].numpy()
    own = new.lower[:-1, VELOCITY]
    error = np.abs(y[:-1, VELOCITY] - own)[:, [0, 2]]
    assert error.mean() < 0.05 * np.abs(own[:, [0, 2]]).mean()
    assert np.abs(y[:, VELOCITY.start + 1] - new.height).max() < 1e-3
    # The zeros behind a stream's end are not motion.
    assert np.abs(y[-1, VELOCITY]).max() < 1.5
    again = RootNetwork(width, 61, layers)
    again.load_state_dict(torch.load(tmp_path / "tokenizer_root.pt", weights_only=True)["model"])
    assert _same(model, again)


def test_the_root_follows_decoded_feet_not_the_performer() -> None:
    truth, other = (torch.from_numpy(_swaying(60, seed).lower) for seed in (0, 1))
    wanted, count = root.wanted(other, truth)
    torch.testing.assert_close(wanted, other[:-1, VELOCITY][:, [0, 2]], atol=1e-4, rtol=1e-3)
    assert (count == 4).all()
    lifted = truth.clone()
    lifted[:, CONTACT] = 0
    torch.testing.assert_close(root.wanted(other, lifted)[0], truth[:-1, VELOCITY][:, [0, 2]])


def test_a_root_too_narrow_to_say_all_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 6"):
        root.embed(RootNetwork(5, 61, 2), root.Linear(np.zeros((54, 2)), np.zeros(54), 0.0))


def test_a_parts_numbers_lie_over_those_of_all() -> None:
    plan = tokenizers.plan_of({"steps": 5, "codes": 9, "root": {}, "dropout": 0.5}, {"steps": 7, "name": "x"}, 3, 4)
    assert (plan.steps, plan.dropout, plan.stride, plan.seed) == (7, 0.5, 3, 4)


def test_a_published_tokenizer_goes_on_with_its_codes(tmp_path: Path) -> None:
    motions = _motions()
    first = tokenizers.train_part(replace(PLAN, steps=60), ARM, motions, tmp_path / "first")
    folded = ResidualVqVae(ARM, 18)
    given = first.folded()
    tables = given.pop("quantizer.embedding.weight").split(ARM.codes)
    given |= {f"levels.{i}.embedding.weight": rows for i, rows in enumerate(tables)}
    folded.load_state_dict(folded.state_dict() | given)
    whole = torch.from_numpy(motions[0])[None]
    # Folded weights, and the same unfolded with other statistics, reproduce the network.
    again = ResidualVqVae(ARM, 18)
    again.load_state_dict(folded.state_dict())
    again.unfold(torch.full((18,), 0.3), torch.linspace(0.5, 2.0, 18))
    inner = slice(10, -10)
    codes = first.codes(whole)[0, inner]
    torch.testing.assert_close(again.motion(first.codes(whole)), first.motion(first.codes(whole)), atol=1e-4, rtol=1e-4)
    assert (again.codes(whole)[0, inner] == codes).float().mean() > 0.98
    gone_on = tokenizers.train_part(replace(PLAN, steps=2, rate=1e-5), ARM, motions, tmp_path / "again", None,
                                    folded.state_dict())  # fmt: skip
    assert (gone_on.codes(whole)[0, inner, 0] == codes[:, 0]).float().mean() > 0.9
    # Codes absent from these motions are not forgotten: none is reset at once.
    for old, new in zip(first.levels, gone_on.levels, strict=True):
        assert (old.embedding.weight - new.embedding.weight).norm(dim=1).max() < 0.5 * old.embedding.weight.norm()
