"""BEAT2: SMPL-X motion with speech."""

import csv
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from umo_train.data import recording, smplx
from umo_train.data.alignment import alignment
from umo_train.data.clip import Clip, DataError, file, folder
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, Utterance

SPLITS = ("train", "val", "test", "additional")
LIST = "train_test_split.csv"
_MOTION, _SPEECH, _WORDS = "smplxflame_30", "wave16k", "textgrid"
_FETCH = "fetch the data set BEAT2, and name the folder of one language, such as beat_english_v2.0.0"
# Number of face values after the jaw.
EXPRESSION = 100


def beat2(root: Path, split: str, speakers: Collection[int] | None = None) -> Iterator[Clip]:
    """Clips of a split, of all speakers or the given ones; faces are the jaw and 100 expression coefficients."""
    if split not in SPLITS:
        raise DataError(f"no split `{split}`: {', '.join(SPLITS)}")
    folder(root, _FETCH)
    for part in (_MOTION, _SPEECH, _WORDS):
        folder(root / part, _FETCH)
    names = _names(file(root / LIST, _FETCH), split, speakers)
    if not names:
        raise DataError(f"{root / LIST}: no clip of the split `{split}`{_of(speakers)}")
    return (_clip(root, name) for name in names)


def _of(speakers: Collection[int] | None) -> str:
    return "" if speakers is None else f" of speakers {', '.join(map(str, sorted(speakers)))}"


def speaker(name: str) -> int:
    """Speaker number from a clip's name, such as 2 from `2_scott_0_1_1`."""
    number = name.split("_")[0]
    if not number.isdecimal():
        raise DataError(f"clip `{name}`: expected a name such as 2_scott_0_1_1, which begins with the speaker's number")
    return int(number)


def _names(path: Path, split: str, speakers: Collection[int] | None) -> list[str]:
    with path.open(newline="", encoding="utf-8-sig") as lines:
        rows = csv.DictReader(lines)
        if not {"id", "type"} <= set(rows.fieldnames or ()):
            raise DataError(f"{path}: expected columns id and type, got {', '.join(rows.fieldnames or ()) or 'none'}")
        names = [row["id"] for row in rows if row["type"] == split]
    return [name for name in names if speakers is None or speaker(name) in speakers]


def _clip(root: Path, name: str) -> Clip:
    listed = f"{LIST} lists it: fetch it, or take its line out"
    path = file(root / _MOTION / f"{name}.npz", listed)
    sound = recording.samples(file(root / _SPEECH / f"{name}.wav", listed))
    words_file = file(root / _WORDS / f"{name}.TextGrid", listed)
    motion, translation = read_motion(path)
    # Motion and sound end at slightly different times.
    frames = min(len(translation), len(sound) * FRAME_RATE // SAMPLE_RATE)
    if frames == 0:
        raise DataError(f"{path}: no frame with speech")
    sound = sound[: -(-frames * SAMPLE_RATE // FRAME_RATE)]
    words, phones = alignment(words_file, len(sound) / SAMPLE_RATE)
    text = " ".join(word.text for word in words)
    speech = Utterance(f"beat2_{speaker(name)}", text, sound, phones, words)
    motion = {part: values[:frames] for part, values in motion.items()}
    return Clip(name, str(speaker(name)), speech, motion, translation[:frames])


def read_motion(path: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels of the four parts, and the pelvis' positions, of a motion file."""
    arrays = smplx.load(path, ("poses", "trans", "expressions"), ("mocap_frame_rate",))
    rate = float(arrays.get("mocap_frame_rate", FRAME_RATE))
    matrices, translation, face = smplx.pose(path, arrays["poses"]), arrays["trans"], arrays["expressions"]
    frames = len(matrices)
    for key, values, width in (("trans", translation, 3), ("expressions", face, EXPRESSION)):
        if values.shape != (frames, width):
            raise DataError(f"{path}: {key} of shape {list(values.shape)}, expected [{frames}, {width}]")
    if rate != FRAME_RATE:
        matrices = smplx.resampled_rotations(matrices, rate)
        translation, face = smplx.resampled(translation, rate), smplx.resampled(face, rate)
    return smplx.channels(matrices, translation, face), translation.astype(np.float32)
