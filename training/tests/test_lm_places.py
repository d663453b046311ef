"""A marked model knows positions before any learning, and training keeps that."""

from typing import Any

import numpy as np
import torch

from layout import vocabulary
from umo_train.lm.examples import Examples, Stream
from umo_train.lm.model import LanguageModel
from umo_train.lm.places import align
from umo_train.lm.train import Master, loss_of
from umo_train.skeleton import PARTS

TEXTS = np.array([21, 22]), np.array([31])


def _config(lm: dict[str, Any]) -> dict[str, Any]:
    return {
        "lm": lm,
        "vocab": vocabulary(100, 500),
        "rest": dict.fromkeys(PARTS, 0),
        "keyframe_stride": 3,
        "prefix": 10,
        "frame_rate": 30,
        "audio": {"token_rate": 50},
        "templates": {"audio_to_motion": [8, "audio", 9, *PARTS, 1]},
    }


def test_places_are_told_and_stay_as_they_are_while_the_rest_trains() -> None:
    """The last cross-attention of a fresh marked model finds each keyframe's audio; training does not change it."""
    torch.manual_seed(0)
    lm = dict(d_model=128, d_kv=16, d_ff=64, num_heads=8, num_layers=1, num_decoder_layers=1)
    lm |= dict(relative_attention_num_buckets=512, relative_attention_max_distance=512, layer_norm_epsilon=1e-6)
    lm |= dict(feed_forward_proj="gated-gelu", tie_word_embeddings=False, experts=2, top_k=1)
    config = _config(lm)
    model = LanguageModel(config, marked=True)
    rng = np.random.default_rng(3)
    streams = [
        Stream(
            rng.integers(0, 256, (4, 600)).astype(np.int16), rng.integers(0, 500, (1, 1000)).astype(np.int16), *TEXTS
        )
        for _ in range(12)
    ]
    examples = Examples(config, streams, 0, augment=False)
    align(model, examples, (5,), 0)
    batch = examples.chunk(8, 5, np.random.default_rng(1))
    said = np.concatenate([np.zeros((8, 1), np.int64), batch.labels[:, :-1].clip(min=0)], 1)
    with torch.no_grad():
        hidden = model.encode(torch.from_numpy(batch.ids))
        block = model.decoder.block[0]
        x = model.shared(torch.from_numpy(said))
        x = block.layer[1].layer_norm(block.layer[0](x, model.decoder.bias(x.shape[1], x.device)))
        attention = block.layer[1].EncDecAttention
        scores = attention.q(x)[..., :16] @ attention.k(hidden)[..., :16].transpose(1, 2)
        weights = torch.softmax(scores, -1)
    for keyframe in range(5):
        heard = slice(2 + 50 + 5 * keyframe, 2 + 55 + 5 * keyframe)
        assert weights[:, 1 + keyframe, heard].sum(-1).mean() > 0.3, keyframe
    fixed = [(weight, mask, weight.detach().clone()) for weight, mask in model.fixed()]
    optimizer = Master(model, 1e-2, (0.9, 0.99), 0.05)
    for _ in range(3):
        loss_of(model, batch, torch.device("cpu"))[0].backward()
        optimizer.step()
    for weight, mask, before in fixed:
        assert torch.equal(weight[mask], before[mask])
        assert mask.all() or not torch.equal(weight[~mask], before[~mask])
