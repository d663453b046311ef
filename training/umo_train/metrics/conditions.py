"""Speech as it is: how mouth and body answer to noise, other voices, telephones, whispers, shouts, laughs and coughs.

Each take is animated clean and in every condition, by `umo animate` (delayed) and by the live mouth, with one seed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from zlib import crc32

import numpy as np

from umo_train.metrics import beat, body, lips
from umo_train.metrics.interval import Estimate, mean, ratio
from umo_train.metrics.item import Item, Motion, recording
from umo_train.metrics.measure import Subject
from umo_train.mouth.run import Mouth
from umo_train.performer.lips import lip_opening
from umo_train.speech import conditions, voices
from umo_train.speech.conditions import Condition, Take
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE
from umo_train.speech.voices import Line

HELLO = Path(__file__).parents[3] / "assets/hello.wav"
# The small form: speech of synthesisers and one recording, takes of at least this length, and some conditions.
SMALL_S = 5.0
SMALL = ("music, 0 dB", "telephone", "laughter in the pauses", "second talker, as loud")
SMALL_VOICES = ("flite-slt",)
SMALL_LINES = (
    "Maybe Bob can open both of the empty boxes before we move them.",
    "My mother put a map and a big pot of jam beside the lamp.",
)
CLEAN, AGAIN, OTHER = "clean", "clean, another seed", "clean, another take's mouth"


@dataclass(frozen=True)
class Seen:
    """One take in one condition: the mouth `[T]`, and the body's motion, of which the live mouth has none."""

    opening: np.ndarray
    width: np.ndarray
    motion: Motion | None = None
    # Times of the onsets in the clean take, seconds.
    onsets: np.ndarray = field(default_factory=lambda: np.zeros(0))


def seconds(takes: Sequence[Take]) -> float:
    return sum(len(take.samples) for take in takes) / SAMPLE_RATE


def small_recordings() -> list[Item]:
    lines = [Line(text) for text in SMALL_LINES]
    said = [one for name in SMALL_VOICES for one in voices.find(name).speak(lines)]
    return [Item(f"{i}", one.voice, one.samples) for i, one in enumerate(said)] + [recording(HELLO)]


def chosen(small: bool) -> list[Condition]:
    return [one for one in conditions.conditions() if not small or one.name in SMALL]


def delayed(subject: Subject, samples: np.ndarray, seed: int) -> Seen:
    motion = subject.animate(Item("", "", samples), seed)
    return Seen(lip_opening(motion["face"]), lips.width(motion["face"]), motion)


def live(mouth: Mouth, samples: np.ndarray) -> Seen:
    face, _ = mouth(samples)
    return Seen(lip_opening(face), lips.width(face))


def against(take: Take, clean: Seen, seen: Seen, tempo: float) -> dict[str, float]:
    """Numbers of one take; the clean take's are compared at the same place in the speech."""
    pauses = [(start / tempo, end / tempo) for start, end in take.pauses]
    times = np.arange(len(seen.opening)) * tempo
    at = np.arange(len(clean.opening))
    opening, width = (np.interp(times, at, one) for one in (clean.opening, clean.width))
    pausing = _during(pauses, len(seen.opening))
    found = {
        "opening": lips.pearson(seen.opening, opening),
        "width": lips.pearson(seen.width, width),
        "open": float(seen.opening[~pausing].mean()),
        "open_clean": float(opening[~pausing].mean()),
        "moving": float(np.mean(lips.moving(seen.opening, pauses))),
    }
    return found if seen.motion is None else found | _body(clean.onsets / tempo, seen.motion, pausing)


def _body(onsets: np.ndarray, motion: Motion, pausing: np.ndarray) -> dict[str, float]:
    speed = body.wrist_speed(motion)
    rhythm = beat.beat([(onsets, beat.turning_points(motion), len(speed) / FRAME_RATE)], beat.SHARP_SIGMA_S)
    return {
        "wrists": 60 * float(speed.mean()),
        "wrists_in_pauses": 60 * float(speed[pausing].mean()),
        "gesturing_in_pauses": float((speed[pausing] > body.GESTURE_M_S).mean()),
        "hands_still": float((speed < body.STILL_M_S).mean()),
        "beat": rhythm.own,
        "beat_shifted": rhythm.shifted,
    }


def _during(pauses: Sequence[tuple[float, float]], frames: int) -> np.ndarray:
    at = np.arange(frames) / FRAME_RATE
    return np.any([(at >= start) & (at < end) for start, end in pauses], axis=0)


def measure(
    subject: Subject, mouth: Mouth, takes: Sequence[Take], conditions: Sequence[Condition], say: Callable = print
) -> dict[str, dict[str, list[dict[str, float]]]]:
    """Numbers of each take by path (`delayed`, `live`) and condition; the first rows are the clean take itself, with
    another seed, and beside another take's mouth."""
    found: dict[str, dict[str, list[dict[str, float]]]] = {"delayed": {}, "live": {}}
    paths: dict[str, Callable[[np.ndarray], Seen]] = {
        "delayed": lambda samples: delayed(subject, samples, subject.seed),
        "live": lambda samples: live(mouth, samples),
    }
    clean = {path: [run(take.samples) for take in takes] for path, run in paths.items()}
    clean["delayed"] = [
        replace(one, onsets=beat.onsets(take.samples)) for take, one in zip(takes, clean["delayed"], strict=True)
    ]
    for path, seen in clean.items():
        rows = found[path]
        rows[CLEAN] = [against(take, one, one, 1.0) for take, one in zip(takes, seen, strict=True)]
        if path == "delayed":
            again = [delayed(subject, take.samples, subject.seed + 1) for take in takes]
            rows[AGAIN] = [against(take, *both, 1.0) for take, *both in zip(takes, seen, again, strict=True)]
        if len(takes) > 1:
            rows[OTHER] = [
                against(take, one, Seen(*(np.resize(x, len(one.opening)) for x in (other.opening, other.width))), 1.0)
                for take, one, other in zip(takes, seen, [*seen[1:], seen[0]], strict=True)
            ]
    for condition in conditions:
        # The same noise at every level.
        kind = crc32(condition.name.split(",")[0].encode())
        sounds = [
            condition.make(take, takes, np.random.default_rng((subject.seed, i, kind))) for i, take in enumerate(takes)
        ]
        for path, run in paths.items():
            found[path][condition.name] = [
                against(take, one, run(sound), condition.tempo)
                for take, one, sound in zip(takes, clean[path], sounds, strict=True)
            ]
        say(condition.name, flush=True)
    return found


def estimates(rows: Sequence[dict[str, float]], clean: Sequence[dict[str, float]]) -> dict[str, Estimate]:
    """A row of the table: means over takes and, for what has a unit, ratios to the clean takes'."""

    def of(name: str, these: Sequence[dict[str, float]] = rows) -> np.ndarray:
        return np.array([row[name] for row in these])

    found = {name: mean(of(name)) for name in ("opening", "width", "moving")}
    found["open"] = ratio(of("open"), of("open_clean"))
    if "wrists" in rows[0]:
        found |= {name: ratio(of(name), of(name, clean)) for name in ("wrists", "wrists_in_pauses")}
        found |= {name: mean(of(name)) for name in ("gesturing_in_pauses", "hands_still")}
        found["beat"] = ratio(of("beat"), of("beat_shifted"))
    return found


LIPS = {
    "opening": ("r of opening", 2),
    "width": ("r of width", 2),
    "open": ("opening in speech over clean", 2),
    "moving": ("moves in pauses, % of time", 0),
}
BODY = {
    "wrists": ("wrists' path over clean", 2),
    "wrists_in_pauses": ("in pauses, over clean", 2),
    "gesturing_in_pauses": ("gesturing in pauses, % of time", 0),
    "hands_still": ("hands still, % of time", 1),
    "beat": ("beats over shifted", 2),
}


def markdown(found: dict[str, dict[str, list[dict[str, float]]]]) -> str:
    """Three tables: the lips delayed and live, and the body."""
    delayed, live = (
        {name: estimates(seen, rows[CLEAN]) for name, seen in rows.items()}
        for rows in (found["delayed"], found["live"])
    )
    return "\n".join(
        [
            _table(delayed, LIPS, "Lips, `umo animate`"),
            _table(live, LIPS, "Lips, live mouth"),
            _table(delayed, BODY, "Body, `umo animate`"),
        ]
    )


def _table(rows: dict[str, dict[str, Estimate]], columns: dict[str, tuple[str, int]], title: str) -> str:
    lines = [[title, *(heading for heading, _ in columns.values())], ["---"] * (len(columns) + 1)]
    for name, row in rows.items():
        if any(column in row for column in columns):
            cells = [
                row[column].text(places, 100 if "%" in heading else 1) if column in row else "–"
                for column, (heading, places) in columns.items()
            ]
            lines.append([name, *cells])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def failures(subject: Subject, mouth: Mouth, found: dict[str, dict[str, list[dict[str, float]]]]) -> list[str]:
    """Facts that hold unless something is broken, each with what it was."""
    out = []
    for path, rows in found.items():
        missing = [name for name in (CLEAN, OTHER, *SMALL) if name not in rows]
        if missing:
            out.append(f"{path}: no rows {missing}")
            continue
        numbers = [value for seen in rows.values() for row in seen for value in row.values()]
        if not np.isfinite(numbers).all():
            out.append(f"{path}: a number is not finite")
        # Another sentence's mouth is alike by chance only.
        known, other = (np.mean([row["opening"] for row in rows[name]]) for name in ("telephone", OTHER))
        if known <= other:
            out.append(f"{path}: by telephone r is {known:.2f}, and {other:.2f} with another sentence")
    silence = np.zeros(3 * SAMPLE_RATE, np.float32)
    for path, seen in (("delayed", delayed(subject, silence, subject.seed)), ("live", live(mouth, silence))):
        if seen.opening.max() > lips.CLOSED:
            out.append(f"{path}: silence opens the mouth by {seen.opening.max():.2f}")
    return out
