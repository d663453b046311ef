"""An item of an evaluation: speech, its phones, and the performer's motion."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from umo_train.skeleton import CHANNELS, PARTS
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, Phone

# Channels `[T, C]` of each part.
Motion = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Word:
    """A word with its punctuation, and its time in seconds."""

    text: str
    start: float
    end: float

    @property
    def name(self) -> str:
        return re.sub(r"^\W+|\W+$", "", self.text.lower())


@dataclass(frozen=True)
class Item:
    """Speech at 16 kHz, -1..1. `phones` is empty and `motion` None if unknown (real recordings).

    `takes` are the performer's other motions for the same speech, by text prompt: several of one prompt differ in their
    seed. They show how varied the model could be.
    """

    name: str
    voice: str
    samples: np.ndarray
    phones: tuple[Phone, ...] = ()
    motion: Motion | None = None
    takes: Mapping[str, Sequence[Motion]] = field(default_factory=dict)
    # Criterion by which held-out items were selected, such as "voice" or "sentence".
    split: str = ""
    # Prompt of `motion`, also given to the model.
    prompt: str = ""
    # `motion` with another seed: the performer's distance to itself is the noise of a distance.
    again: Motion | None = None
    # Words with their times, if known.
    words: tuple[Word, ...] = ()

    @property
    def seconds(self) -> float:
        return len(self.samples) / SAMPLE_RATE

    @property
    def frames(self) -> int:
        return len(self.samples) * FRAME_RATE // SAMPLE_RATE


def _parts(motion: Motion, prefix: str) -> dict[str, np.ndarray]:
    return {f"{prefix}{part}": np.asarray(motion[part], np.float32) for part in PARTS}


def save(item: Item, path: Path) -> None:
    """Writes one `.npz`."""
    takes = {prompt: len(motions) for prompt, motions in item.takes.items()}
    about = {
        "name": item.name,
        "voice": item.voice,
        "split": item.split,
        "prompt": item.prompt,
        "phones": [(p.name, p.start, p.end, p.stress) for p in item.phones],
        "takes": list(takes.items()),
    }
    arrays = {"about": np.array(json.dumps(about)), "samples": np.asarray(item.samples, np.float32)}
    arrays |= _parts(item.motion, "motion.") if item.motion is not None else {}
    arrays |= _parts(item.again, "again.") if item.again is not None else {}
    for number, motions in enumerate(item.takes.values()):
        for take, motion in enumerate(motions):
            arrays |= _parts(motion, f"take.{number}.{take}.")
    np.savez_compressed(path, **arrays)


def load(path: Path) -> Item:
    """Reads the output of `save`.

    Raises `ValueError`, naming the file, if a part's channels differ from the skeleton's.
    """
    with np.load(path) as file:
        arrays = dict(file)
    about = json.loads(str(arrays["about"]))

    def motion(prefix: str) -> Motion:
        parts = {part: arrays[f"{prefix}{part}"] for part in PARTS}
        for part, channels in parts.items():
            if channels.ndim != 2 or channels.shape[1] != CHANNELS[part]:
                raise ValueError(f"{path}: {part}: expected [frames, {CHANNELS[part]}], got {list(channels.shape)}")
        return parts

    return Item(
        about["name"],
        about["voice"],
        arrays["samples"],
        tuple(Phone(*phone) for phone in about["phones"]),
        motion("motion.") if "motion.face" in arrays else None,
        {
            prompt: [motion(f"take.{number}.{take}.") for take in range(count)]
            for number, (prompt, count) in enumerate(about["takes"])
        },
        about["split"],
        about["prompt"],
        motion("again.") if "again.face" in arrays else None,
    )


def load_folder(folder: Path) -> list[Item]:
    """All items in a folder of `save` files, by name."""
    paths = sorted(Path(folder).glob("*.npz"))
    if not paths:
        raise FileNotFoundError(f"{folder}: no evaluation items (*.npz)")
    return [load(path) for path in paths]


def from_corpus(folder: Path, split: str, most: int, varied: int, seeds: int) -> list[Item]:
    """The first `most` items of a split of the corpus, with the performer's motion.

    The performer animates the first `varied` of them again, in every style and `seeds` times each (a style is named by
    the first of its prompts, and the neutral one by none), and each item once in its own style.
    """
    from umo_train.data import corpus
    from umo_train.performer import perform
    from umo_train.performer.style import PROMPTS, STYLES

    out = []
    for number, item in enumerate(islice(corpus.items(folder, split), most)):
        speech = item.utterance
        takes = {
            PROMPTS[name][0]: [perform(speech, style, 1_000_000 + seed) for seed in range(seeds)]
            for name, style in (STYLES.items() if number < varied else ())
        }
        again = perform(speech, STYLES[item.style], 1_000_000 + item.seed)
        motion = corpus.read_motion(folder, item.name)
        out.append(
            Item(item.name, speech.voice, speech.samples, speech.phones, motion, takes, split, item.prompt, again)
        )
    return out


def speaker_of(path: Path) -> str:
    """The first word of a file's name: `p225_003.wav`, `198-209-0000.ogg` and `Mark_joy.wav` start with the speaker."""
    return path.name.replace("-", "_").replace(".", "_").split("_")[0]


def readers(folder: Path) -> set[str]:
    """Speakers of the corpus' training split, as named by `speaker_of`."""
    from umo_train.data import corpus

    return {re.split("[-/]", entry.voice)[-1] for entry in corpus.entries(folder, "train")}


def captured(folder: Path) -> list[tuple[Item, np.ndarray]]:
    """Speech with a captured mouth: for each sound file the item, and the mouth's opening `[T]` at 30 frames a second
    in any unit, from `opening` in the `.npz` beside it."""
    out = []
    for path in sorted(Path(folder).glob("*.npz")):
        sounds = [path.with_suffix(suffix) for suffix in (".wav", ".flac", ".ogg", ".opus")]
        sound = next((one for one in sounds if one.exists()), None)
        if sound is None:
            raise FileNotFoundError(f"{path}: no sound beside it ({path.stem}.wav, .flac, .ogg, .opus)")
        with np.load(path) as file:
            out.append((recording(sound), np.asarray(file["opening"], np.float64)))
    if not out:
        raise FileNotFoundError(f"{folder}: no captured mouths (*.npz)")
    return out


def recording(path: Path) -> Item:
    """A file of any rate, resampled to 16 kHz mono."""
    import librosa

    return Item(path.stem, speaker_of(path), librosa.load(path, sr=SAMPLE_RATE, mono=True)[0])


def recordings(folder: Path) -> list[Item]:
    """Real speech below a folder (`.wav`, `.flac`, `.ogg`)."""
    paths = sorted(p for p in Path(folder).rglob("*") if p.suffix.lower() in {".wav", ".flac", ".ogg"})
    if not paths:
        raise FileNotFoundError(f"{folder}: no recordings (*.wav, *.flac, *.ogg)")
    return [recording(path) for path in paths]
