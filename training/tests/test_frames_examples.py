"""Examples of layout `frames`: inputs, targets, and masking."""

import numpy as np
import pytest

from frames_data import AUDIO, BODY, CONFIG, COUNTS, PARTS, SLOTS, at
from umo_train.frames.examples import FrameExamples, FrameStream

SILENCE, TOKENS, PREFIX, AHEAD = 3, 5, CONFIG["prefix"], CONFIG["audio"]["ahead"]
SIZE = CONFIG["vocab"]["size"]


def _stream(frames: int = 90, prompts: bool = True) -> FrameStream:
    """Codes that identify their keyframe, and units that identify theirs."""
    codes = np.repeat(np.arange(frames)[:, None] // 3, SLOTS, 1) % COUNTS
    units = (np.arange(frames * 5 // 3)[None] // TOKENS) % 20
    texts = (np.zeros(0, np.int64), np.array([21, 22]), np.array([23])) if prompts else ()
    return FrameStream(codes, units, texts)


def _examples(**options: bool) -> FrameExamples:
    return FrameExamples(CONFIG, PARTS, BODY, [_stream()], SILENCE, **options)


def _audio(ids: np.ndarray) -> np.ndarray:
    """A row's audio, without its markers."""
    row = ids.tolist()
    return ids[row.index(AUDIO["start"]) + 1 : row.index(AUDIO["end"])]


def _keyframe(batch_codes: np.ndarray) -> np.ndarray:
    """Index of the keyframe that rows of codes belong to, from those of 13 and of 12 codes."""
    thirteen, twelve = batch_codes[..., at("intent").start], batch_codes[..., at("mouth").start]
    every = np.arange(13 * 12)
    return np.array([np.flatnonzero((every % 13 == a) & (every % 12 == b))[0] for a, b in
                     zip(thirteen.ravel(), twelve.ravel(), strict=True)]).reshape(thirteen.shape)  # fmt: skip


def test_a_chunk_is_what_follows_its_history() -> None:
    """The input is not shifted: the history ends before the chunk, and history and audio are aligned to keyframes."""
    batch = _examples(augment=False).chunk(40, 2, np.random.default_rng(0))
    inside = _keyframe(batch.codes)[:, 0] >= PREFIX
    assert inside.sum() > 20
    for ids, history, said, before in zip(
        *(x[inside] for x in (batch.ids, batch.history, batch.codes, batch.before)), strict=True
    ):
        first = _keyframe(said)[0]
        assert _keyframe(said).tolist() == [first, first + 1]
        assert _keyframe(history).tolist() == list(range(first - PREFIX, first))
        assert (before == history[-1]).all()
        audio = _audio(ids) - AUDIO["first"]
        # Every keyframe's own tokens, for all keyframes of history, chunk and lookahead.
        wanted = np.repeat(np.arange(first - PREFIX, first + 2 + AHEAD), TOKENS)
        wanted = np.where(wanted < 30, wanted % 20, SILENCE)
        assert audio.tolist() == wanted.tolist()
        assert [i for i in ids if i >= SIZE] == list(range(SIZE, SIZE + PREFIX))


def test_what_is_heard_is_the_keyframes_own_audio() -> None:
    examples = FrameExamples(CONFIG, PARTS, BODY, [_stream()], SILENCE, augment=False, delay=4)
    batch = examples.chunk(30, 2, np.random.default_rng(1))
    rows = [i for i in range(30) if _keyframe(batch.codes)[i, 0] >= 0]
    for i in rows:
        found = batch.ids[i, batch.heard] - AUDIO["first"]
        assert found.tolist() == [k % 20 for k in _keyframe(batch.codes)[i]]
        # With a delay of 4, the last of a keyframe's five tokens.
        after = batch.ids[i, batch.heard + 1] - AUDIO["first"]
        assert (after != found).all()


def test_before_an_item_is_rest_and_behind_it_nothing_is_asked() -> None:
    examples = FrameExamples(CONFIG, PARTS, BODY, [_stream(frames=6)], SILENCE, augment=False)
    batch = examples.chunk(8, 4, np.random.default_rng(0))
    assert (batch.history == examples.rest).all() and (batch.before == examples.rest).all()
    assert (batch.codes[:, 2:] == -1).all() and (batch.codes[:, :2] >= 0).all()


def test_the_bodys_history_is_hidden_in_a_third() -> None:
    batch = _examples().chunk(3000, 1, np.random.default_rng(0))
    body = np.repeat(BODY, [part.levels for part in PARTS])
    hidden = (batch.history[..., body] == -1).all((1, 2))
    assert hidden.mean() == pytest.approx(1 / 3, abs=0.03)
    # All of it or nothing, and never the face's; targets stay unchanged.
    assert ((batch.history[..., body] == -1).any((1, 2)) == hidden).all()
    assert (batch.history[..., ~body] >= 0).all() and (batch.codes >= 0).all()


def test_audio_behind_the_chunk_is_hidden_in_a_third() -> None:
    batch = _examples().chunk(3000, 2, np.random.default_rng(0))
    behind = np.stack([_audio(ids) for ids in batch.ids]) == AUDIO["mask"]
    # Never within the chunk, and from some keyframe to the end.
    assert not behind[:, : (PREFIX + 2) * TOKENS].any()
    count = behind.sum(1)
    assert (count % TOKENS == 0).all()
    assert all(row[len(row) - n :].all() for row, n in zip(behind, count, strict=True))
    share = np.bincount(count // TOKENS, minlength=AHEAD + 1) / 3000
    np.testing.assert_allclose(share, [2 / 3, 1 / 9, 1 / 9, 1 / 9], atol=0.03)


def test_prompts_are_left_out_in_a_third() -> None:
    batch = _examples().chunk(2000, 2, np.random.default_rng(0))
    texts = []
    for ids in batch.ids:
        row = ids.tolist()
        first, last = row.index(10), row.index(11)
        texts.append(tuple(row[first + 1 : last]))
        assert row[last + 1 : last + 1 + PREFIX] == list(range(SIZE, SIZE + PREFIX))
    counts = {text: texts.count(text) / 2000 for text in set(texts)}
    assert set(counts) == {(), (21, 22), (23,)}
    assert counts[()] == pytest.approx(1 / 3, abs=0.03)


def test_histories_get_errors_and_short_ones_come_with_silence() -> None:
    batch = _examples().chunk(2000, 2, np.random.default_rng(0))
    rest = np.concatenate([entry["rest"] for entry in CONFIG["parts"]])
    inside = np.array([_audio(ids)[0] - AUDIO["first"] == SILENCE for ids in batch.ids])
    face = ~np.repeat(BODY, [part.levels for part in PARTS])
    rests = (batch.history[:, 0][:, face] == rest[face]).all(1)
    # If the first keyframe rests and was not changed since, the audio there is silent.
    assert (rests & inside).sum() > 0.8 * rests.sum() > 50
    assert batch.history.max() < 13 and (batch.history < COUNTS).all()


def test_held_out_examples_are_as_they_are() -> None:
    batch = _examples(augment=False).chunk(200, 2, np.random.default_rng(0))
    assert (batch.history >= 0).all() and not (batch.ids == AUDIO["mask"]).any()


def test_text_to_motion_has_no_audio_and_mostly_a_prompt() -> None:
    batch = _examples().chunk(2000, 2, np.random.default_rng(0), task="t2m")
    assert batch.heard is None and not (batch.ids == AUDIO["start"]).any()
    empty = [row.index(11) == row.index(10) + 1 for row in batch.ids.tolist()]
    assert np.mean(empty) == pytest.approx(1 / 8, abs=0.03)
    exact = _examples(augment=False).chunk(50, 2, np.random.default_rng(0), task="t2m")
    assert not any(row.index(11) == row.index(10) + 1 for row in exact.ids.tolist())


def test_half_of_an_actions_chunks_have_its_beginning() -> None:
    stream = _stream()
    stream.codes = np.arange(900)[:, None] + np.zeros((1, len(COUNTS)), int)
    stream.begins = (200,)
    examples = FrameExamples(CONFIG, PARTS, BODY, [stream], SILENCE)
    # The body starts before the arms do.
    wanted = (200 - FrameExamples.AHEAD_OF_ARMS) * examples.stride
    for task, share in (("t2m", 0.5), ("a2m", 0.0)):
        said = examples.chunk(1000, 4, np.random.default_rng(1), task=task).codes
        assert (said[..., 0] == wanted).any(1).mean() == pytest.approx(share, abs=0.06)


def test_a_task_without_data_says_so() -> None:
    examples = FrameExamples(CONFIG, PARTS, BODY, [FrameStream(None, np.zeros((1, 9), int))], SILENCE)
    with pytest.raises(ValueError, match="no item has codes and units"):
        examples.chunk(2, 1, np.random.default_rng(0))
    unprompted = FrameExamples(CONFIG, PARTS, BODY, [_stream(prompts=False)], SILENCE)
    with pytest.raises(ValueError, match="no item has codes and prompt"):
        unprompted.chunk(2, 1, np.random.default_rng(0), task="t2m")


def test_who_is_told_is_always_told() -> None:
    """An action's prompt is never left out; for motion from text alone, actions are sampled by their weight."""
    told = FrameStream(*(getattr(_stream(), name) for name in ("codes", "units", "prompts")), told=True, weight=9.0)
    told.prompts = (np.array([24]),)
    examples = FrameExamples(CONFIG, PARTS, BODY, [told], SILENCE)
    assert all(24 in ids for ids in examples.chunk(300, 1, np.random.default_rng(0)).ids)
    both = FrameExamples(CONFIG, PARTS, BODY, [_stream(), told], SILENCE)
    share = {
        task: np.mean([24 in ids for ids in both.chunk(2000, 1, np.random.default_rng(0), task=task).ids])
        for task in ("a2m", "t2m")
    }
    assert share["a2m"] == pytest.approx(0.5, abs=0.05)
    assert share["t2m"] == pytest.approx(0.9 * 7 / 8, abs=0.03)
