import copy
import json

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import nn
from transformers import T5Config, T5ForConditionalGeneration
from transformers.models.t5.modeling_t5 import T5DenseGatedActDense

import convert_sources
from umo_train.convert import SourceError, t5
from umo_train.convert.layout import shapes

CONFIG = convert_sources.golden_config()
SIZE = CONFIG["vocab"]["size"]


class Experts(nn.Module):
    """A router and feed-forwards of transformers; top-k probabilities are divided by their sum."""

    def __init__(self, config: T5Config, experts: int, top_k: int) -> None:
        super().__init__()
        self.router = nn.Linear(config.d_model, experts, bias=False)
        self.experts = nn.ModuleList([T5DenseGatedActDense(config) for _ in range(experts)])
        self.top_k = top_k
        self.used: set[int] = set()

    def forward(self, hidden: torch.Tensor) -> torch.Tensor:
        weights, index = torch.softmax(self.router(hidden), -1).topk(self.top_k, -1)
        self.used |= set(index.flatten().tolist())
        outputs = torch.stack([expert(hidden) for expert in self.experts], -2)
        picked = outputs.gather(-2, index[..., None].expand(*index.shape, hidden.shape[-1]))
        return (weights[..., None] / weights.sum(-1)[..., None, None] * picked).sum(-2)


def sparse(config: dict, tensors: dict) -> T5ForConditionalGeneration:
    """The converted weights in a T5 whose feed-forwards are experts."""
    lm, model = config["lm"], convert_sources.t5(config, config["vocab"]["size"])
    for stack in (model.encoder, model.decoder):
        for block in stack.block:
            block.layer[-1].DenseReluDense = Experts(model.config, lm["experts"], lm["top_k"])
    state = {name.removeprefix("lm.").replace(".moe.", ".DenseReluDense."): t for name, t in tensors.items()}
    shared = state["shared.weight"]
    model.load_state_dict(state | {"encoder.embed_tokens.weight": shared, "decoder.embed_tokens.weight": shared})
    return model.eval()


def logits(model: T5ForConditionalGeneration, rows: int) -> torch.Tensor:
    ids = torch.randint(0, rows, (2, 19), generator=torch.Generator().manual_seed(7))
    with torch.no_grad():
        return model(input_ids=ids, decoder_input_ids=ids[:, :11]).logits


@pytest.mark.parametrize(("experts", "top_k"), [(4, 1), (3, 2), (2, 2)])
def test_upcycling_leaves_the_output_unchanged(tmp_path, experts, top_k):
    config = copy.deepcopy(CONFIG)
    config["lm"] |= {"experts": experts, "top_k": top_k}
    dense = convert_sources.t5(config, SIZE)
    dense.save_pretrained(tmp_path)
    tensors, new_rows = t5.convert(tmp_path, config, seed=5)
    assert new_rows == 0 and set(tensors) == {name for name in shapes(config) if name.startswith("lm.")}
    model = sparse(config, tensors)
    torch.testing.assert_close(logits(model, SIZE), logits(dense, SIZE), rtol=1e-5, atol=1e-5)
    # Routers choose different experts.
    assert any(len(module.used) > 1 for module in model.modules() if isinstance(module, Experts))


def test_routers_follow_the_seed_and_are_small(tmp_path):
    convert_sources.t5(CONFIG, SIZE).save_pretrained(tmp_path)
    name = "lm.decoder.block.1.layer.2.moe.router.weight"
    first, same, other = (t5.convert(tmp_path, CONFIG, seed)[0][name] for seed in (1, 1, 2))
    assert torch.equal(first, same) and not torch.equal(first, other)
    assert 0 < first.abs().max() < 0.1


def test_new_rows_are_those_of_hugging_face_and_old_ones_stay(tmp_path):
    rows = convert_sources.TEXT
    dense = convert_sources.t5(CONFIG, rows)
    dense.save_pretrained(tmp_path)
    old = dense.shared.weight.detach().clone()
    head = dense.lm_head.weight.detach().clone()
    tensors, new_rows = t5.convert(tmp_path, CONFIG, seed=9)
    table = tensors["lm.shared.weight"]
    assert new_rows == SIZE - rows and torch.equal(table[:rows], old)
    assert torch.equal(tensors["lm.lm_head.weight"][:rows], head)
    wanted = nn.Embedding(SIZE, old.shape[1])
    torch.manual_seed(9)
    dense._init_added_embeddings_weights_with_mean(dense.shared, wanted, rows, new_rows)
    assert torch.equal(table[rows:], wanted.weight[rows:].detach())


def test_a_table_of_fewer_rows_than_columns_grows_by_its_mean():
    # Too few rows for a covariance of full rank: Hugging Face then uses the mean without sampling.
    rows = torch.randn(5, 26, generator=torch.Generator().manual_seed(0))
    table = t5.grown("file", "shared.weight", rows, 9, seed=0)
    torch.testing.assert_close(table[5:], rows.mean(0).expand(4, -1), rtol=1e-4, atol=2e-4)


def test_shards_bins_and_copies_of_the_table_give_the_same(tmp_path):
    dense = convert_sources.t5(CONFIG, SIZE)
    folders = [tmp_path / name for name in ("whole", "shards", "bin", "bins")]
    dense.save_pretrained(folders[0])
    dense.save_pretrained(folders[1], max_shard_size="60KB")
    assert (folders[1] / "model.safetensors.index.json").is_file()
    state = convert_sources.t5_state(dense)
    assert "encoder.embed_tokens.weight" in state
    for folder in folders[2:]:
        folder.mkdir()
        (folder / "config.json").write_text((folders[0] / "config.json").read_text())
    torch.save(state, folders[2] / "pytorch_model.bin")
    shards = {name: f"pytorch_model-0000{1 + i % 2}-of-00002.bin" for i, name in enumerate(state)}
    for shard in set(shards.values()):
        torch.save({name: state[name] for name in state if shards[name] == shard}, folders[3] / shard)
    (folders[3] / "pytorch_model.bin.index.json").write_text(json.dumps({"weight_map": shards}))
    first, *others = (t5.convert(folder, CONFIG, seed=0)[0] for folder in folders)
    for other in others:
        assert first.keys() == other.keys() and all(torch.equal(first[k], other[k]) for k in first)


def test_language_of_motions_own_model_is_read(tmp_path):
    dense = convert_sources.t5(CONFIG, SIZE)
    path = convert_sources.language_of_motion(tmp_path / "lom.ckpt", CONFIG, convert_sources.t5_state(dense))
    tensors, new_rows = t5.convert(path, CONFIG, seed=0)
    assert new_rows == 0 and torch.equal(tensors["lm.shared.weight"], dense.shared.weight.detach())
    config = copy.deepcopy(CONFIG)
    config["vocab"]["face"], config["vocab"]["hands"] = config["vocab"]["hands"], config["vocab"]["face"]
    with pytest.raises(SourceError, match="Language of Motion's order"):
        t5.convert(path, config, seed=0)


def test_vocabulary_is_the_papers():
    vocab = t5.vocabulary()
    assert vocab["size"] == 33644 and vocab["face"]["first"] == 32103
    assert vocab["audio"] == {"first": 33139, "codes": 500, "start": 33641, "end": 33642, "mask": 33643}
    assert t5.vocabulary(convert_sources.TEXT, 256, 37) == CONFIG["vocab"]


def test_wrong_checkpoints_are_refused(tmp_path):
    dense = convert_sources.t5(CONFIG, SIZE)
    dense.save_pretrained(tmp_path)
    state = load_file(tmp_path / "model.safetensors")
    good = dict(state)

    def refused(match, tensors, config=CONFIG):
        save_file(tensors, tmp_path / "model.safetensors")
        with pytest.raises(SourceError, match=match):
            t5.convert(tmp_path, config, seed=0)

    refused("unknown: encoder.extra.weight", state | {"encoder.extra.weight": torch.zeros(1)})
    refused("missing: lm_head.weight", {k: v for k, v in state.items() if k != "lm_head.weight"})
    refused("differs from shared.weight", state | {"encoder.embed_tokens.weight": torch.zeros(SIZE, 26)})
    refused("no T5 in it", {"encoder.weight": torch.zeros(1)})
    smaller = copy.deepcopy(CONFIG)
    smaller["vocab"]["size"] = SIZE - 1
    refused(f"{SIZE} rows, more than the {SIZE - 1}", good, smaller)
    wider = copy.deepcopy(CONFIG)
    wider["lm"]["d_ff"] += 1
    refused("d_ff: 39, the config has 40", good, wider)
