"""The right words found: a judge that reads words and sees motion, but hears nothing, chooses between a motion's own
words and other words at the same times. What a body does with the sound finds nothing here: chance is one half."""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from umo_train.metrics.item import Word
from umo_train.metrics.lips import envelope
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

if TYPE_CHECKING:
    from umo_train.metrics.mismatch import Options, Prepared

# Decibels below a clip's 95th percentile of loudness that count as voice.
VOICE_DB = -25.0
# Occurrences in what a judge learns from, below which a word has no vector.
KNOWN = 3
# Width of the encoder, features of a word, and other texts that each window is told from in training.
WIDTH, FEATURES, OTHERS = 48, 12, 7
BATCH, STEPS = 64, 400
# Length of the clips that are tried, seconds: as on the page on which people judge, `umo view --judge`.
CLIP_S = 8.0


def texts(folder: Path) -> dict[str, str]:
    """The text of each recording in a folder's `text.csv` (`name|text`), without the later of two clips with the same
    text, so that no sentence is both learned from and tried."""
    path = folder / "text.csv"
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as lines:
        rows = [row[:2] for row in csv.reader(lines, delimiter="|", quoting=csv.QUOTE_NONE) if len(row) > 1]
    first: dict[str, str] = {}
    for name, text in sorted(rows):
        first.setdefault(text.strip(), name)
    return {name: text for text, name in first.items()}


def spread(text: str, samples: np.ndarray) -> list[Word]:
    """A clip's words over its voice, by their groups of vowels."""
    loud = envelope(samples, len(samples) * FRAME_RATE // SAMPLE_RATE)
    voice = np.flatnonzero(loud > np.percentile(loud, 95) * 10 ** (VOICE_DB / 20)) / FRAME_RATE
    words = text.split()
    counts = [max(1, len(re.findall("[aeiouyäöü]+", word.lower()))) for word in words]
    edges = np.concatenate([[0], np.cumsum(counts)]) / sum(counts) * (len(voice) - 1)
    times = voice[np.round(edges).astype(int)]
    return [Word(word, float(a), float(b)) for word, a, b in zip(words, times, times[1:], strict=False)]


def write(path: Path, words: Sequence[Word]) -> None:
    """NIST's CTM, as `umo animate --words` reads it."""
    lines = (f"speech 1 {w.start:.3f} {w.end - w.start:.3f} {w.text}\n" for w in words)
    path.write_text("".join(lines), encoding="utf-8")


class Judge(nn.Module):
    """A text's score is the sum over its words of the word's vector times the motion's features in the word's middle.
    The encoder sees half a second around a frame."""

    def __init__(self, motion: Sequence[np.ndarray], known: Mapping[str, int]) -> None:
        super().__init__()
        self.known = known
        joined = np.concatenate(motion)
        self.register_buffer("mean", torch.from_numpy(joined.mean(0)))
        self.register_buffer("deviation", torch.from_numpy(joined.std(0) + 1e-4))
        layers: list[nn.Module] = [nn.Conv1d(joined.shape[1], WIDTH, 3, padding=1), nn.GELU()]
        for spacing in (2, 4, 8):
            layers += [nn.Conv1d(WIDTH, WIDTH, 3, padding=spacing, dilation=spacing), nn.GELU(), nn.Dropout(0.2)]
        self.see = nn.Sequential(*layers, nn.Conv1d(WIDTH, FEATURES, 1))
        self.read = nn.Embedding(len(known) + 1, FEATURES, padding_idx=0)

    def forward(self, motion: torch.Tensor, frames: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """Scores `[N, K]` of the `words [N, K, W]` at `frames [N, W]` of the windows `motion [N, T, C]`."""
        seen = self.see(((motion - self.mean) / self.deviation).clamp(-5, 5).transpose(1, 2)).transpose(1, 2)
        features = seen[torch.arange(len(frames))[:, None], frames]
        return torch.einsum("nwf,nkwf->nk", features, self.read(words))


@dataclass(frozen=True)
class Window:
    """Part of a take: words whose middle is in it, and their frames from its start on."""

    take: "Prepared"
    start: int
    names: tuple[str, ...]
    frames: tuple[int, ...]


def windows(prepared: Sequence["Prepared"], window: int) -> list[Window]:
    """Those side by side in each take that have words."""
    out = []
    for one in prepared:
        middles = [round((word.start + word.end) / 2 * FRAME_RATE) for word in one.words]
        for start in range(one.first, one.last - window + 1, window):
            inside = [i for i, middle in enumerate(middles) if start <= middle < start + window]
            if inside:
                names = tuple(one.words[i].name for i in inside)
                out.append(Window(one, start, names, tuple(middles[i] - start for i in inside)))
    return out


def _other(of: Window, among: Sequence[Window], rng: np.random.Generator) -> list[str]:
    """As many words in a row as the window has, of another take."""
    out: list[str] = []
    while len(out) < len(of.names):
        other = among[rng.integers(len(among))]
        if other.take.name != of.take.name:
            out += other.names[rng.integers(len(other.names)) :]
    return out[: len(of.names)]


def _scores(
    judge: Judge, rows: Sequence[Window], view: str, window: int, texts: Sequence[Sequence[Sequence[str]]]
) -> torch.Tensor:
    """Scores of each window's texts, equally many for each `[N, K]`."""
    most = max(len(row.names) for row in rows)
    frames = torch.zeros(len(rows), most, dtype=torch.long)
    words = torch.zeros(len(rows), len(texts[0]), most, dtype=torch.long)
    for n, (row, candidates) in enumerate(zip(rows, texts, strict=True)):
        frames[n, : len(row.frames)] = torch.tensor(row.frames)
        for k, names in enumerate(candidates):
            words[n, k, : len(names)] = torch.tensor([judge.known.get(name, 0) for name in names])
    motion = np.stack([row.take.motion[view][row.start : row.start + window] for row in rows])
    return judge(torch.from_numpy(motion), frames, words)


def train(prepared: Sequence["Prepared"], view: str, window: int, steps: int, seed: int) -> Judge:
    """A judge that tells a window's own words from other takes' at the same times."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    counts = Counter(word.name for one in prepared for word in one.words)
    known = {name: i + 1 for i, name in enumerate(sorted(n for n, count in counts.items() if count >= KNOWN))}
    judge = Judge([one.motion[view] for one in prepared], known)
    optimizer = torch.optim.AdamW(judge.parameters(), weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    rows = windows(prepared, window)
    for _ in range(steps):
        some = [rows[i] for i in rng.permutation(len(rows))[:BATCH]]
        candidates = [[row.names, *(_other(row, rows, rng) for _ in range(OTHERS))] for row in some]
        scores = _scores(judge, some, view, window, candidates)
        loss = nn.functional.cross_entropy(scores, torch.zeros(len(some), dtype=torch.long))
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        schedule.step()
    return judge.eval()


@torch.inference_mode()
def margins(judge: Judge, rows: Sequence[Window], view: str, window: int, seed: int) -> np.ndarray:
    """Score of the right words less that of others `[N]`."""
    rng = np.random.default_rng(seed)
    scores = _scores(judge, rows, view, window, [[row.names, _other(row, rows, rng)] for row in rows])
    return (scores[:, 0] - scores[:, 1]).numpy()


def tried(prepared: Sequence["Prepared"], view: str, options: "Options") -> tuple[np.ndarray, list[str]]:
    """Margins of all clips, each by a judge that was trained on windows of the other folds of recordings, and each
    one's recording. A recording's motions have its name."""
    window, clip = (round(seconds * FRAME_RATE) for seconds in (options.seconds, CLIP_S))
    recordings = np.random.default_rng(options.seed).permutation(sorted({one.name for one in prepared}))
    out: list[np.ndarray] = []
    names: list[str] = []
    for fold in np.array_split(recordings, options.folds):
        held = set(fold)
        judge = train([one for one in prepared if one.name not in held], view, window, STEPS, options.seed)
        rows = windows([one for one in prepared if one.name in held], clip)
        out.append(margins(judge, rows, view, clip, options.seed))
        names += [row.take.name for row in rows]
    return np.concatenate(out), names
