"""One training step of the language model: inputs, the parts of the loss, and several processes."""

import os
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from test_lm_examples import CONFIG, SILENCE, VOCAB, _stream
from test_lm_train import LM
from umo_train.lm import moe, train
from umo_train.lm.examples import Batch, Examples
from umo_train.lm.model import LanguageModel
from umo_train.lm.train import StagePlan

CPU = torch.device("cpu")


def _model() -> LanguageModel:
    torch.manual_seed(3)
    return LanguageModel(CONFIG | {"lm": LM | {"top_k": 2}})


def _examples() -> Examples:
    prompts = [np.array([31, 32]), np.array([41, 42, 43, 44, 45])]
    return Examples(CONFIG, [_stream(prompt=prompts[0]), _stream(prompt=prompts[1])], SILENCE)


def _plan(**changes: object) -> StagePlan:
    plan = StagePlan("stage2", 1, {"a2m": 1}, 1e-2, batch=6, targets=(2,), warmup=1, balance=0.25, bf16=False)
    return replace(plan, **changes)


def _with_label(batch: Batch, at: int, label: int) -> Batch:
    labels = batch.labels.copy()
    labels[:, at] = label
    return replace(batch, labels=labels)


@torch.no_grad()
def test_the_decoder_never_reads_the_answer() -> None:
    """The label at a position affects later outputs only."""
    model, batch = _model(), _examples().chunk(4, 2, np.random.default_rng(0))
    _, before, _ = train.loss_of(model, batch, CPU)
    for at in range(batch.labels.shape[1]):
        _, after, _ = train.loss_of(model, _with_label(batch, at, VOCAB["eos"]), CPU)
        torch.testing.assert_close(after[:, : at + 1], before[:, : at + 1])
        if at + 1 < batch.labels.shape[1]:
            assert (after[:, at + 1] - before[:, at + 1]).abs().max() > 1e-4, at


def test_the_decoder_starts_with_the_start_and_reads_what_was_said() -> None:
    batch = _examples().chunk(3, 2, np.random.default_rng(0))
    unknown = _with_label(batch, 4, -100)
    _, said, mask, labels = train._inputs(unknown, CPU, VOCAB)
    assert mask is None and (labels.numpy() == unknown.labels).all()
    assert (said[:, 0] == VOCAB["decoder_start"]).all()
    expected = np.where(unknown.labels == -100, 0, unknown.labels)[:, :-1]
    assert (said[:, 1:].numpy() == expected).all()


@torch.no_grad()
def test_nothing_is_learned_where_nothing_is_asked() -> None:
    model, batch = _model(), _examples().chunk(4, 2, np.random.default_rng(0))
    # The last label, so that the decoder's input stays the same.
    _, logits, labels = train.loss_of(model, batch, CPU)
    expected = torch.nn.functional.cross_entropy(logits[:, :-1].flatten(0, 1), labels[:, :-1].flatten())
    loss, _, _ = train.loss_of(model, _with_label(batch, -1, -100), CPU)
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)


class _Recorded:
    """Inputs of the networks in one step of a stage, and the loss that was differentiated."""

    def __init__(self, plan: StagePlan, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.model, examples = _model(), _examples()
        self.inputs: tuple[Tensor, ...] = ()
        self.batch: Batch | None = None
        self.total = float("nan")
        forward, backward, draws = train.Outputs.forward, train.Accelerator.backward, train.draws

        def record_inputs(module: train.Outputs, *inputs: Tensor) -> tuple[Tensor, ...]:
            self.inputs = inputs
            return forward(module, *inputs)

        def record_total(accelerator: object, total: Tensor) -> None:
            self.total = total.item()
            backward(accelerator, total)

        def record_batch(plan: StagePlan, examples: Examples) -> dict[str, train.Draw]:
            def recording(draw: train.Draw) -> train.Draw:
                def drawn(rng: np.random.Generator) -> Batch:
                    self.batch = draw(rng)
                    return self.batch

                return drawn

            return {name: recording(draw) for name, draw in draws(plan, examples).items()}

        with monkeypatch.context() as patch:
            patch.setattr(train.Outputs, "forward", record_inputs)
            patch.setattr(train.Accelerator, "backward", record_total)
            patch.setattr(train, "draws", record_batch)
            # With a rate of 0 the model stays unchanged, so that the loss can be recomputed.
            train.train_stage(replace(plan, rate=0.0, decay=0.0), self.model, examples, examples, folder)


def test_padding_is_hidden_from_the_encoder_and_the_decoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step = _Recorded(_plan(tasks={"a2m_prompted": 1}), tmp_path, monkeypatch)
    ids, said, mask, _ = step.inputs
    assert step.batch is not None and step.batch.mask is not None and not step.batch.mask.all()
    assert (mask.numpy() == step.batch.mask).all(), "the step passes the batch's mask on"
    other = torch.where(mask, ids, 77)
    assert (other != ids).any()
    for module in (train.Outputs(step.model, balanced=False), lambda *inputs: step.model(*inputs[:3])):
        with torch.no_grad():
            first, second = (module(given, said, mask, None) for given in (ids, other))
        first, second = (out[0] if isinstance(out, tuple) else out for out in (first, second))
        torch.testing.assert_close(first, second)
    loss, _, _ = train.loss_of(step.model, step.batch, CPU)
    padded = replace(step.batch, ids=np.where(step.batch.mask, step.batch.ids, 77))
    assert train.loss_of(step.model, padded, CPU)[0].item() == pytest.approx(loss.item(), rel=1e-5)


@pytest.mark.parametrize("weights", [(0.0, 0.0), (0.25, 0.0), (0.0, 0.5), (0.25, 0.5)])
def test_the_loss_is_the_sum_of_its_weighted_parts(
    weights: tuple[float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    balance, heard = weights
    step = _Recorded(_plan(balance=balance, heard=heard), tmp_path, monkeypatch)
    batch, model = step.batch, step.model
    assert batch is not None and batch.heard is not None and (batch.heard != -100).any()
    with torch.no_grad():
        ids, labels = torch.from_numpy(batch.ids), torch.from_numpy(batch.labels)
        start = torch.full_like(labels[:, :1], VOCAB["decoder_start"])
        hidden = model.encode(ids)
        logits = model.head(model.decode(hidden, torch.cat([start, labels[:, :-1].clamp(min=0)], 1)))
        asked = labels != -100
        codes = torch.nn.functional.cross_entropy(logits[asked], labels[asked]).item()
        balancing = moe.balance(model).item()
        places = torch.from_numpy(batch.heard)
        guess = torch.log_softmax(model.head(hidden), -1)[places != -100]
        own = -guess.gather(1, places[places != -100][:, None]).mean().item()
    assert balancing > 0.1 and own > 0.1, "both parts are large enough to be missed"
    assert step.total == pytest.approx(codes + balance * balancing + heard * own, rel=1e-5)


def _port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def _one_of_two(rank: int, port: int, folder: str) -> None:
    """Trains one step as one of two processes; keeps its batch and its gradients."""
    os.environ |= {
        "RANK": str(rank),
        "LOCAL_RANK": str(rank),
        "WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(port),
        "ACCELERATE_USE_CPU": "true",
        "OMP_NUM_THREADS": "1",
    }
    torch.set_num_threads(1)
    kept: dict[str, object] = {}
    step, draws = train.Master.step, train.draws

    def keep_gradients(optimizer: train.Master, closure: None = None) -> None:
        kept["gradients"] = [None if p.grad is None else p.grad.clone() for p in optimizer.model]
        step(optimizer, closure)

    def keep_batch(plan: StagePlan, examples: Examples) -> dict[str, train.Draw]:
        def keeping(rng: np.random.Generator) -> Batch:
            batch = draws(plan, examples)["a2m"](rng)
            kept["ids"], kept["labels"], kept["heard"] = (
                torch.from_numpy(v) for v in (batch.ids, batch.labels, batch.heard)
            )
            return batch

        return {"a2m": keeping}

    train.Master.step, train.draws = keep_gradients, keep_batch
    model = train.train_stage(_plan(heard=0.5, balance=0.0), _model(), _examples(), _examples(), Path(folder))
    kept["weights"] = [p.detach().clone() for p in model.parameters()]
    torch.save(kept, Path(folder) / f"rank{rank}.pt")
    if torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


def test_two_processes_see_different_batches_and_average_their_gradients(tmp_path: Path) -> None:
    torch.multiprocessing.spawn(_one_of_two, (_port(), str(tmp_path)), nprocs=2)
    first, second = (torch.load(tmp_path / f"rank{rank}.pt", weights_only=True) for rank in range(2))
    assert not torch.equal(first["labels"], second["labels"]), "each process draws a different batch"

    gradients = []
    for kept in (first, second):
        model = _model()
        outputs = train.Outputs(model, balanced=False)
        batch = Batch(kept["ids"].numpy(), None, kept["labels"].numpy())
        ids, said, mask, labels = train._inputs(batch, CPU, model.vocab)
        logits, heard, _ = outputs(ids, said, mask, kept["heard"])
        (train._entropy(logits, labels) + 0.5 * heard).backward()
        gradients.append([p.grad for p in model.parameters() if p.requires_grad])
    joined = 0
    for one, other, *own in zip(first["gradients"], second["gradients"], *gradients, strict=True):
        grads = [torch.zeros_like(one) if g is None else g for g in own]
        torch.testing.assert_close(one, sum(grads) / 2, rtol=1e-4, atol=1e-6)
        assert torch.equal(one, other), "both continue with the same gradients"
        joined += int((grads[0] - grads[1]).abs().max() > 1e-5)
    assert joined > 10, "the batches' own gradients differ"
    for one, other in zip(first["weights"], second["weights"], strict=True):
        assert torch.equal(one, other)
