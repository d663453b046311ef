"""Examples of every task (paper 3.4): the encoder's input and the decoder's output, as token ids."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo_train.skeleton import PARTS

Config = dict[str, Any]


@dataclass
class Stream:
    """One item as codes and units. `codes` are `[4, frames]`, -1 where a part did not move; `units`
    `[recordings, tokens]`. Items without motion or speech have none."""

    codes: np.ndarray | None
    units: np.ndarray | None
    # Ids of the transcript, of a prompt, and of alternative prompts.
    text: np.ndarray
    prompt: np.ndarray
    more_prompts: tuple[np.ndarray, ...] = ()
    # First and last audio token of each id of the transcript `[ids, 2]`, if known.
    spoken: np.ndarray | None = None

    def has(self, what: str) -> bool:
        found = getattr(self, what)
        return found is not None and len(found) > 0


@dataclass
class Batch:
    """`[b, n]` ids and their mask; `[b, m]` labels, -100 without a target."""

    ids: np.ndarray
    mask: np.ndarray | None
    labels: np.ndarray
    # Face codes as ids at the audio tokens of their keyframes, as targets of the encoder; -100 elsewhere. `[b, n]`.
    heard: np.ndarray | None = None


# Data that an item needs for a task.
NEEDS: dict[str, tuple[str, ...]] = {
    "motion": ("codes",),
    "a2t": ("units", "text"),
    "t2a": ("units", "text"),
    "a2m_dense": ("codes", "units"),
    "t2m_dense": ("codes", "prompt"),
    "a2m": ("codes", "units"),
    "a2m_prompted": ("codes", "units", "prompt"),
    "part": ("codes", "units"),
}
_NOTHING = np.zeros(0, np.int64)


class Examples:
    """Draws batches of a task; all examples of a batch have the same shape except for free text."""

    # Shares of stage-2 examples with a shortened history, replaced codes, and hidden face history; share of replaced
    # codes.
    SHORT, NOISY, HIDDEN, REPLACED = 0.12, 0.3, 0.35, 0.12

    def __init__(
        self,
        config: Config,
        streams: list[Stream],
        silence: int,
        *,
        augment: bool = True,
        templates: Config | None = None,
        delay: int | None = None,
    ) -> None:
        """`templates` are of tasks that only training has; `delay` is the units' delay in tokens."""
        self.config, self.streams, self.silence, self.augment = config, streams, silence, augment
        self.templates: Config = config["templates"] | (templates or {})
        self.vocab: Config = config["vocab"]
        self.first = np.array([self.vocab[part]["first"] for part in PARTS])
        self.rest = np.array([config["rest"][part] for part in PARTS])
        self.stride, self.prefix = config["keyframe_stride"], config["prefix"]
        rate = config["audio"]["token_rate"]
        # Audio tokens per keyframe; the config ensures a whole number.
        self.tokens = self.stride * rate // config["frame_rate"]
        # Index of its audio token with the most information about a keyframe.
        self.middle = self.tokens // 2 if delay is None else min(delay, self.tokens - 1)
        self.frames_per_token = config["frame_rate"] / rate
        self.pools: dict[tuple[str, ...], tuple[list[Stream], np.ndarray]] = {}

    def _pool(self, needs: tuple[str, ...]) -> tuple[list[Stream], np.ndarray]:
        """The items with the data of a task, and their sampling probabilities by length."""
        if needs not in self.pools:
            fit = [stream for stream in self.streams if all(map(stream.has, needs))]
            if not fit:
                raise ValueError(f"no item has {' and '.join(needs)}, which a task of the plan needs: import more data")
            lengths = np.array([self._frames(stream) for stream in fit], float)
            self.pools[needs] = fit, lengths / lengths.sum()
        return self.pools[needs]

    def _frames(self, stream: Stream) -> float:
        return stream.units.shape[1] * self.frames_per_token if stream.codes is None else stream.codes.shape[1]

    def seconds(self, task: str) -> float:
        """Amount of data for a task in seconds: n in the mixture of tasks."""
        fit = [stream for stream in self.streams if all(map(stream.has, NEEDS[task]))]
        return sum(map(self._frames, fit)) / self.config["frame_rate"]

    def _streams(self, count: int, rng: np.random.Generator, task: str) -> list[Stream]:
        streams, chance = self._pool(NEEDS[task])
        return [streams[i] for i in rng.choice(len(streams), count, p=chance)]

    def _prompt(self, stream: Stream, rng: np.random.Generator) -> np.ndarray:
        """A random prompt; no random number is used if there is only one."""
        prompts = (stream.prompt, *stream.more_prompts)
        return prompts[0] if len(prompts) == 1 else prompts[rng.integers(len(prompts))]

    def _units(self, stream: Stream, first: int, count: int, rng: np.random.Generator) -> np.ndarray:
        """Audio ids with markers; silence before the first token and after the last."""
        recording = rng.integers(len(stream.units)) if self.augment else 0
        units = _slice(stream.units[recording], first, count, self.silence)
        audio = self.vocab["audio"]
        return np.concatenate([[audio["start"]], audio["first"] + units, [audio["end"]]])

    def _part(self, part: int, codes: np.ndarray) -> np.ndarray:
        name = self.vocab[PARTS[part]]
        ids = np.where(codes < 0, name["mask"], name["first"] + codes)
        return np.concatenate([[name["start"]], ids, [name["end"]]])

    def _fill(self, template: str, audio: np.ndarray | None, text: np.ndarray, parts: list[np.ndarray]) -> np.ndarray:
        """The template's ids with all slots filled."""
        places = {"audio": audio, "text": text} | dict(zip(PARTS, parts, strict=True))
        out = [np.asarray([entry]) if isinstance(entry, int) else places[entry] for entry in self.templates[template]]
        return np.concatenate(out)

    def chunk(self, count: int, target: int, rng: np.random.Generator, *, text: bool = False) -> Batch:
        """Audio to motion, a chunk of `target` keyframes after the prefix (stage 2)."""
        inputs, labels, heard = [], [], []
        template = "audio_to_motion_with_text" if text else "audio_to_motion"
        for stream in self._streams(count, rng, "a2m_prompted" if text else "a2m"):
            keys = stream.codes[:, :: self.stride]
            at = int(rng.integers(0, max(keys.shape[1] - target, 1)))
            inputs.append(self._chunk_input(stream, keys, at, target, text, rng))
            said = self.said(stream, at, target)
            labels.append(self._chunk_labels(said, 0, said.shape[1]))
            heard.append(said[0])
        batch = _stack(inputs, labels)
        batch.heard = self._heard(batch.ids.shape, np.stack(heard), template, target)
        return batch

    def said(self, stream: Stream, at: int, target: int) -> np.ndarray:
        """Target codes of the chunk of `target` keyframes from keyframe `at` on, `[4, codes]`; -1 beyond the item's
        end."""
        return np.stack([_slice(row[:: self.stride], at, target, -1) for row in stream.codes])

    def heard_at(self, target: int) -> np.ndarray:
        """Index of the window's audio token with the most information about each target code of a part."""
        return (self.prefix + np.arange(target)) * self.tokens + self.middle

    def _heard(self, shape: tuple[int, int], faces: np.ndarray, template: str, target: int) -> np.ndarray:
        """The chunk's face codes at the tokens where each is heard."""
        out = np.full(shape, -100, np.int64)
        # Task ids and the start marker precede the first audio token.
        first = self.config["templates"][template].index("audio") + 1
        at = first + self.heard_at(target)
        out[:, at] = np.where(faces < 0, -100, self.first[0] + faces)
        return out

    def _chunk_input(
        self, stream: Stream, keys: np.ndarray, at: int, target: int, text: bool, rng: np.random.Generator
    ) -> np.ndarray:
        first = at - self.prefix
        history = np.stack([_slice(keys[p], first, self.prefix, self.rest[p]) for p in range(4)])
        audio = self._units(stream, first * self.tokens, (self.prefix + target) * self.tokens, rng)
        if self.augment:
            if rng.random() < self.SHORT:
                kept = int(rng.integers(0, self.prefix))
                history[:, : self.prefix - kept] = self.rest[:, None]
                audio[1 : 1 + (self.prefix - kept) * self.tokens] = self.vocab["audio"]["first"] + self.silence
            if rng.random() < self.NOISY:
                replaced = rng.random(history.shape) < self.REPLACED
                history = np.where(replaced, rng.integers(0, self.vocab["face"]["codes"], history.shape), history)
            if rng.random() < self.HIDDEN:
                history[0] = -1
        parts = [self._part(p, history[p]) for p in range(4)]
        template = "audio_to_motion_with_text" if text else "audio_to_motion"
        return self._fill(template, audio, self._prompt(stream, rng) if text else _NOTHING, parts)

    def _chunk_labels(self, keys: np.ndarray, at: int, target: int) -> np.ndarray:
        """Labels of all parts; no targets beyond the item's end."""
        out = []
        for part in range(4):
            name = self.vocab[PARTS[part]]
            codes = _slice(keys[part], at, target, -1)
            out += [[name["start"]], np.where(codes < 0, -100, name["first"] + codes), [name["end"]]]
        return np.concatenate(out)

    def part_level(self, count: int, target: int, rng: np.random.Generator) -> Batch:
        """One part of a chunk, with the chunk's other parts given (stage 2)."""
        inputs, labels = [], []
        wanted = int(rng.integers(4))
        name = self.vocab[PARTS[wanted]]
        for stream in self._streams(count, rng, "part"):
            keys = stream.codes[:, :: self.stride]
            at = int(rng.integers(0, max(keys.shape[1] - target, 1)))
            first = at - self.prefix
            audio = self._units(stream, first * self.tokens, (self.prefix + target) * self.tokens, rng)
            parts = []
            for part in range(4):
                length = self.prefix if part == wanted else self.prefix + target
                parts.append(self._part(part, _slice(keys[part], first, length, self.rest[part])))
            inputs.append(self._fill("audio_to_motion", audio, _NOTHING, parts))
            codes = _slice(keys[wanted], at, target, -1)
            ids = np.where(codes < 0, -100, name["first"] + codes)
            labels.append(np.concatenate([[name["start"]], ids, [name["end"]]]))
        return _stack(inputs, labels)

    def dense(self, count: int, frames: int, rng: np.random.Generator, *, source: str) -> Batch:
        """Every frame of a window, from audio (`a2m`) or from text (`t2m`), after a short prefix (stage 1)."""
        inputs, labels = [], []
        for stream in self._streams(count, rng, "a2m_dense" if source == "audio" else "t2m_dense"):
            length = stream.codes.shape[1]
            at = int(rng.integers(0, max((length - frames) // self.stride, 1))) * self.stride
            before = [_slice(stream.codes[p], at - self.prefix, self.prefix, self.rest[p]) for p in range(4)]
            parts = [self._part(p, before[p]) for p in range(4)]
            if source == "audio":
                count_tokens = frames * self.tokens // self.stride
                audio = self._units(stream, at * self.tokens // self.stride, count_tokens, rng)
                inputs.append(self._fill("audio_to_motion", audio, _NOTHING, parts))
            else:
                inputs.append(self._fill("text_to_motion", None, self._prompt(stream, rng), parts))
            labels.append(self._chunk_labels(stream.codes, at, frames))
        return _stack(inputs, labels)

    def motion(self, count: int, target: int, rng: np.random.Generator) -> Batch:
        """Masked keyframe modelling: keyframes of a window hidden at random, all of them targets (pre-training)."""
        inputs, labels = [], []
        template = "motion_to_motion" if "motion_to_motion" in self.templates else "text_to_motion"
        for stream in self._streams(count, rng, "motion"):
            keys = stream.codes[:, :: self.stride]
            at = int(rng.integers(0, max(keys.shape[1] - target, 1)))
            seen = np.stack([_slice(keys[p], at, target, self.rest[p]) for p in range(4)])
            seen = np.where(rng.random(seen.shape) < rng.uniform(0.2, 0.8), -1, seen)
            parts = [self._part(p, seen[p]) for p in range(4)]
            inputs.append(self._fill(template, None, self._prompt(stream, rng), parts))
            labels.append(self._chunk_labels(keys, at, target))
        return _stack(inputs, labels)

    def speech(self, count: int, seconds: float, rng: np.random.Generator, *, to: str) -> Batch:
        """Audio to text or text to audio (pre-training): a window if word times are known, else the beginning of an
        item."""
        most = int(seconds * self.config["audio"]["token_rate"])
        inputs, labels = [], []
        for stream in self._streams(count, rng, "a2t"):
            tokens = min(most, stream.units.shape[1])
            share = tokens / stream.units.shape[1]
            at, said = 0, stream.text[: max(1, int(len(stream.text) * share))]
            if stream.spoken is not None and tokens < stream.units.shape[1]:
                at = int(rng.integers(stream.units.shape[1] - tokens + 1))
                inside = (stream.spoken[:, 0] >= at) & (stream.spoken[:, 1] <= at + tokens)
                said = stream.text[inside]
            audio = self._units(stream, at, tokens, rng)
            said = np.concatenate([said, [self.vocab["eos"]]])
            inputs.append(self._speech_input(audio, said, to))
            labels.append(said if to == "text" else audio)
        return _stack(inputs, labels)

    def _speech_input(self, audio: np.ndarray, said: np.ndarray, to: str) -> np.ndarray:
        template = "audio_to_text" if to == "text" else "text_to_audio"
        if template in self.templates:
            return self._fill(template, audio, said[:-1], [_NOTHING] * len(PARTS))
        return np.concatenate([audio, [self.vocab["eos"]]]) if to == "text" else said


def _slice(row: np.ndarray, first: int, count: int, fill: int) -> np.ndarray:
    """`row[first : first + count]`, `fill` outside of it."""
    out = np.full(count, fill, np.int64)
    low, high = max(first, 0), min(first + count, len(row))
    if high > low:
        out[low - first : high - first] = row[low:high]
    return out


def _stack(inputs: list[np.ndarray], labels: list[np.ndarray]) -> Batch:
    longest = max(map(len, inputs))
    ids = np.zeros((len(inputs), longest), np.int64)
    mask = np.zeros(ids.shape, bool)
    for row, (values, kept) in zip(inputs, zip(ids, mask, strict=True), strict=True):
        kept[: len(row)] = True
        values[: len(row)] = row
    asked = np.full((len(labels), max(map(len, labels))), -100, np.int64)
    for row, values in zip(labels, asked, strict=True):
        values[: len(row)] = row
    return Batch(ids, None if mask.all() else mask, asked)
