"""The right speech found: a judge that hears speech and sees motion chooses between a motion's own speech and other
speech of the same speaker.

It is the forced choice of GENEA's boards with a network in place of viewers. Each subject has its own judges, one of
each view, as inputs differ and none shall be worse for looking unlike another; `whole` is the sum of their scores.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from torch import nn
from torch.nn import functional

from umo_train.metrics import words
from umo_train.metrics.item import Word
from umo_train.metrics.lips import pearson
from umo_train.metrics.takes import SEEN, VIEWS, Take, is_arkit, upper_speed
from umo_train.performer.lips import JAW
from umo_train.skeleton import JOINT, JOINT_NAMES, SHAPE
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

# Spectra of speech in a frame of motion, their bands, and their length in samples.
SPECTRA, BANDS, LENGTH = 2, 40, 512
# Width of the encoders, and of the features that are compared.
WIDTH, FEATURES = 48, 16
# Windows of a batch. Several are of one take, so that a speaker's manner alone does not find the speech.
BATCH = 64
# Candidates of which the other speech is the one whose loudness is distributed most alike.
CANDIDATES = 8
# Frames by which the plain judge may move the motion against the loudness.
LAGS = 6
WHOLE = "whole"
JAW_OPEN = JAW + SHAPE["jawOpen"]
# Channels of the heights of wrists and fingers.
HANDS_UP = [3 * i + 1 for i, joint in enumerate(SEEN) if "wrist" in JOINT_NAMES[joint] or joint >= JOINT["left_index1"]]


@lru_cache(maxsize=1)
def _mel() -> np.ndarray:
    import librosa

    return librosa.filters.mel(sr=SAMPLE_RATE, n_fft=LENGTH, n_mels=BANDS)


def heard(samples: np.ndarray, frames: int) -> np.ndarray:
    """Logarithmic mel spectra of speech `[frames, SPECTRA * BANDS]`, each band relative to its mean and deviation in
    the recording, so that microphones and levels do not matter."""
    at = np.round((np.arange(frames * SPECTRA) + 0.5) * SAMPLE_RATE / FRAME_RATE / SPECTRA).astype(int)
    padded = np.pad(np.asarray(samples, np.float32), LENGTH)
    cut = padded[np.clip(at[:, None] + LENGTH // 2 + np.arange(LENGTH), 0, len(padded) - 1)]
    power = np.abs(np.fft.rfft(cut * np.hanning(LENGTH).astype(np.float32))) ** 2
    bands = np.log(power @ _mel().T + 1e-6)
    bands = (bands - bands.mean(0)) / (bands.std(0) + 1e-6)
    return bands.reshape(frames, -1).astype(np.float32)


def _moving(channels: np.ndarray) -> np.ndarray:
    return np.concatenate([channels, np.gradient(channels, axis=0) * FRAME_RATE], 1).astype(np.float32)


@dataclass(frozen=True)
class Prepared:
    """A take as judges read it, without the rest, as it is sent to processes. Frames before `first` and from `last` on
    are left out, where silence and a first pose show a file's ends."""

    name: str
    speaker: str
    loudness: np.ndarray
    energy: Mapping[str, np.ndarray]
    speech: np.ndarray
    motion: Mapping[str, np.ndarray]
    first: int
    last: int
    words: Sequence[Word]


def prepare(take: Take, edge: int) -> Prepared:
    frames = take.frames
    motion = {view: _moving(take.seen[view][:frames]) for view in VIEWS if view in take.seen}
    speech = heard(take.samples, frames)
    return Prepared(
        take.name, take.speaker, take.loudness, take.energy, speech, motion, edge, frames - edge, take.words
    )


class Encoder(nn.Module):
    """Channels of each frame to the features of a window, together of length 1 `[N, F]`. It sees half a second around a
    frame, and not where in its file it is."""

    def __init__(self, rows: Sequence[np.ndarray]) -> None:
        super().__init__()
        joined = np.concatenate(rows)
        self.register_buffer("mean", torch.from_numpy(joined.mean(0)))
        self.register_buffer("deviation", torch.from_numpy(joined.std(0) + 1e-4))
        layers: list[nn.Module] = [nn.Conv1d(joined.shape[1], WIDTH, 4, stride=2, padding=1), nn.GELU()]
        for spacing in (1, 2, 4):
            layers += [nn.Conv1d(WIDTH, WIDTH, 3, padding=spacing, dilation=spacing), nn.GELU(), nn.Dropout(0.2)]
        self.layers = nn.Sequential(*layers, nn.Conv1d(WIDTH, FEATURES, 1))

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        made = self.layers(((values - self.mean) / self.deviation).clamp(-5, 5).transpose(1, 2))
        return functional.normalize(made.flatten(1), dim=1)


class Judge(nn.Module):
    """A pair's score is the scaled cosine of the features of its speech and its motion."""

    def __init__(self, prepared: Sequence[Prepared], view: str) -> None:
        super().__init__()
        self.hear = Encoder([one.speech for one in prepared])
        self.see = Encoder([one.motion[view] for one in prepared])
        self.scale = nn.Parameter(torch.tensor(2.0))


def _batch(prepared: Sequence[Prepared], view: str, window: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Windows of random takes side by side from a random place on, speech and motion `[N, window, C]`."""
    speech: list[np.ndarray] = []
    motion: list[np.ndarray] = []
    order = iter(rng.permutation(len(prepared)))
    while len(speech) < BATCH and (index := next(order, None)) is not None:
        one = prepared[index]
        spare = (one.last - one.first) % window
        starts = one.first + rng.integers(spare + 1) + np.arange(0, one.last - one.first - window + 1, window)
        for start in rng.permutation(starts)[: BATCH // 8]:
            speech.append(one.speech[start : start + window])
            motion.append(one.motion[view][start : start + window])
    return np.stack(speech[:BATCH]), np.stack(motion[:BATCH])


def train(prepared: Sequence[Prepared], view: str, window: int, steps: int, seed: int) -> Judge:
    """A judge of a view that tells a window's own speech from the other windows' of a batch."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    judge = Judge(prepared, view)
    optimizer = torch.optim.AdamW(judge.parameters(), weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    for _ in range(steps):
        speech, motion = map(torch.from_numpy, _batch(prepared, view, window, rng))
        scores = judge.scale.exp() * judge.hear(speech) @ judge.see(motion).T
        own = torch.arange(len(scores))
        loss = functional.cross_entropy(scores, own) + functional.cross_entropy(scores.T, own)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        schedule.step()
    return judge.eval()


@dataclass(frozen=True)
class Pair:
    """A window of motion, and the two places of speech of its length: its own, and another of the same speaker."""

    motion: Prepared
    start: int
    other: Prepared
    other_start: int


def pairs(prepared: Sequence[Prepared], window: int, seed: int) -> list[Pair]:
    """A pair for each window of each take, side by side. The other speech does not overlap the window, and of
    `CANDIDATES` random ones half a second apart it has the most alike distribution of loudness."""
    rng = np.random.default_rng(seed)
    places: dict[str, list[tuple[Prepared, int]]] = {}
    for one in prepared:
        starts = range(one.first, one.last - window + 1, FRAME_RATE // 2)
        places.setdefault(one.speaker, []).extend((one, start) for start in starts)

    def levels(one: Prepared, start: int) -> np.ndarray:
        return np.sort(np.log(one.loudness[start : start + window] + 1e-4))

    out = []
    for one in prepared:
        for start in range(one.first, one.last - window + 1, window):
            able = [place for place in places[one.speaker] if place[0] is not one or abs(place[1] - start) >= window]
            if able:
                drawn = [able[i] for i in rng.permutation(len(able))[:CANDIDATES]]
                own = levels(one, start)
                other, at = min(drawn, key=lambda place: np.abs(levels(*place) - own).mean())
                out.append(Pair(one, start, other, at))
    return out


@torch.inference_mode()
def margins(judge: Judge, rows: Sequence[Pair], view: str, window: int) -> np.ndarray:
    """Score of the right speech less that of the other `[N]`."""
    out = []
    for some in (rows[i : i + 256] for i in range(0, len(rows), 256)):
        motion = np.stack([p.motion.motion[view][p.start : p.start + window] for p in some])
        own = np.stack([p.motion.speech[p.start : p.start + window] for p in some])
        other = np.stack([p.other.speech[p.other_start : p.other_start + window] for p in some])
        seen, right, wrong = (
            judge.see(torch.from_numpy(motion)),
            *(judge.hear(torch.from_numpy(s)) for s in (own, other)),
        )
        out.append((judge.scale.exp() * ((right - wrong) * seen).sum(1)).numpy())
    return np.concatenate(out)


def plain_margin(pair: Pair, view: str, window: int) -> float:
    """The same of a judge without a network: correlation of the view's energy with the loudness at its best lag."""
    energy = pair.motion.energy[view][pair.start : pair.start + window]

    def best(one: Prepared, start: int) -> float:
        loud = one.loudness[start : start + window]
        inner = slice(LAGS, len(loud) - LAGS)
        return max(pearson(energy[inner], loud[LAGS + lag : len(loud) - LAGS + lag]) for lag in range(-LAGS, LAGS + 1))

    return best(pair.motion, pair.start) - best(pair.other, pair.other_start)


@dataclass(frozen=True)
class Options:
    """Length of a window and part of each file's ends that is left out, seconds; folds; steps of each training;
    processes."""

    seconds: float = 4.0
    edge: float = 0.8
    folds: int = 3
    steps: int = 100
    seed: int = 0
    jobs: int = 2


@dataclass(frozen=True)
class Tried:
    """Margins of the pairs of a subject by view, of the networks and of the plain judge, and each pair's group: its
    speaker, or its recording if the speakers are fewer than the folds."""

    networks: Mapping[str, np.ndarray]
    plain: Mapping[str, np.ndarray]
    groups: Sequence[str]
    # Margins of the body's windows with words, and each one's recording; none without words.
    words: tuple[np.ndarray, Sequence[str]] | None = None


def tried(takes: Sequence[Take], options: Options, more: Sequence[Take] = ()) -> Tried:
    """Every pair, tried by a judge that was trained on the other folds: on other groups than the pair's. `more` are
    other motions of the recordings, for the words alone."""
    from joblib import Parallel, delayed

    window = round(options.seconds * FRAME_RATE)
    prepared = [prepare(take, round(options.edge * FRAME_RATE)) for take in takes]
    prepared = [one for one in prepared if one.last - one.first >= window]
    by_speaker = len({one.speaker for one in prepared}) >= options.folds

    def group(one: Prepared) -> str:
        return one.speaker if by_speaker else one.name

    names = np.random.default_rng(options.seed).permutation(sorted({group(one) for one in prepared}))
    if len(names) < 2:
        raise ValueError(
            f"{len(names)} recordings of at least {options.seconds + 2 * options.edge:g} s: two are needed"
        )
    views = [view for view in VIEWS if all(view in one.motion for one in prepared)]
    rows: list[Pair] = []
    tasks = []
    for fold in np.array_split(names, min(options.folds, len(names))):
        held = set(fold)
        some = pairs([one for one in prepared if group(one) in held], window, options.seed)
        learned = [one for one in prepared if group(one) not in held]
        tasks += [delayed(_try)(learned, some, view, window, options) for view in views]
        rows += some
    margins_ = Parallel(n_jobs=options.jobs)(tasks)
    networks = {view: np.concatenate(margins_[i :: len(views)]) for i, view in enumerate(views)}
    if len(views) > 1:
        networks = {WHOLE: sum(networks.values())} | networks
    plain = {view: np.array([plain_margin(pair, view, window) for pair in rows]) for view in views}
    read = None
    if "body" in views and all(one.words for one in prepared):
        known = {one.name for one in prepared}
        others = [prepare(take, round(options.edge * FRAME_RATE)) for take in more if take.name in known]
        read = words.tried([*prepared, *others], "body", options)
    return Tried(networks, plain, [group(pair.motion) for pair in rows], read)


def _try(learned: Sequence[Prepared], rows: Sequence[Pair], view: str, window: int, options: Options) -> np.ndarray:
    # Small convolutions are faster on one core, and the processes share the cores.
    torch.set_num_threads(1)
    return margins(train(learned, view, window, options.steps, options.seed), rows, view, window)


def swapped(takes: Sequence[Take], seed: int = 0) -> list[Take]:
    """Each take's speech with a random other one's motion: only leaks can find the speech, such as a first pose beside
    a file's first silence."""
    order = np.random.default_rng(seed).permutation(len(takes))
    other = dict(zip(order, np.roll(order, 1), strict=True))
    return [
        replace(take, seen=takes[other[i]].seen, energy=takes[other[i]].energy, motion=None)
        for i, take in enumerate(takes)
    ]


def puppets(takes: Sequence[Take], metres: float = 0.01, opening: float = 0.1) -> list[Take]:
    """Takes whose hands also rise with the loudness, and whose mouths open (without ARKit's coefficients the first one
    grows), by this much for one deviation of it: what a judge finds if speech and motion do go together."""

    def puppet(take: Take) -> Take:
        loud = gaussian_filter1d(take.loudness, 3.0)
        loud = (loud - loud.mean()) / (loud.std() + 1e-9)
        seen = {view: values[: take.frames].copy() for view, values in take.seen.items()}
        seen["face"][:, JAW_OPEN if is_arkit(seen["face"]) else 0] += opening * loud
        energy = {"face": take.energy["face"][: take.frames] + opening * loud}
        if "body" in seen:
            seen["body"][:, HANDS_UP] += metres * loud[:, None]
            energy["body"] = upper_speed(seen["body"])
        return replace(take, seen=seen, energy=energy, motion=None)

    return [puppet(take) for take in takes]
