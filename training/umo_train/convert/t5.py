"""Converts a dense T5 to the sparse language model: a larger vocabulary, and every feed-forward copied to all experts.

Reads Hugging Face's T5 v1.1 and Flan-T5 of any size, and Language of Motion's model trained from one."""

import re
from pathlib import Path

import torch
from torch import Tensor

from umo_train.convert.layout import Config, shapes
from umo_train.convert.sources import SourceError, Tensors, agree, read, read_json, renamed

_PREFIX = "lm."
_LOM_PREFIX = "lm.language_model."
_TABLES = ("shared.weight", "lm_head.weight")
_TIED = ("encoder.embed_tokens.weight", "decoder.embed_tokens.weight")
# Old checkpoints contain a table that no layer reads.
_IGNORED = (r"decoder\.block\.0\.layer\.1\.EncDecAttention\.relative_attention_bias\.weight",)
_SIZES = (
    "d_model", "d_kv", "d_ff", "num_heads", "num_layers", "num_decoder_layers", "relative_attention_num_buckets",
    "relative_attention_max_distance", "layer_norm_epsilon", "feed_forward_proj", "tie_word_embeddings",
)  # fmt: skip
# Small relative to hidden states of magnitude 1, so that every expert is tried when training starts.
_ROUTER_STD = 0.02
# Variance around the old rows' mean with which Hugging Face draws new rows.
_NEW_ROW_VARIANCE = 1e-9


def vocabulary(text: int = 32100, codes: int = 256, units: int = 500) -> Config:
    """`config.vocab` in Language of Motion's order of tokens after the `text` ids of T5's tokenizer: 3 for motion, the
    parts' codes with 3 markers each, and the audio units with 2 spare ids and 3 markers."""
    vocab: Config = {"pad": 0, "eos": 1, "decoder_start": 0}
    first = text + 3
    sizes = (("face", codes, 0), ("hands", codes, 0), ("upper", codes, 0), ("lower", codes, 0), ("audio", units, 2))
    for name, count, spare in sizes:
        start = first + count + spare
        vocab[name] = {"first": first, "codes": count, "start": start, "end": start + 1, "mask": start + 2}
        first = start + 3
    return {"size": first, **vocab}


def convert(path: Path, config: Config, seed: int) -> tuple[Tensors, int]:
    """`lm.*` from a folder with `config.json` and weights, or from a checkpoint of Language of Motion; and the number
    of new rows in its vocabulary."""
    if path.is_dir():
        _check(path, config)
    source, trained = _source(path)
    _untie(path, source, config["lm"]["tie_word_embeddings"])
    if trained:
        _check_order(path, config)
    size = config["vocab"]["size"]
    new_rows = size - len(source["shared.weight"])
    for i, table in enumerate(_TABLES):
        if table in source:
            source[table] = grown(str(path), table, source[table], size, seed + i)
    wanted = {name: shape for name, shape in shapes(config).items() if name.startswith(_PREFIX)}
    routers = [name for name in wanted if name.endswith(".moe.router.weight")]
    names = {name: dense_name(name) for name in wanted if name not in routers}
    out = renamed(f"{path} (T5)", source, names, wanted, _IGNORED)
    generator = torch.Generator().manual_seed(seed)
    out |= {name: _ROUTER_STD * torch.randn(wanted[name], generator=generator) for name in routers}
    return out, new_rows


def dense_name(name: str) -> str:
    """Hugging Face's name of the tensor that `name` is initialised from: one feed-forward for all experts."""
    return re.sub(r"\.moe\.experts\.\d+\.", ".DenseReluDense.", name.removeprefix(_PREFIX))


def grown(what: str, name: str, rows: Tensor, size: int, seed: int) -> Tensor:
    """`rows` followed by new ones, drawn like Hugging Face's `resize_token_embeddings`: from the distribution of the
    old rows with a very small variance, so that all start nearly equal but not symmetric."""
    old = len(rows)
    if old > size:
        raise SourceError(f"{what}:\n  {name}: {old} rows, more than the {size} of `vocab.size` in the config")
    if old == size:
        return rows
    values = rows.float()
    mean = values.mean(0)
    covariance = _NEW_ROW_VARIANCE * ((values - mean).T @ (values - mean) / old)
    new = mean.expand(size - old, -1)
    if torch.distributions.constraints.positive_definite.check(covariance).all():
        # Distributions do not accept a generator.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            normal = torch.distributions.MultivariateNormal(mean, covariance_matrix=covariance)
            new = normal.sample((size - old,))
    return torch.cat([values, new])


def _source(path: Path) -> tuple[Tensors, bool]:
    """The weights under Hugging Face's names, and whether they are Language of Motion's."""
    found = read(path)
    lom = {name.removeprefix(_LOM_PREFIX): t for name, t in found.items() if name.startswith(_LOM_PREFIX)}
    source = lom or found
    if "shared.weight" not in source:
        some = ", ".join(sorted(found)[:3])
        raise SourceError(f"{path}: no T5 in it: no shared.weight, with or without {_LOM_PREFIX}; it has {some} …")
    return dict(source), bool(lom)


def _untie(path: Path, source: Tensors, tied: bool) -> None:
    """Removes the copies of the embedding table, after checking that they are copies."""
    for name in (*_TIED, *(("lm_head.weight",) if tied else ())):
        if name in source and not torch.equal(source.pop(name), source["shared.weight"]):
            raise SourceError(f"{path}:\n  {name}: differs from shared.weight, which it should repeat")


def _check(folder: Path, config: Config) -> None:
    theirs = read_json(folder / "config.json")
    # Since version 5, transformers declares the head tied for every T5, and stores the old setting beside it.
    theirs["tie_word_embeddings"] = theirs.get("scale_decoder_outputs", theirs.get("tie_word_embeddings", True))
    found = {key: theirs[key] for key in _SIZES if theirs.get(key) is not None}
    agree(f"{folder / 'config.json'}", config["lm"], found)


def _check_order(path: Path, config: Config) -> None:
    vocab = config["vocab"]
    first, units = vocab["face"]["first"] - 3, vocab["audio"]["codes"]
    agree(f"{path}: ids in Language of Motion's order", vocab, vocabulary(first, vocab["face"]["codes"], units))
