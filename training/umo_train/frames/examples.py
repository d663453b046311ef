"""Examples of layout `frames` (SPEC 2.13, 2.15, 2.16): a chunk after a history, from audio or text."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo_train.frames.parts import Part

Config = dict[str, Any]
_NOTHING = np.zeros(0, np.int64)
# What an item must have to be drawn for a task.
NEEDS: dict[str, tuple[str, ...]] = {"a2m": ("codes", "units"), "t2m": ("codes", "prompt")}


@dataclass
class FrameStream:
    """One item: codes of every frame `[frames, J]`, -1 where a part did not move; `units` `[recordings, tokens]`; ids
    of its prompts. An item without motion or without speech has none. Of an item that is `told`, nobody would do what
    it shows without its prompt, which speech is never without. `begins` are keyframes at which an action begins."""

    codes: np.ndarray | None
    units: np.ndarray | None
    prompts: tuple[np.ndarray, ...] = ()
    told: bool = False
    # How often it is drawn for `t2m`, beside others of its length.
    weight: float = 1.0
    begins: tuple[int, ...] = ()

    def has(self, what: str) -> bool:
        if what == "prompt":
            return any(len(prompt) for prompt in self.prompts)
        return getattr(self, what) is not None


@dataclass
class FrameBatch:
    """`ids` `[b, n]` and which count; the history's codes `[b, P, J]`, -1 where hidden; the codes to say `[b, N, J]`,
    -1 where nothing is asked, and those of the keyframe before them `[b, J]`; the places in `ids` of the audio tokens
    that say most of each keyframe `[N]`, if there is audio."""

    ids: np.ndarray
    mask: np.ndarray | None
    history: np.ndarray
    codes: np.ndarray
    before: np.ndarray
    heard: np.ndarray | None = None


class FrameExamples:
    """Draws batches of a task; every example of a batch has the same shape but for its prompt."""

    # Shares of the examples of which the body's history is hidden, the prompt is left out, or audio behind the chunk is
    # hidden. What the body does then follows from what is heard, not from what it did.
    HIDDEN, UNPROMPTED, UNHEARD = 1 / 3, 1 / 3, 1 / 3
    # From text alone: of which the prompt is left out, and of an action's those in which it begins. Who is asked for an
    # action is to begin with it, not to stand as long as somebody does who repeats it.
    WORDLESS, BEGINNING = 1 / 8, 1 / 2
    # Keyframes by which somebody who goes over to an action begins before his arms do.
    AHEAD_OF_ARMS = 4
    # Shares of which history is cut short, or codes of it are replaced, and of how many.
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
        """`body` says of each part whether it is of the body (not of the face); `delay` in tokens is how late units say
        what they say."""
        self.config, self.parts, self.streams, self.silence = config, parts, streams, silence
        self.augment = augment
        self.vocab: Config = config["vocab"]
        self.stride, self.prefix = config["keyframe_stride"], config["prefix"]
        self.ahead: int = config["audio"].get("ahead", 0)
        rate = config["audio"]["token_rate"]
        # A keyframe's audio tokens; the config holds only for whole ones.
        self.tokens = self.stride * rate // config["frame_rate"]
        self.middle = heard_token(config, delay)
        self.rest = np.concatenate([entry["rest"] for entry in config["parts"]]).astype(np.int64)
        self.body = np.repeat(body, [part.levels for part in parts])
        self.counts = np.repeat([part.codes for part in parts], [part.levels for part in parts])
        self.pools: dict[str, tuple[list[FrameStream], np.ndarray]] = {}

    def _streams(self, count: int, rng: np.random.Generator, task: str) -> list[FrameStream]:
        if task not in self.pools:
            fit = [stream for stream in self.streams if all(map(stream.has, NEEDS[task]))]
            if not fit:
                raise ValueError(f"no item has {' and '.join(NEEDS[task])}, which the task `{task}` needs")
            lengths = np.array([len(x.codes) * (x.weight if task == "t2m" else 1.0) for x in fit])
            self.pools[task] = fit, lengths / lengths.sum()
        streams, chance = self.pools[task]
        return [streams[i] for i in rng.choice(len(streams), count, p=chance)]

    def chunk(self, count: int, target: int, rng: np.random.Generator, *, task: str = "a2m") -> FrameBatch:
        """A chunk of `target` keyframes after the prefix, from audio (`a2m`), with a prompt or without, or from a
        prompt alone (`t2m`)."""
        inputs, histories, said, before = [], [], [], []
        template = "audio_to_motion" if task == "a2m" else "text_to_motion"
        for stream in self._streams(count, rng, task):
            keys = stream.codes[:: self.stride].astype(np.int64)
            at = self._first(stream, len(keys), target, rng, task)
            # The keyframes before the chunk: the chunk's own are what is to be said.
            history = _rows(keys, at - self.prefix, self.prefix, self.rest)
            before.append(history[-1].copy())
            audio = self._audio(stream, at, target, rng) if task == "a2m" else _NOTHING
            if self.augment:
                history, audio = self._worse(history, audio, rng)
            prompt = self._prompt(stream, rng, task)
            inputs.append(self._fill(template, audio, prompt))
            histories.append(history)
            said.append(_rows(keys, at, target, np.full(len(self.rest), -1)))
        ids, mask = _stack(inputs)
        batch = FrameBatch(ids, mask, np.stack(histories), np.stack(said), np.stack(before))
        if task == "a2m":
            first = self.config["templates"][template].index("audio") + 1
            batch.heard = first + (self.prefix + np.arange(target)) * self.tokens + self.middle
        return batch

    def _first(self, stream: FrameStream, keyframes: int, target: int, rng: np.random.Generator, task: str) -> int:
        """The chunk's first keyframe."""
        if task == "t2m" and self.augment and stream.begins and rng.random() < self.BEGINNING:
            begins = stream.begins[rng.integers(len(stream.begins))] - self.AHEAD_OF_ARMS
            return max(begins - int(rng.integers(target)), 0)
        return int(rng.integers(0, max(keyframes - target, 1)))

    def _audio(self, stream: FrameStream, at: int, target: int, rng: np.random.Generator) -> np.ndarray:
        """Ids of the prefix', the chunk's and the audio's behind it, with markers; before an item and after it is
        silence."""
        recording = rng.integers(len(stream.units)) if self.augment else 0
        first, count = (at - self.prefix) * self.tokens, (self.prefix + target + self.ahead) * self.tokens
        units = _rows(stream.units[recording].astype(np.int64), first, count, self.silence)
        audio = self.vocab["audio"]
        ids = audio["first"] + units
        hidden = self._unheard(rng) * self.tokens
        if hidden:
            ids[-hidden:] = audio["mask"]
        return np.concatenate([[audio["start"]], ids, [audio["end"]]])

    def _unheard(self, rng: np.random.Generator) -> int:
        """How many keyframes of the audio behind the chunk a session does not wait for."""
        if not self.ahead or not self.augment or rng.random() >= self.UNHEARD:
            return 0
        return int(rng.integers(1, self.ahead + 1))

    def _worse(self, history: np.ndarray, audio: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """A history as streams have it: short, with errors, or none of the body's."""
        if rng.random() < self.SHORT:
            kept = int(rng.integers(0, self.prefix))
            history[: self.prefix - kept] = self.rest
            if len(audio):
                audio[1 : 1 + (self.prefix - kept) * self.tokens] = self.vocab["audio"]["first"] + self.silence
        if rng.random() < self.NOISY:
            replaced = rng.random(history.shape) < self.REPLACED
            history = np.where(replaced, rng.integers(0, self.counts, history.shape), history)
        if rng.random() < self.HIDDEN:
            history[:, self.body] = -1
        return history, audio

    def _prompt(self, stream: FrameStream, rng: np.random.Generator, task: str) -> np.ndarray:
        """One of an item's prompts, or nothing, as in the row that guidance goes away from."""
        prompts = [prompt for prompt in stream.prompts if len(prompt)]
        share = self.WORDLESS if task == "t2m" else 0.0 if stream.told else self.UNPROMPTED
        dropped = self.augment and rng.random() < share
        return prompts[rng.integers(len(prompts))] if prompts and not dropped else _NOTHING

    def _fill(self, template: str, audio: np.ndarray, text: np.ndarray) -> np.ndarray:
        """The template's ids with everything in its place."""
        places = {"audio": audio, "text": text, "history": self.vocab["size"] + np.arange(self.prefix)}
        entries = self.config["templates"][template]
        return np.concatenate([[entry] if isinstance(entry, int) else places[entry] for entry in entries])


def heard_token(config: Config, delay: int | None) -> int:
    """Which of a keyframe's audio tokens says it; units say what they say `delay` tokens late."""
    tokens = config["keyframe_stride"] * config["audio"]["token_rate"] // config["frame_rate"]
    return int(tokens // 2 if delay is None else min(delay, tokens - 1))


def _rows(rows: np.ndarray, first: int, count: int, fill: np.ndarray | int) -> np.ndarray:
    """`rows[first : first + count]`, `fill` outside of them."""
    out = np.empty((count, *rows.shape[1:]), np.int64)
    out[:] = fill
    low, high = max(first, 0), min(first + count, len(rows))
    if high > low:
        out[low - first : high - first] = rows[low:high]
    return out


def _stack(inputs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray | None]:
    """Rows of one length, and which of their ids count, if not all do."""
    ids = np.zeros((len(inputs), max(map(len, inputs))), np.int64)
    mask = np.zeros(ids.shape, bool)
    for row, values, kept in zip(inputs, ids, mask, strict=True):
        values[: len(row)], kept[: len(row)] = row, True
    return ids, None if mask.all() else mask
