"""Speech with motion from anywhere, as a judge sees it: animated by the program, captured, or made by another model."""

import argparse
import csv
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import wavfile

from umo_train.data import recording, smplx
from umo_train.data.beat2 import LIST as BEAT2_LIST
from umo_train.data.beat2 import SPLITS, beat2, read_motion
from umo_train.metrics import item, program, words
from umo_train.metrics.item import Motion, Word
from umo_train.metrics.lips import envelope
from umo_train.metrics.motion import joint_places
from umo_train.performer.lips import JAW, lip_opening
from umo_train.skeleton import ARKIT, JOINT, JOINTS_OF, matrices
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

if TYPE_CHECKING:
    from umo_train.mouth.run import Mouth

VIEWS = ("body", "face")
# Upper body, ankles (the weight's shifts), eyes for the head's direction, tips of three fingers.
SEEN = (
    *JOINTS_OF["upper"],
    *(JOINT[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "eye", "index3", "pinky3", "thumb3")),
)
_SOUNDS = (".wav", ".flac", ".ogg", ".opus")
# Pairs of MediaPipe's points whose distance is a channel: lips inside and outside, corners, jaw, lids, brows.
_DISTANCES = ((13, 14), (0, 17), (61, 291), (78, 308), (1, 152), (1, 13), (159, 145), (386, 374), (105, 33), (334, 263))
_EYES = (33, 263)
_LANDMARKS_RATE = 25.0


@dataclass(frozen=True)
class Take:
    """Speech at 16 kHz and what is seen of its motion at 30 frames a second, by view `[T, C]`; `motion` if it has a
    body."""

    name: str
    speaker: str
    samples: np.ndarray
    seen: Mapping[str, np.ndarray]
    # What moves most in each view, for a judge without a network: speed of the upper body, opening of the lips.
    energy: Mapping[str, np.ndarray]
    motion: Motion | None = None
    words: Sequence[Word] = ()

    @property
    def frames(self) -> int:
        """Frames with speech and motion."""
        return min(len(self.samples) * FRAME_RATE // SAMPLE_RATE, *map(len, self.seen.values()))

    @cached_property
    def loudness(self) -> np.ndarray:
        return envelope(self.samples, self.frames)


def body(motion: Motion) -> np.ndarray:
    """Positions of joints in the pelvis' frame, metres `[T, 3 len(SEEN)]`."""
    at = joint_places(motion, walking=False)[:, SEEN]
    pelvis = matrices(np.asarray(motion["lower"][:, :6], np.float64))
    return np.einsum("tji,twj->twi", pelvis, at).reshape(len(at), -1)


def upper_speed(body: np.ndarray) -> np.ndarray:
    """Mean speed of the upper body's joints, metres in a frame `[T]`."""
    upper = body[:, : 3 * len(JOINTS_OF["upper"])].reshape(len(body), -1, 3)
    return np.linalg.norm(np.gradient(upper, axis=0), axis=-1).mean(1)


def of_motion(name: str, speaker: str, samples: np.ndarray, motion: Motion) -> Take:
    seen = {"body": body(motion), "face": np.asarray(motion["face"], np.float64)}
    mouth = lip_opening(motion["face"]) if is_arkit(motion["face"]) else change(seen["face"])
    return Take(name, speaker, samples, seen, {"body": upper_speed(seen["body"]), "face": mouth}, motion)


def is_arkit(face: np.ndarray) -> bool:
    return face.shape[1] == JAW + len(ARKIT)


def change(channels: np.ndarray) -> np.ndarray:
    """Size of the change of channels in a frame, each relative to its own deviation `[T]`."""
    steps = np.gradient(channels, axis=0)
    return np.linalg.norm(steps / (channels.std(0) + 1e-6), axis=1)


def _of_face(name: str, speaker: str, samples: np.ndarray, face: np.ndarray, opening: np.ndarray | None) -> Take:
    energy = change(face) if opening is None else opening
    return Take(name, speaker, samples, {"face": np.asarray(face, np.float64)}, {"face": energy})


def animated(
    umo: Path, model: Path | None, speech: Sequence[item.Item], arguments: Sequence[str], seed: int, work: Path
) -> list[Take]:
    """The program's motion for recordings with arguments of `umo animate`, kept in `work`: what is there with the same
    settings is not made again. `--words` stands alone: it gives the recordings' own."""
    own = argparse.ArgumentParser(add_help=False)
    # A batch has it in its lines.
    own.add_argument("--prompt")
    own.add_argument("--words", action="store_true")
    given, others = own.parse_known_args(arguments)
    # The program knows a finished line by its whole path.
    work = work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    lines, paths = [], []
    for one in speech:
        sound = work.parent / "speech" / f"{one.name}.wav"
        if not sound.exists():
            sound.parent.mkdir(exist_ok=True)
            wavfile.write(sound, SAMPLE_RATE, one.samples)
        paths.append(work / f"{one.name}.npz")
        line = {"file": str(sound), "output": paths[-1].name} | ({"prompt": given.prompt} if given.prompt else {})
        if given.words:
            line["words"] = str(sound.with_suffix(".ctm"))
            words.write(sound.with_suffix(".ctm"), one.words)
        lines.append(json.dumps(line))
    manifest = work / "manifest.jsonl"
    manifest.write_text("\n".join(lines) + "\n")
    options = ["--model", model] if model else []
    program.run(umo, "batch", manifest, "-o", work, "--seed", seed, *options, *others)
    return [
        replace(of_motion(one.name, one.voice, one.samples, program.from_npz(path)), words=one.words)
        for one, path in zip(speech, paths, strict=True)
    ]


def of_mouth(mouth: "Mouth", speech: Sequence[item.Item]) -> list[Take]:
    """The live mouth's channels for recordings."""
    faces = [mouth(one.samples)[0] for one in speech]
    return [
        _of_face(one.name, one.voice, one.samples, face, lip_opening(face))
        for one, face in zip(speech, faces, strict=True)
    ]


def joined(folders: Sequence[Path], voices: Sequence[Path], seconds: float, minutes: float) -> list[item.Item]:
    """Recordings of at least `seconds`, clips of a speaker joined for it, at most `minutes` of each speaker.

    In `folders` a file's first word is its speaker; each of `voices` is one speaker's, with its `text.csv` if it has
    one, and then without repeated texts.
    """
    clips: dict[str, list[Path]] = defaultdict(list)
    said: dict[Path, str] = {}
    for folder in (*folders, *voices):
        paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SOUNDS)
        if not paths:
            raise FileNotFoundError(f"{folder}: no recordings ({', '.join(_SOUNDS)})")
        known = words.texts(folder) if folder in voices else {}
        said |= {path: known[path.stem] for path in paths if path.stem in known}
        for path in paths if not known else [path for path in paths if path in said]:
            clips[folder.name if folder in voices else item.speaker_of(path)].append(path)
    return [one for speaker, paths in sorted(clips.items()) for one in _joined(speaker, paths, said, seconds, minutes)]


def _joined(
    speaker: str, paths: Sequence[Path], said: Mapping[Path, str], seconds: float, minutes: float
) -> Iterator[item.Item]:
    left, count = minutes * 60 * SAMPLE_RATE, 0
    piece: list[np.ndarray] = []
    spoken: list[Word] = []
    for number, path in enumerate(paths):
        if left <= 0:
            return
        samples, before = recording.samples(path), count / SAMPLE_RATE
        piece.append(samples)
        for word in words.spread(said[path], samples) if path in said else ():
            spoken.append(replace(word, start=before + word.start, end=before + word.end))
        count += len(samples)
        if count >= seconds * SAMPLE_RATE:
            yield item.Item(f"{speaker}_{number:04}", speaker, np.concatenate(piece), words=tuple(spoken))
            left, count, piece, spoken = left - count, 0, [], []


def from_folder(folder: Path) -> list[Take]:
    """Takes of a folder: BEAT2 (of one language), landmarks of a talker (`landmarks_*.npz` and `audio`), or `.npz`
    beside their sound: SMPL-X motion as `umo animate` and BEAT2 have it, or a face alone (`weights [T, C]`, or
    `opening [T]`)."""
    if (folder / BEAT2_LIST).exists():
        return list(_beat2(folder))
    if (folder / "landmarks_0.npz").exists():
        return sorted(_landmarks(folder), key=lambda take: take.name)
    takes = [take for path in sorted(folder.rglob("*.npz")) if (take := _beside(path)) is not None]
    if not takes:
        raise FileNotFoundError(f"{folder}: no motion (*.npz) beside its sound ({', '.join(_SOUNDS)})")
    return takes


def _beat2(folder: Path) -> Iterator[Take]:
    with (folder / BEAT2_LIST).open(newline="", encoding="utf-8-sig") as lines:
        listed = {row.get("type") for row in csv.DictReader(lines)}
    for split in SPLITS:
        if split in listed:
            for clip in beat2(folder, split):
                yield of_motion(clip.name, clip.speaker, clip.speech.samples, clip.motion)


def _beside(path: Path) -> Take | None:
    sound = next((one for suffix in _SOUNDS if (one := path.with_suffix(suffix)).exists()), None)
    if sound is None:
        return None
    samples, speaker = recording.samples(sound), item.speaker_of(sound)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files if name in ("poses", "arkit", "weights", "opening")}
    if "poses" in arrays:
        motion = program.from_npz(path) if "arkit" in arrays else read_motion(path)[0]
        return of_motion(path.stem, speaker, samples, motion)
    opening = arrays.get("opening")
    if "weights" in arrays:
        return _of_face(path.stem, speaker, samples, arrays["weights"], opening)
    if opening is None:
        raise ValueError(f"{path}: expected poses, weights or opening")
    return _of_face(path.stem, speaker, samples, opening[:, None], opening)


def _landmarks(folder: Path) -> Iterator[Take]:
    """Distances between points of a face over the distance of its eyes; the head's own motion is not in them."""

    def distance(points: np.ndarray, order: Mapping[int, int], pair: tuple[int, int]) -> np.ndarray:
        first, second = (points[:, order[point]] for point in pair)
        return np.linalg.norm(first - second, axis=-1)

    for path in sorted(folder.glob("landmarks_*.npz")):
        with np.load(path) as file:
            order = {int(point): index for index, point in enumerate(file["index"])}
            names, places = file["names"], file["landmarks"].astype(np.float32)
        for name, points in zip(names, places, strict=True):
            eyes = distance(points, order, _EYES)
            channels = np.stack([distance(points, order, pair) / eyes for pair in _DISTANCES], 1)
            channels = smplx.resampled(channels, _LANDMARKS_RATE)
            samples = recording.samples(folder / "audio" / f"{name}.opus")
            yield _of_face(str(name), folder.name, samples, channels, channels[:, 0])
