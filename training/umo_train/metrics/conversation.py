"""A conversation of two: readers' sentences laid out as turns, animated by `umo converse`, and what the frames show.

Turns follow each other by the figures of Stivers et al. (2009) and Heldner and Edlund (2010): gaps of 0.2 s on
average, standard deviation 0.4 s, from -0.6 s (an overlap) to 1.2 s. A listener says "mhm" into turns of over 4 s, and
every sixth turn is interrupted: it ends in the middle of a word, 1.2 s after the next one has begun.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from scipy.signal import butter, find_peaks, resample_poly, sosfiltfilt
from scipy.spatial.transform import Rotation

from umo_train.metrics import program
from umo_train.performer.report import world_rotation
from umo_train.skeleton import JOINT, JOINTS, places
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

GAP_S, GAP_DEVIATION_S, GAPS_S = 0.2, 0.4, (-0.6, 1.2)
LEAST_TURN_S, MOST_TURN_S, TURN_MEDIAN_S, TURN_DEVIATION = 1.2, 12.0, 4.0, 0.6
BETWEEN_SENTENCES_S = 0.35
MHM_S, MHM_AFTER_S, MHM_TURN_S = 0.35, 2.5, 4.0
INTERRUPTS, OVERLAP_S = 6, 1.2
# Places of the two: 1.2 m apart, face to face.
PLACES = ((-0.6, 0.0, 90.0), (0.6, 0.0, -90.0))
# A look is at somebody if the eyes are within this angle of theirs.
CONTACT_DEGREES = 6.0
PAUSE_S, PHASE_S = 0.2, 1.2
# A nod, in what the layer of nods adds to the head's pitch: down and back by this much, faster than it sways.
NOD_DEGREES, NOD_HZ, NOD_GAP_S = 1.5, (1.5, 5.0), 0.9
# Share of each voice in the other's channel, and an open mouth.
LEAK = 0.06
OPEN = 0.1


@dataclass(frozen=True)
class Turn:
    """Seconds of a turn; an "mhm" and the remains of an interrupted turn are none."""

    who: int
    start: float
    end: float


@dataclass(frozen=True)
class Conversation:
    """Sound of the two, `[samples]` each, and who has which turn."""

    voices: tuple[np.ndarray, np.ndarray]
    turns: tuple[Turn, ...]


def sentences(folder: Path) -> list[np.ndarray]:
    """A reader's recordings at 16 kHz, without the silence around them."""
    out = []
    for path in sorted(folder.iterdir()):
        if path.suffix not in (".wav", ".flac", ".opus", ".ogg"):
            continue
        samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
        mono = resample_poly(samples.mean(1), SAMPLE_RATE, rate).astype(np.float32)
        mono *= 0.1 / max(float(np.sqrt(np.mean(mono**2))), 1e-6)
        loud = np.flatnonzero(np.abs(mono) > 0.02)
        if len(loud) and (loud[-1] - loud[0]) / SAMPLE_RATE >= LEAST_TURN_S:
            out.append(mono[loud[0] : loud[-1]])
    return out


def lay_out(readers: Sequence[Sequence[np.ndarray]], seconds: float, seed: int) -> Conversation:
    draw = np.random.default_rng(seed)
    voices = tuple(np.zeros(int(seconds * SAMPLE_RATE), np.float32) for _ in readers)
    turns: list[Turn] = []

    def put(who: int, start: float, samples: np.ndarray) -> None:
        at = int(start * SAMPLE_RATE)
        room = voices[who][at : at + len(samples)]
        room[:] = samples[: len(room)]

    at, who, number = 0.5, 0, 0
    while True:
        samples = said(readers[who], draw)
        end = at + len(samples) / SAMPLE_RATE
        if end > seconds - 1:
            return Conversation((voices[0], voices[1]), tuple(turns))
        is_cut = number % INTERRUPTS == INTERRUPTS - 1 and len(samples) > 3.5 * SAMPLE_RATE
        if is_cut:
            end = at + 0.6 * len(samples) / SAMPLE_RATE
        put(who, at, samples[: int((end - at) * SAMPLE_RATE)])
        if end - at > MHM_TURN_S and not is_cut:
            other = readers[1 - who][int(draw.integers(len(readers[1 - who])))]
            put(1 - who, at + MHM_AFTER_S, 0.5 * other[: int(MHM_S * SAMPLE_RATE)])
        gap = float(np.clip(draw.normal(GAP_S, GAP_DEVIATION_S), *GAPS_S))
        after = end - OVERLAP_S if is_cut else end + gap
        turns.append(Turn(who, at, min(end, after)))
        at, who, number = after, 1 - who, number + 1


def said(reader: Sequence[np.ndarray], draw: np.random.Generator) -> np.ndarray:
    """Sentences of a turn, whose length is drawn; the last one ends where it may."""
    drawn = TURN_MEDIAN_S * np.exp(TURN_DEVIATION * draw.standard_normal())
    length = float(np.clip(drawn, LEAST_TURN_S, MOST_TURN_S))
    out = [reader[int(draw.integers(len(reader)))]]
    while sum(map(len, out)) < length * SAMPLE_RATE:
        out += [np.zeros(int(BETWEEN_SENTENCES_S * SAMPLE_RATE), np.float32)]
        out += [reader[int(draw.integers(len(reader)))]]
    return np.concatenate(out)[: int(MOST_TURN_S * SAMPLE_RATE)]


@dataclass(frozen=True)
class Posed:
    """Rotations in the parents' frames `[T, 55, 3, 3]`, places of the root `[T, 3]`, opening of the jaw `[T]`."""

    local: np.ndarray
    at: np.ndarray
    jaw: np.ndarray


@dataclass(frozen=True)
class Seen:
    """One of the two in each frame: whether it looks at the other, its head's pitch, and the eyes' turn, degrees."""

    looks: np.ndarray
    pitch: np.ndarray
    turned: np.ndarray


def seen(motions: Sequence[Posed]) -> list[Seen]:
    heads, eyes, pitch = [], [], []
    for motion, (x, z, degrees) in zip(motions, PLACES, strict=True):
        turn = np.radians(degrees)
        facing = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
        local = motion.local
        at = places(local, motion.at)[:, [JOINT["left_eye"], JOINT["right_eye"]]].mean(1)
        ahead = np.mean([world_rotation(local, JOINT[f"{side}_eye"])[..., 2] for side in ("left", "right")], axis=0)
        heads.append(at @ facing.T + np.array([x, 0, z]))
        eyes.append(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True) @ facing.T)
        pitch.append(np.degrees(-np.arcsin(world_rotation(local, JOINT["head"])[:, 1, 2].clip(-1, 1))))
    out = []
    for one in (0, 1):
        to = heads[1 - one] - heads[one]
        to /= np.linalg.norm(to, axis=-1, keepdims=True)
        away = np.degrees(np.arccos(np.sum(eyes[one] * to, -1).clip(-1, 1)))
        steps = np.degrees(np.arccos(np.sum(eyes[one][1:] * eyes[one][:-1], -1).clip(-1, 1)))
        out.append(Seen(away < CONTACT_DEGREES, pitch[one], np.append(0, steps)))
    return out


def nods(pitch: np.ndarray) -> np.ndarray:
    """Frames at the bottom of each nod in what the layer of nods adds to the pitch, which is nods and a slower sway."""
    swing = sosfiltfilt(butter(2, NOD_HZ, "bandpass", fs=FRAME_RATE, output="sos"), pitch)
    return find_peaks(swing, prominence=NOD_DEGREES, distance=int(NOD_GAP_S * FRAME_RATE))[0]


def alone(conversation: Conversation, frames: int) -> list[np.ndarray]:
    """Frames in which each of the two speaks alone."""
    clock = (np.arange(frames) + 0.5) / FRAME_RATE
    speaks = np.zeros((2, frames), bool)
    for turn in conversation.turns:
        speaks[turn.who] |= (clock >= turn.start) & (clock < turn.end)
    return [speaks[one] & ~speaks[1 - one] for one in (0, 1)]


def measure(conversation: Conversation, motions: Sequence[Posed], still: Sequence[Posed]) -> dict[str, float]:
    """Measures of the frames, whose times are the sound's; `still` are the same ones without the layer of nods."""
    both = seen(motions)
    added = [one.pitch - other.pitch for one, other in zip(both, seen(still), strict=True)]
    frames = min(len(one.looks) for one in both)
    only = alone(conversation, frames)
    listening, speaking, first = [], [], []
    for one in (0, 1):
        looks = both[one].looks[:frames]
        listening.append(looks[only[1 - one]])
        speaking.append(looks[only[one]])
        for turn in conversation.turns:
            begin = int(turn.start * FRAME_RATE)
            if turn.who == one or begin >= frames or looks[begin]:
                continue
            after = np.flatnonzero(looks[begin : int(turn.end * FRAME_RATE)])
            if len(after):
                first.append(after[0] / FRAME_RATE)
    mutual = both[0].looks[:frames] & both[1].looks[:frames]
    counts = [answers(conversation.voices[1 - one], nods(added[one][:frames]), only[1 - one]) for one in (0, 1)]
    found, near, listened, ends = np.sum(counts, 0)
    return {
        "looks at the speaker while listening": float(np.mean(np.concatenate(listening))),
        "looks at the listener while speaking": float(np.mean(np.concatenate(speaking))),
        "mutual gaze": float(mutual.mean()),
        "first look at a new speaker, s, median": float(np.median(first)) if first else float("nan"),
        "nods, a minute of listening": float(60 * FRAME_RATE * found / listened),
        "of them within 1.2 s of a phrase's end": float(near / max(found, 1)),
        "by chance": float(ends / listened),
        "eyes, degrees a frame, 99.9 %": float(np.percentile([one.turned[:frames] for one in both], 99.9)),
    }


def answers(voice: np.ndarray, nodded: np.ndarray, listens: np.ndarray) -> tuple[int, int, int, int]:
    """Nods while the other speaks; those after the end of a phrase; frames of listening; those after such ends."""
    power = [np.mean(part**2) for part in np.array_split(voice, max(len(voice) * FRAME_RATE // SAMPLE_RATE, 1))]
    sounds = (np.sqrt(power) > 0.01)[: len(listens)]
    pause = int(PAUSE_S * FRAME_RATE)
    ends = [at for at in np.flatnonzero(sounds[:-1] & ~sounds[1:]) if not sounds[at + 1 : at + 1 + pause].any()]
    near = np.zeros(len(listens), bool)
    for at in ends:
        near[at + pause : at + pause + int(PHASE_S * FRAME_RATE)] = True
    # A turn's last phrase is answered after it.
    counts = listens | near
    found = nodded[counts[nodded]]
    return len(found), int(near[found].sum()), int(counts.sum()), int((near & counts).sum())


def leaky(voices: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What the microphones of two people in one room record."""
    return voices[0] + LEAK * voices[1], voices[1] + LEAK * voices[0]


def open_mouths(conversation: Conversation, motions: Sequence[Posed]) -> float:
    """Share of the frames in which the mouth is open while only the other speaks."""
    only = alone(conversation, min(len(one.jaw) for one in motions))
    jaws = [motion.jaw[: len(only[0])][only[1 - one]] for one, motion in enumerate(motions)]
    return float(np.mean(np.concatenate(jaws) > OPEN))


def animate(
    umo: Path, voices: tuple[np.ndarray, np.ndarray], folder: Path, seed: int, *more: object, is_stereo: bool = False
) -> list[Posed]:
    """Animates the voices: a recording of each, or one with two channels."""
    folder.mkdir(parents=True, exist_ok=True)
    speech, made = ([folder / f"{one}.{kind}" for one in "ab"] for kind in ("wav", "npz"))
    for path, voice in zip(speech, voices, strict=True):
        soundfile.write(path, voice, SAMPLE_RATE)
    if is_stereo:
        soundfile.write(folder / "two.wav", np.stack(voices, 1), SAMPLE_RATE)
        speech = ["--channels", folder / "two.wav"]
    places = " ".join(",".join(f"{value:g}" for value in place) for place in PLACES)
    outputs = [argument for path in made for argument in ("-o", path)]
    program.run(umo, "converse", *speech, *outputs, f"--places={places}", "--seed", seed, *more)
    return [read(path) for path in made]


def read(path: Path) -> Posed:
    with np.load(path) as file:
        turns = Rotation.from_rotvec(file["poses"].reshape(-1, 3)).as_matrix()
        jaw = file["arkit"][:, list(file["arkit_names"]).index("jawOpen")]
        return Posed(turns.reshape(-1, JOINTS, 3, 3), np.asarray(file["trans"], np.float64), jaw)


def markdown(found: Sequence[dict[str, float]]) -> str:
    """Means over conversations, and the range."""
    lines = ["| measure | mean | range |", "| --- | --- | --- |"]
    for name in found[0]:
        values = [one[name] for one in found]
        lines.append(f"| {name} | {np.mean(values):.2f} | {min(values):.2f} to {max(values):.2f} |")
    return "\n".join(lines) + "\n"
