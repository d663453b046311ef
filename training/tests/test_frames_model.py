"""The language model of layout `frames`: comparison with the golden references, and causality."""

import pytest
import torch

import frames as reference
from frames_data import AUDIO, CONFIG, PARTS, SLOTS, at, codes
from margin import Margin
from umo_train.frames.model import FrameModel, Tables, for_file
from umo_train.lm import moe


def _split(rows: torch.Tensor) -> dict[str, torch.Tensor]:
    """Codes `[T, J]` split by part, as in the references."""
    return {part.name: rows[:, at(part.name)] for part in PARTS}


@pytest.fixture(scope="module")
def model() -> FrameModel:
    torch.manual_seed(0)
    return FrameModel(CONFIG, PARTS).eval()


@torch.no_grad()
def test_depth_is_the_references(model: FrameModel) -> None:
    state = {name: tensor for name, tensor in model.state_dict().items() if name.startswith("depth.")}
    states, said, before = torch.randn(5, CONFIG["lm"]["d_model"]), codes(5), codes(5, seed=1)
    heard = torch.randn_like(states)
    wanted = reference.Depth(CONFIG, state)(states, _split(said), _split(before), [heard])
    found = model.depth(states, said, before, heard)
    for part in PARTS:
        torch.testing.assert_close(found[part.name], wanted[part.name], rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_keyframes_are_the_references(model: FrameModel) -> None:
    state = {f"lm.{name}": tensor for name, tensor in for_file(model.state_dict()).items()}
    wanted = reference.Keyframes(CONFIG, state)
    said = codes(6)
    torch.testing.assert_close(model.keyframes(said), wanted(_split(said)))
    torch.testing.assert_close(model.frames.kind.weight, torch.stack([wanted.history, wanted.start]))


@torch.no_grad()
def test_greedy_drawing_agrees_with_teacher_forcing(model: FrameModel) -> None:
    """The engine samples code after code; training computes all at once."""
    state = {name: tensor for name, tensor in model.state_dict().items() if name.startswith("depth.")}
    hidden = torch.randn(CONFIG["lm"]["d_model"])
    before = codes(1, seed=1)
    drawn = reference.Depth(CONFIG, state).greedy(hidden, _split(before), [], Margin())
    said = torch.cat([drawn[part.name] for part in PARTS], 1)
    logits = model.depth(hidden[None], said, before)
    for part in PARTS:
        assert torch.equal(logits[part.name].argmax(-1), drawn[part.name])


@torch.no_grad()
@pytest.mark.parametrize("changed", [0, 3, SLOTS - 1])
def test_a_code_sees_those_before_it_alone(model: FrameModel, changed: int) -> None:
    states, said = torch.randn(4, CONFIG["lm"]["d_model"]), codes(4)
    other = said.clone()
    other[:, changed] = (other[:, changed] + 1) % 7
    before, after = model.depth(states, said), model.depth(states, other)
    for part in PARTS:
        for level in range(part.levels):
            slot = at(part.name).start + level
            same = torch.allclose(before[part.name][:, level], after[part.name][:, level], atol=1e-6)
            assert same == (slot <= changed), (part.name, level)


@torch.no_grad()
@pytest.mark.parametrize("changed", [0, 1, 2])
def test_a_keyframe_sees_those_before_it_alone(model: FrameModel, changed: int) -> None:
    ids, history, said = torch.randint(0, 60, (2, 20)), codes(2, 4, seed=1), codes(2, 3)
    hidden = model.encode(ids, history)
    other = said.clone()
    other[:, changed, 0] = (other[:, changed, 0] + 1) % 13
    before, after = model.decode(hidden, said), model.decode(hidden, other)
    same = [torch.allclose(before[:, i], after[:, i], atol=1e-6) for i in range(3)]
    assert same == [i <= changed for i in range(3)]


@torch.no_grad()
def test_the_history_stands_where_its_ids_are(model: FrameModel) -> None:
    size = CONFIG["vocab"]["size"]
    ids = torch.tensor([[3, size + 1, size, 9, size + 2]])
    history = codes(1, 4)
    seen = []
    forward = model.encoder.forward
    model.encoder.forward = lambda x, bias: seen.append(x) or forward(x, bias)
    model.encode(ids, history)
    model.encoder.forward = forward
    rows = model.keyframes(history)[0] + model.frames.kind.weight[0]
    wanted = torch.stack([model.shared.weight[3], rows[1], rows[0], model.shared.weight[9], rows[2]])
    torch.testing.assert_close(seen[0][0], wanted)


@torch.no_grad()
def test_padding_has_no_influence(model: FrameModel) -> None:
    ids, history, said = torch.randint(0, 60, (2, 20)), codes(2, 4), codes(2, 3)
    mask = torch.arange(20) < torch.tensor([[20], [13]])
    other = torch.where(mask, ids, (ids + 5) % 60)
    one, two = (model(x, history, said, mask)[0]["upper"] for x in (ids, other))
    torch.testing.assert_close(one, two)
    assert not torch.allclose(model(ids, history, said)[0]["upper"], model(other, history, said)[0]["upper"])


@torch.no_grad()
def test_the_keyframe_before_is_the_historys_last_and_then_the_chunks(model: FrameModel) -> None:
    ids, history, said = torch.randint(0, 60, (2, 20)), codes(2, 4), codes(2, 3)
    states = model.decode(model.encode(ids, history), said)
    before = torch.stack([history[:, -1], said[:, 0], said[:, 1]], 1)
    unknown = torch.tensor([[False, True, False], [False, False, False]])
    before[0, 1] = -1
    logits, _ = model(ids, history, said, unknown=unknown)
    wanted = model.depth(states.flatten(0, 1), said.flatten(0, 1), before.flatten(0, 1))
    for part in PARTS:
        torch.testing.assert_close(logits[part.name], wanted[part.name])
    assert not torch.allclose(wanted["upper"], model.depth(states.flatten(0, 1), said.flatten(0, 1))["upper"])


@torch.no_grad()
def test_a_fresh_network_mostly_says_the_keyframe_before_again() -> None:
    torch.manual_seed(1)
    depth = {"d_model": 96, "num_heads": 3, "d_ff": 64, "num_layers": 1, "before": True, "layer_norm_epsilon": 1e-6}
    fresh = FrameModel(CONFIG | {"depth": depth}, PARTS).eval()
    said, before = codes(200), codes(200, seed=1)
    logits = fresh.depth(torch.randn(200, CONFIG["lm"]["d_model"]), said, before)
    for part in PARTS:
        again = (logits[part.name].argmax(-1) == before[:, at(part.name)]).float().mean()
        assert again > 0.5, (part.name, again)


@torch.no_grad()
def test_what_nobody_knows_adds_nothing() -> None:
    tables = Tables(PARTS, 8, 1.0)
    said = codes(3)
    hidden = said.clone()
    hidden[:, at("upper")] = -1
    vectors = tables(hidden)
    assert (vectors[:, at("upper")] == 0).all()
    assert torch.equal(vectors[:, at("mouth")], tables(said)[:, at("mouth")])


@torch.no_grad()
def test_what_is_heard_is_said_from_the_encoders_states(model: FrameModel) -> None:
    ids, history, said = torch.randint(0, 60, (2, 20)), codes(2, 4), codes(2, 3)
    places, guessed = torch.tensor([4, 9, 14]), torch.tensor([0, 2])
    logits, guess = model(ids, history, said, None, places, guessed)
    hidden = model.encode(ids, history)
    states = hidden[:, places[guessed]].flatten(0, 1)
    torch.testing.assert_close(guess["upper"], model.depth(states, said[:, guessed].flatten(0, 1))["upper"])
    before = torch.cat([history[:, -1:], said[:, :-1]], 1).flatten(0, 1)
    states, heard = model.decode(hidden, said).flatten(0, 1), hidden[:, places].flatten(0, 1)
    wanted = model.depth(states, said.flatten(0, 1), before, heard)
    torch.testing.assert_close(logits["upper"], wanted["upper"])


@torch.no_grad()
def test_upcycling_leaves_what_is_said_as_it_was() -> None:
    torch.manual_seed(1)
    dense = FrameModel(CONFIG, PARTS, dense=True).eval()
    sparse = FrameModel(CONFIG, PARTS).eval()
    sparse.load_state_dict(moe.upcycled(dense.state_dict(), CONFIG["lm"]["experts"], 3))
    ids, history, said = torch.randint(0, 60, (2, 20)), codes(2, 4), codes(2, 3)
    one, other = (m(ids, history, said)[0]["lower"] for m in (dense, sparse))
    torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-4)


@torch.no_grad()
def test_a_marked_model_tells_places_before_any_training() -> None:
    """With identical tokens, encoder states differ only by the distance from the audio's start."""
    config = CONFIG | {"lm": CONFIG["lm"] | {"d_model": 64, "num_heads": 4, "relative_attention_num_buckets": 64}}
    torch.manual_seed(0)
    ids = torch.full((1, 30), 50)
    ids[0, 2] = AUDIO["start"]
    model = FrameModel(config, PARTS, marked=True).eval()
    assert model.places == 11
    found = model.encode(ids, codes(1, 4))[0, 3:, : model.places]
    assert found.std(0).max() > 0.05
    weights = [weight for weight, mask in model.fixed() if mask.any()]
    assert any(weight is model.frames.embed["intent"].weight for weight in weights)
    # The part common to all tokens is in every keyframe once.
    assert model.keyframes(codes(3))[:, 0].tolist() == [4.0] * 3
