"""Closures at p, b and m in eleven languages, by synthesisers that say when each phone is.

espeak-ng speaks all of them, flite and festival English too. The model learned from English and German speech, its
mouth from thirteen further languages of espeak-ng too; of these voices it knows the English ones, not the sentences.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
from scipy.ndimage import gaussian_filter1d

from umo_train.metrics import lips
from umo_train.metrics.interval import Estimate, mean, ratio
from umo_train.speech import voices
from umo_train.speech.utterance import FRAME_RATE, SILENCE, Phone, Utterance
from umo_train.speech.variation import joined, leveled
from umo_train.speech.voices import Line

NAMES = {
    "en-us": "English",
    "de": "German",
    "fr": "French",
    "es": "Spanish",
    "it": "Italian",
    "pt-br": "Portuguese",
    "ru": "Russian",
    "tr": "Turkish",
    "hi": "Hindi",
    "cmn-latn-pinyin": "Mandarin",
    "ar": "Arabic",
}
# espeak-ng's variants and pitches: a man, a woman, a high voice.
SPEAKERS = (("", 0.9), ("f2", 1.0), ("m3", 1.2))
OTHERS = ("flite-slt", "flite-rms", "festival-kal_diphone", "festival-ked_diphone")
LEVEL_DB = 24.0
OPEN = frozenset(("aa", "ae"))
# Shortest open vowel of which a shut mouth is counted: shorter ones may never open between two closures.
OPEN_S = 0.06
# How far lips are apart, by the height of vowels in the phonetic alphabet: open, mid, close.
_HEIGHT = (
    dict.fromkeys(("aa", "ae", "aw", "ay"), 1.0)
    | dict.fromkeys(("ah", "ao", "ax", "eh", "er", "ey", "ow", "oy"), 0.6)
    | dict.fromkeys(("ih", "iy", "uh", "uw"), 0.35)
    | dict.fromkeys((*lips.CLOSING, "f", "v", SILENCE), 0.0)
)
_CONSONANT = 0.25
# Silences up to this length within speech are part of the sound before them.
_SHORT_S = 0.12


@dataclass(frozen=True)
class Spoken:
    """A sentence of a row of the table."""

    row: str
    utterance: Utterance


def sentences() -> dict[str, list[str]]:
    """The package's sentences by language."""
    found: dict[str, list[str]] = defaultdict(list)
    for line in (resources.files("umo_train.speech") / "languages.txt").read_text("utf-8").splitlines():
        if not line.startswith("#"):
            language, text = line.split("\t")
            found[language].append(text)
    return dict(found)


def spoken(per_language: int | None = None, speakers: Sequence[tuple[str, float]] = SPEAKERS) -> list[Spoken]:
    """All sentences by all voices, or the first of each language by the first speakers."""
    texts = {language: lines[:per_language] for language, lines in sentences().items()}
    out = []
    for language, lines in texts.items():
        for variant, pitch in speakers:
            voice = voices.Espeak(language, variant)
            out += [Spoken(NAMES[language], _framed(u)) for u in voice.speak([Line(t, pitch=pitch) for t in lines])]
    for name in OTHERS[: None if per_language is None else 1]:
        row = f"English, {name.split('-')[0]}"
        out += [Spoken(row, _framed(u)) for u in voices.find(name).speak([Line(t) for t in texts["en-us"]])]
    return out


def _framed(utterance: Utterance) -> Utterance:
    """With half a second of silence around, at a common level."""
    one = joined([utterance], [0.5, 0.5])
    return Utterance(one.voice, one.text, leveled(one.samples, LEVEL_DB), one.phones, one.words)


def expected(phones: Sequence[Phone], frames: int) -> np.ndarray:
    """Opening by the phones' heights `[T]`, smoothed as the envelope is."""
    at = np.arange(frames) / FRAME_RATE
    out = np.zeros(frames)
    last = 0.0
    for phone in phones:
        if phone.name != SILENCE or phone.end - phone.start > _SHORT_S:
            last = _HEIGHT.get(phone.name, _CONSONANT)
        out[(at >= phone.start) & (at < phone.end)] = last
    return gaussian_filter1d(out, lips.SMOOTH)


def shut_vowels(opening: np.ndarray, phones: Sequence[Phone]) -> np.ndarray:
    """For each open vowel, whether the mouth is shut in the whole of its middle half `[count]`."""
    found = []
    for phone in phones:
        length = phone.end - phone.start
        if phone.name in OPEN and length >= OPEN_S:
            first = round((phone.start + length / 4) * FRAME_RATE)
            last = round((phone.end - length / 4) * FRAME_RATE)
            inner = opening[first : last + 1]
            if len(inner):
                found.append(inner.max() <= lips.CLOSED)
    return np.array(found, bool)


def by_chance(phones: Sequence[Phone], opening: np.ndarray) -> float:
    """Number of closures that a mouth reaches as well which says the other half of the sentence, or another quarter."""
    first, last = (round(time * FRAME_RATE) for time in (phones[0].end, phones[-1].start))
    found = []
    for quarter in (1, 2, 3):
        moved = opening.copy()
        moved[first:last] = np.roll(opening[first:last], (last - first) * quarter // 4)
        found.append(lips.closures(moved, phones).sum())
    return float(np.mean(found))


def against(one: Utterance, opening: np.ndarray) -> dict[str, float]:
    """Counts and correlations of one sentence."""
    closed = lips.closures(opening, one.phones)
    shut = shut_vowels(opening, one.phones)
    return {
        "closures": int(closed.sum()),
        "by_chance": by_chance(one.phones, opening),
        "closing": len(closed),
        "shut": int(shut.sum()),
        "open": len(shut),
        "phones": lips.pearson(opening, expected(one.phones, len(opening))),
        "loudness": max(lips.lag_correlation([(opening, lips.envelope(one.samples, len(opening)))]).values()),
    }


def measure(
    all_spoken: Sequence[Spoken], paths: dict[str, Callable[[np.ndarray], np.ndarray]], say: Callable = print
) -> dict[str, dict[str, list[dict[str, float]]]]:
    """Numbers of each sentence by path, which maps samples to a mouth's opening `[T]`, and by row."""
    found: dict[str, dict[str, list[dict[str, float]]]] = {path: defaultdict(list) for path in paths}
    row = ""
    for one in all_spoken:
        if one.row != row:
            say(row := one.row, flush=True)
        for path, opening in paths.items():
            found[path][one.row].append(against(one.utterance, opening(one.utterance.samples)))
    return {path: dict(rows) for path, rows in found.items()}


def estimates(rows: Sequence[dict[str, float]]) -> dict[str, Estimate]:
    def of(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows])

    return {
        "closures": ratio(of("closures"), of("closing")),
        "by_chance": ratio(of("by_chance"), of("closing")),
        "shut": ratio(of("shut"), of("open")),
        "phones": mean(of("phones")),
        "loudness": mean(of("loudness")),
    }


def markdown(found: dict[str, dict[str, list[dict[str, float]]]]) -> str:
    """One table per path."""
    head = ["sentences", "p, b, m", "closed at them, %", "by chance, %", "open vowels", "shut at them, %"]
    head += ["r with the phones' heights", "r with loudness"]
    blocks = []
    for path, rows in found.items():
        lines = [[f"Languages, {path}", *head], ["---"] * (len(head) + 1)]
        for name, seen in rows.items():
            one = estimates(seen)
            closing, vowels = (sum(row[key] for row in seen) for key in ("closing", "open"))
            lines.append(
                [
                    name,
                    str(len(seen)),
                    str(closing),
                    one["closures"].text(0, 100),
                    f"{one['by_chance'].value * 100:.0f}",
                ]
                + [str(vowels), one["shut"].text(0, 100), one["phones"].text(), one["loudness"].text()]
            )
        blocks.append("\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n")
    return "\n".join(blocks)


def failures(found: dict[str, dict[str, list[dict[str, float]]]]) -> list[str]:
    """Facts that hold unless something is broken, each with what it was."""
    out = []
    for path, rows in found.items():
        out += [f"{path}: no row `{name}`" for name in NAMES.values() if name not in rows]
        for name, seen in rows.items():
            one = estimates(seen)
            if not all(np.isfinite(number.value) for number in one.values()):
                out.append(f"{path}, {name}: a number is not finite")
            if one["loudness"].value <= 0:
                out.append(f"{path}, {name}: the mouth does not follow the voice: r = {one['loudness'].value:.2f}")
        closed, chance = (sum(row[key] for seen in rows.values() for row in seen) for key in ("closures", "by_chance"))
        if closed <= chance:
            out.append(f"{path}: lips close at {closed} of all p, b, m, and by chance at {chance}")
    return out
