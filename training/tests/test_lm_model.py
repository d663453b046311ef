"""The language model against transformers' T5, dense and with the golden files' mixtures of its feed-forwards."""

import pytest
import torch
from torch import Tensor

from layout import vocabulary
from lm import LanguageModel as Reference
from umo_train.lm.model import LanguageModel

LM = {
    "d_model": 24,
    "d_kv": 5,
    "d_ff": 33,
    "num_heads": 3,
    "num_layers": 3,
    "num_decoder_layers": 2,
    "relative_attention_num_buckets": 12,
    "relative_attention_max_distance": 20,
    "layer_norm_epsilon": 1e-6,
    "feed_forward_proj": "gated-gelu",
    "experts": 4,
}


def _pair(*, dense: bool, tied: bool, top_k: int = 1) -> tuple[LanguageModel, Reference]:
    config = {"lm": LM | {"tie_word_embeddings": tied, "top_k": top_k}, "vocab": vocabulary(20, 9)}
    torch.manual_seed(7)
    model = LanguageModel(config, dense=dense).eval()
    # Norms with an effect.
    with torch.no_grad():
        for parameter in model.parameters():
            if parameter.ndim == 1:
                parameter.uniform_(0.5, 1.5)
    reference = Reference(config, {f"lm.{name}": t for name, t in model.state_dict().items()}, dense=dense)
    return model, reference


def _inputs() -> tuple[Tensor, Tensor, Tensor]:
    torch.manual_seed(8)
    # Longer than the largest distance, so that every bucket is used.
    ids, said = torch.randint(0, 300, (3, 40)), torch.randint(0, 300, (3, 26))
    mask = torch.arange(40) < torch.tensor([40, 31, 7])[:, None]
    return ids, said, mask


@torch.no_grad()
def _agree(model: LanguageModel, reference: Reference, *, masked: bool) -> None:
    ids, said, mask = _inputs()
    theirs = reference.model(
        input_ids=ids, decoder_input_ids=said, attention_mask=mask.long() if masked else None, use_cache=False
    ).logits
    ours = model(ids, said, mask if masked else None)
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-4 * float(theirs.abs().max()))


@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("masked", [False, True])
def test_dense_is_transformers_t5(tied: bool, masked: bool) -> None:
    _agree(*_pair(dense=True, tied=tied), masked=masked)


@pytest.mark.parametrize("top_k", [1, 2, 4])
def test_sparse_is_a_mixture_of_transformers_feed_forwards(top_k: int) -> None:
    model, reference = _pair(dense=False, tied=False, top_k=top_k)
    _agree(model, reference, masked=True)
    # Rows went to several experts: dispatch was exercised.
    assert max(reference.experts_used()) == 4


@torch.no_grad()
def test_padding_has_no_influence() -> None:
    model, _ = _pair(dense=True, tied=False)
    ids, said, mask = _inputs()
    other = torch.where(mask, ids, (ids + 5) % 300)
    torch.testing.assert_close(model(ids, said, mask), model(other, said, mask))
    alone = model(ids[2:, :7], said[2:])
    torch.testing.assert_close(model(ids, said, mask)[2:], alone, rtol=1e-4, atol=1e-4)


@torch.no_grad()
def test_the_decoder_does_not_see_what_follows() -> None:
    model, _ = _pair(dense=False, tied=False)
    ids, said, _ = _inputs()
    changed = said.clone()
    changed[:, 15:] = 1
    before, after = model(ids, said), model(ids, changed)
    torch.testing.assert_close(before[:, :15], after[:, :15])
    assert not torch.allclose(before[:, 15:], after[:, 15:])
