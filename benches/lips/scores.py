"""Scores of a mouth beside a captured one: correlation, lag, closures found and shown by mistake, with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from captured import Recording, Word
from methods import Curve
from umo_train.metrics.lips import pearson

# A long take is measured in pieces of this length, so that an interval has something to draw from.
PIECE_S = 10.0
# A mouth is closed in the lowest tenth of its own range, from the 1st to the 99th percentile over all recordings, and
# clearly apart above three tenths. The same for all, captured and computed, as every method has a scale of its own.
CLOSED, APART = 0.1, 0.3
RANGE = (1, 99)
# A closure counts as found if the mouth closes this near to the captured one: one and a half frames of 30 a second.
NEAR_S = 0.05
# Where to look for the captured closure around the phone's share of its word.
SLACK_S = 0.08
# Without words: a closed run is a sound's, no pause, if it is this short and lips are apart this near on both sides.
RUN_S, FLANK_S = 0.2, 0.2
LAGS_S = np.arange(-0.6, 0.6001, 0.01)
DRAWS = 2000
BILABIAL = frozenset("PBM")


def pieces(one: Recording) -> list[Recording]:
    """A recording, or the pieces of a long one, each with its own name."""
    count = max(int(one.seconds // PIECE_S), 1)
    parts = np.array_split(np.arange(len(one.times)), count)
    if count == 1:
        return [one]
    return [
        replace(one, name=f"{one.name}/{n}", times=one.times[at], mouth=one.mouth[at]) for n, at in enumerate(parts)
    ]


def dictionary() -> dict[str, list[str]]:
    """Phones of GRID's words."""
    text = Path(__file__).with_name("words.dict").read_text()
    lines = (line.split() for line in text.splitlines() if not line.startswith(";"))
    return {word.lower(): phones for word, *phones in lines}


def threshold(opening: np.ndarray, share: float) -> float:
    low, high = np.percentile(opening, RANGE)
    return float(low + share * (high - low))


def closures_in_words(one: Recording, closed: float, phones: dict[str, list[str]]) -> list[float]:
    """Times of the captured closures at p, b and m: the lowest opening near the phone's share of its word, if closed.

    Words after a silence are left out: lips that were closed before prove nothing.
    """
    out = []
    for before, word in zip((Word("sil", 0, 0), *one.words), one.words, strict=False):
        spoken = phones.get(word.text, [])
        if before.text in ("sil", "sp"):
            continue
        for place, phone in enumerate(spoken):
            if phone not in BILABIAL:
                continue
            first, last = (word.start + (word.end - word.start) * at / len(spoken) for at in (place, place + 1))
            near = np.flatnonzero((one.times >= first - SLACK_S) & (one.times <= last + SLACK_S))
            opening = one.mouth[near, 0]
            if len(near) and opening.min() <= closed:
                # The middle of the frames that are as low.
                out.append(float(one.times[near[opening <= opening.min() + 1e-9]].mean()))
    return out


def closures_between(one: Recording, closed: float, apart: float) -> list[float]:
    """Times of the captured closures where words are unknown: short closed runs between lips that are clearly apart."""
    opening, times = one.mouth[:, 0], one.times
    edges = np.flatnonzero(np.diff(np.concatenate([[0], opening <= closed, [0]]).astype(int))).reshape(-1, 2)
    out = []
    for first, end in edges:
        start, stop = times[first], times[end - 1]
        before = opening[(times >= start - FLANK_S) & (times < start)]
        after = opening[(times > stop) & (times <= stop + FLANK_S)]
        flanked = len(before) and len(after) and min(before.max(), after.max()) >= apart
        if flanked and stop - start <= RUN_S:
            out.append(float((start + stop) / 2))
    return out


@dataclass(frozen=True)
class Truth:
    """Captured recordings, or pieces of them, with the times of their closures and the frames with lips apart."""

    recordings: Sequence[Recording]
    closures: Sequence[Sequence[float]]
    apart: Sequence[np.ndarray]


def truth(recordings: Sequence[Recording]) -> Truth:
    parts = [part for one in recordings for part in pieces(one)]
    opening = np.concatenate([one.mouth[:, 0] for one in parts])
    closed, apart = threshold(opening, CLOSED), threshold(opening, APART)
    phones = dictionary()
    has_words = all(one.words for one in parts)
    closures = [
        closures_in_words(one, closed, phones) if has_words else closures_between(one, closed, apart) for one in parts
    ]
    return Truth(parts, closures, [one.mouth[:, 0] > apart for one in parts])


@dataclass(frozen=True)
class Score:
    """A value with its 95 % interval over recordings, and the value of each draw."""

    value: float
    low: float
    high: float
    draws: np.ndarray


def bootstrap(statistic: Callable[[np.ndarray], float], count: int) -> Score:
    """`statistic` of recordings by index, drawn with repetition; the same draws for every method."""
    rng = np.random.default_rng(0)
    draws = np.array([statistic(rng.integers(count, size=count)) for _ in range(DRAWS)])
    low, high = np.nanpercentile(draws, (2.5, 97.5))
    return Score(statistic(np.arange(count)), float(low), float(high), draws)


def best_lag(correlations: np.ndarray) -> float:
    """Lag in seconds of the largest of the correlations at `LAGS_S`, between them by a parabola."""
    top = int(np.argmax(correlations))
    if top in (0, len(LAGS_S) - 1):
        return float(LAGS_S[top])
    before, at, after = correlations[top - 1 : top + 2]
    bend = before - 2 * at + after
    offset = 0.5 * (before - after) / bend if bend else 0.0
    return float(LAGS_S[top] + offset * (LAGS_S[1] - LAGS_S[0]))


def score(method_curves: dict[str, Curve], parts: int, known: Truth) -> dict[str, Score]:
    """All measures of a method: `opening`, `width` and `rounding` (mean of the recordings' r), `in step` (opening with
    the lag removed), `lag` in seconds, `found` and `false` and their difference `closures`, and `found in step`."""
    count = len(known.recordings)
    # A piece of a take is named after it.
    curves = [method_curves[one.name.split("/")[0]] for one in known.recordings]
    by_lag = np.array(
        [
            [pearson(np.interp(one.times + lag, curve.times, curve.mouth[:, 0]), one.mouth[:, 0]) for lag in LAGS_S]
            for one, curve in zip(known.recordings, curves, strict=True)
        ]
    )
    lag = best_lag(by_lag.mean(0))
    out = {"lag": bootstrap(lambda rows: best_lag(by_lag[rows].mean(0)), count)}
    # The nearest lag of the list serves.
    in_step = by_lag[:, np.abs(LAGS_S - lag).argmin()]
    out["in step"] = bootstrap(lambda rows: float(in_step[rows].mean()), count)
    for column, name in list(enumerate(("opening", "width", "rounding")))[:parts]:
        values = np.array(
            [
                pearson(curve.at(one.times)[:, column], one.mouth[:, column])
                for one, curve in zip(known.recordings, curves, strict=True)
            ]
        )
        out[name] = bootstrap(lambda rows, values=values: float(values[rows].mean()), count)
    sampled = [curve.at(one.times)[:, 0] for one, curve in zip(known.recordings, curves, strict=True)]
    closed = threshold(np.concatenate(sampled), CLOSED)
    shown = np.array(
        [[(row <= closed)[lips].sum(), lips.sum()] for row, lips in zip(sampled, known.apart, strict=True)]
    )
    out["false"] = _share(np.array(shown))
    for name, shift in (("found", 0.0), ("found in step", lag)):
        reached = [
            [_closes(curve, moment + shift, closed) for moment in moments]
            for curve, moments in zip(curves, known.closures, strict=True)
        ]
        out[name] = _share(np.array([[sum(row), len(row)] for row in reached]))
    out["closures"] = _less(out["found"], out["false"])
    return out


def _closes(curve: Curve, moment: float, closed: float) -> bool:
    near = moment + np.linspace(-NEAR_S, NEAR_S, 21)
    return bool(np.interp(near, curve.times, curve.mouth[:, 0]).min() <= closed)


def _less(one: Score, other: Score) -> Score:
    """The difference of two scores, draw by draw."""
    draws = one.draws - other.draws
    low, high = np.nanpercentile(draws, (2.5, 97.5))
    return Score(one.value - other.value, float(low), float(high), draws)


def _share(counts: np.ndarray) -> Score:
    """Share of all recordings' counts `[recordings, 2]`: how many of how many."""

    def statistic(rows: np.ndarray) -> float:
        part, whole = counts[rows].sum(0)
        return float(part / whole) if whole else float("nan")

    return bootstrap(statistic, len(counts))
