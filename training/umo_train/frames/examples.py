"""Examples of layout `frames` (SPEC 2.13, 2.15, 2.16): a chunk after a history, from audio or text."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo_train.frames.parts import Part

Config = dict[str, Any]
_NOTHING = np.zeros(0, np.int64)
# Data that an item needs for a task.
NEEDS: dict[str, tuple[str, ...]] = {"a2m": ("codes", "units"), "t2m": ("codes", "prompt")}


@dataclass
class FrameStream:
    """One item: codes of every frame `[frames, J]`, -1 where a part did not move; `units` `[recordings, tokens]`; ids
    of its prompts. Items without motion or speech have none. If an item is `told`, nobody would do its motion
    without the prompt, which is then never left out. `begins` are keyframes at which an action begins."""

    codes: np.ndarray | None
    units: np.ndarray | None
    prompts: tuple[np.ndarray, ...] = ()
    told: bool = False
    # Sampling weight for `t2m`, relative to others of its length.
    weight: float = 1.0
    begins: tuple[int, ...] = ()
    # Whether the voice is a person's recording and not a synthesiser.
    person: bool = False

    def has(self, what: str) -> bool:
        if what == "prompt":
            return any(len(prompt) for prompt in self.prompts)
        return getattr(self, what) is not None


@dataclass
class FrameBatch:
    """`ids` `[b, n]` and their mask; the history's codes `[b, P, J]`, -1 if hidden; the target codes `[b, N, J]`, -1
    without a target, and those of the keyframe before them `[b, J]`; the positions in `ids` of the audio tokens that
    carry most information about each keyframe `[N]`, if there is audio."""

    ids: np.ndarray
    mask: np.ndarray | None
    history: np.ndarray
    codes: np.ndarray
    before: np.ndarray
    heard: np.ndarray | None = None


@dataclass
class Pool:
    """Data of a task: all its items concatenated, and their starts, so that drawing a batch takes a few array
    operations instead of a loop over its examples."""

    chance: np.ndarray
    # Keyframes `[K, J]`, audio units `[n]` of all recordings, ids of the prompts `[m, longest]`.
    keys: np.ndarray
    units: np.ndarray
    prompts: np.ndarray
    # For each item: its first row in `keys`, their number, its first unit, units per recording, number of recordings.
    first: np.ndarray
    keyframes: np.ndarray
    heard: np.ndarray
    tokens: np.ndarray
    recordings: np.ndarray
    # Whether its prompt is never left out.
    told: np.ndarray
    # Its first non-empty prompt and their number; lengths of all prompts, padded with 0.
    texts: np.ndarray
    texts_count: np.ndarray
    lengths: np.ndarray
    # Keyframes at which actions begin, of all items; its first of them, and their number.
    begins: np.ndarray
    starts: np.ndarray
    starts_count: np.ndarray

    @staticmethod
    def of(streams: list[FrameStream], chance: np.ndarray, stride: int) -> "Pool":
        keys = [stream.codes[::stride].astype(np.int16) for stream in streams]
        units = [_NOTHING[None] if stream.units is None else stream.units for stream in streams]
        prompts = [[prompt for prompt in stream.prompts if len(prompt)] for stream in streams]
        every = [prompt for its in prompts for prompt in its]
        table = np.zeros((len(every) + 1, max(map(len, every), default=0)), np.int64)
        for row, prompt in zip(table, every, strict=False):
            row[: len(prompt)] = prompt
        return Pool(
            chance=chance,
            keys=np.concatenate(keys),
            units=np.concatenate([one.ravel() for one in units]).astype(np.int16),
            prompts=table,
            first=_firsts([len(one) for one in keys]),
            keyframes=np.array([len(one) for one in keys]),
            heard=_firsts([one.size for one in units]),
            tokens=np.array([one.shape[1] for one in units]),
            recordings=np.array([len(one) for one in units]),
            told=np.array([stream.told for stream in streams]),
            texts=_firsts([len(its) for its in prompts]),
            texts_count=np.array([len(its) for its in prompts]),
            lengths=np.array([*map(len, every), 0]),
            begins=np.array([at for stream in streams for at in stream.begins] + [0]),
            starts=_firsts([len(stream.begins) for stream in streams]),
            starts_count=np.array([len(stream.begins) for stream in streams]),
        )


class FrameExamples:
    """Draws batches of a task; all examples of a batch have the same shape except for the prompt."""

    # Shares of examples with hidden body history, without prompt, and with hidden lookahead audio. The body then
    # follows from the audio instead of its own past.
    HIDDEN, UNPROMPTED, UNHEARD = 1 / 3, 1 / 3, 1 / 3
    # From text alone: shares without prompt, and, for actions, of chunks in which the action begins. A prompted action
    # should start at once, and not after the rest between repetitions.
    WORDLESS, BEGINNING = 1 / 8, 1 / 2
    # Number of keyframes by which the body's transition to an action precedes the arms'.
    AHEAD_OF_ARMS = 4
    # Shares of examples with a shortened history or replaced codes, and the share of replaced codes.
    SHORT, NOISY, REPLACED = 0.12, 0.3, 0.12

    def __init__(
        self,
        config: Config,
        parts: list[Part],
        body: list[bool],
        streams: list[FrameStream],
        silence: int,
        *,
        augment: bool = True,
        delay: int | None = None,
    ) -> None:
        """`body` tells whether each part belongs to the body (not the face); `delay` is the units' delay in tokens."""
        self.config, self.parts, self.streams, self.silence = config, parts, streams, silence
        self.augment = augment
        self.vocab: Config = config["vocab"]
        self.stride, self.prefix = config["keyframe_stride"], config["prefix"]
        self.ahead: int = config["audio"].get("ahead", 0)
        rate = config["audio"]["token_rate"]
        # Audio tokens per keyframe; the config ensures a whole number.
        self.tokens = self.stride * rate // config["frame_rate"]
        self.middle = heard_token(config, delay)
        self.rest = np.concatenate([entry["rest"] for entry in config["parts"]]).astype(np.int64)
        self.body = np.repeat(body, [part.levels for part in parts])
        self.counts = np.repeat([part.codes for part in parts], [part.levels for part in parts])
        self.pools: dict[str, Pool] = {}

    def _pool(self, task: str) -> Pool:
        if task not in self.pools:
            fit = [stream for stream in self.streams if all(map(stream.has, NEEDS[task]))]
            if not fit:
                raise ValueError(f"no item has {' and '.join(NEEDS[task])}, which the task `{task}` needs")
            lengths = np.array([len(x.codes) * (x.weight if task == "t2m" else 1.0) for x in fit])
            self.pools[task] = Pool.of(fit, lengths / lengths.sum(), self.stride)
        return self.pools[task]

    def chunk(self, count: int, target: int, rng: np.random.Generator, *, task: str = "a2m") -> FrameBatch:
        """A chunk of `target` keyframes after the prefix, from audio (`a2m`), with or without a prompt, or from a
        prompt alone (`t2m`)."""
        pool = self._pool(task)
        item = rng.choice(len(pool.chance), count, p=pool.chance)
        at = self._first(pool, item, target, rng, task)
        rows = at[:, None] + np.arange(-self.prefix, target)
        inside = (rows >= 0) & (rows < pool.keyframes[item][:, None])
        codes = pool.keys[np.where(inside, pool.first[item][:, None] + rows, 0)].astype(np.int64)
        # The keyframes before the chunk; the chunk's own are the targets.
        history = np.where(inside[:, : self.prefix, None], codes[:, : self.prefix], self.rest)
        said = np.where(inside[:, self.prefix :, None], codes[:, self.prefix :], -1)
        before = history[:, -1].copy()
        audio = self._audio(pool, item, at, target, rng) if task == "a2m" else None
        if self.augment:
            history = self._worse(history, audio, rng)
        template = "audio_to_motion" if task == "a2m" else "text_to_motion"
        ids, mask = self._fill(template, audio, *self._prompt(pool, item, rng, task))
        batch = FrameBatch(ids, mask, history, said, before)
        if task == "a2m":
            first = self.config["templates"][template].index("audio") + 1
            batch.heard = first + (self.prefix + np.arange(target)) * self.tokens + self.middle
        return batch

    def _first(self, pool: Pool, item: np.ndarray, target: int, rng: np.random.Generator, task: str) -> np.ndarray:
        """First keyframes of the chunks."""
        at = _one_of(np.maximum(pool.keyframes[item] - target, 1), rng)
        if task != "t2m" or not self.augment:
            return at
        begins = pool.begins[pool.starts[item] + _one_of(pool.starts_count[item], rng)] - self.AHEAD_OF_ARMS
        beginning = (rng.random(len(item)) < self.BEGINNING) & (pool.starts_count[item] > 0)
        return np.where(beginning, np.maximum(begins - rng.integers(target, size=len(item)), 0), at)

    def _audio(self, pool: Pool, item: np.ndarray, at: np.ndarray, target: int, rng: np.random.Generator) -> np.ndarray:
        """Ids of the audio of prefix, chunk and lookahead, with markers; silence before and after an item."""
        recording = _one_of(pool.recordings[item], rng) if self.augment else np.zeros_like(item)
        count = (self.prefix + target + self.ahead) * self.tokens
        rows = (at[:, None] - self.prefix) * self.tokens + np.arange(count)
        length = pool.tokens[item]
        inside = (rows >= 0) & (rows < length[:, None])
        own = (pool.heard[item] + recording * length)[:, None]
        units = np.where(inside, pool.units[np.where(inside, own + rows, 0)], self.silence)
        audio = self.vocab["audio"]
        hidden = self._unheard(len(item), rng) * self.tokens
        ids = np.where(np.arange(count) >= count - hidden[:, None], audio["mask"], audio["first"] + units)
        return np.pad(ids, ((0, 0), (1, 1)), constant_values=((0, 0), (audio["start"], audio["end"])))

    def _unheard(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Number of lookahead keyframes that a session does not wait for."""
        if not self.ahead or not self.augment:
            return np.zeros(count, np.int64)
        return np.where(rng.random(count) < self.UNHEARD, rng.integers(1, self.ahead + 1, count), 0)

    def _worse(self, history: np.ndarray, audio: np.ndarray | None, rng: np.random.Generator) -> np.ndarray:
        """Histories as in streams: short, with errors, or without the body's. The audio of a short one is silenced too,
        in place."""
        count = len(history)
        cut = np.where(rng.random(count) < self.SHORT, self.prefix - rng.integers(0, self.prefix, count), 0)
        history = np.where((np.arange(self.prefix) < cut[:, None])[..., None], self.rest, history)
        if audio is not None:
            past = audio[:, 1 : 1 + self.prefix * self.tokens]
            silent = np.arange(past.shape[1]) < (cut * self.tokens)[:, None]
            past[silent] = self.vocab["audio"]["first"] + self.silence
        replaced = (rng.random(count) < self.NOISY)[:, None, None] & (rng.random(history.shape) < self.REPLACED)
        history = np.where(replaced, rng.integers(0, self.counts, history.shape), history)
        hidden = (rng.random(count) < self.HIDDEN)[:, None] & self.body
        return np.where(hidden[:, None], -1, history)

    def _prompt(
        self, pool: Pool, item: np.ndarray, rng: np.random.Generator, task: str
    ) -> tuple[np.ndarray, np.ndarray]:
        """One of each item's prompts, `[b, longest]`, and its length: 0 as in the unprompted row of guidance."""
        share = np.full(len(item), self.WORDLESS) if task == "t2m" else np.where(pool.told[item], 0, self.UNPROMPTED)
        kept = pool.texts_count[item] > 0
        if self.augment:
            kept &= rng.random(len(item)) >= share
        text = np.where(kept, pool.texts[item] + _one_of(pool.texts_count[item], rng), -1)
        return pool.prompts[text], pool.lengths[text]

    def _fill(
        self, template: str, audio: np.ndarray | None, texts: np.ndarray, lengths: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The template's ids with all slots filled, and their mask, if not all count: rows with a shorter prompt are
        padded at the end."""
        count = len(texts)
        history = np.tile(self.vocab["size"] + np.arange(self.prefix), (count, 1))
        places = {"audio": audio, "text": texts, "history": history}
        entries = self.config["templates"][template]
        columns = [np.full((count, 1), entry) if isinstance(entry, int) else places[entry] for entry in entries]
        kept = [np.ones(column.shape, bool) for column in columns]
        kept[entries.index("text")] = np.arange(texts.shape[1]) < lengths[:, None]
        ids, mask = np.concatenate(columns, 1), np.concatenate(kept, 1)
        # Move valid ids to the front.
        order = np.argsort(~mask, axis=1, kind="stable")[:, : mask.sum(1).max()]
        mask = np.take_along_axis(mask, order, 1)
        ids = np.where(mask, np.take_along_axis(ids, order, 1), 0)
        return ids, None if mask.all() else mask


def heard_token(config: Config, delay: int | None) -> int:
    """Index of the audio token of a keyframe that describes it; units are `delay` tokens late."""
    tokens = config["keyframe_stride"] * config["audio"]["token_rate"] // config["frame_rate"]
    return int(tokens // 2 if delay is None else min(delay, tokens - 1))


def _firsts(lengths: list[int]) -> np.ndarray:
    """Start of each array in the concatenation of arrays with these lengths."""
    return np.cumsum([0, *lengths])[:-1]


def _one_of(counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random number below each of `counts`; 0 if the count is 0."""
    return (rng.random(len(counts)) * counts).astype(np.int64)
