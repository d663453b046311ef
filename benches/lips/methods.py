"""Runs umo and the peers on recordings: for each method a mouth per recording, its time and its bytes."""

import json
import math
import resource
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
import soxr
import visemes
from captured import Recording
from safetensors import safe_open
from safetensors.numpy import load_file, save_file
from umo_train.metrics import lips, program
from umo_train.performer.lips import JAW, lip_opening
from umo_train.skeleton import ARKIT, SHAPE

ROOT = Path(__file__).parents[2]
FRAME_RATE = 30
MODEL_RATE = 16000
BROWSER_RATE = 48000
PICTURES = 60
# Keyframes that the default model can hear ahead of a chunk.
HORIZONS = range(6)
# Seconds of speech over which the time of a program that loads a model is taken, and of the run that is subtracted.
LONG_S, SHORT_S = 30.0, 3.0
DEFAULT = "umo, delayed, hears ahead all it can"
LIVE = "umo, live mouth"


@dataclass(frozen=True)
class Curve:
    """A mouth `[T, 3]`, opening, width and rounding, at `times` in seconds."""

    times: np.ndarray
    mouth: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, self.times, column) for column in self.mouth.T], axis=1)


@dataclass(frozen=True)
class Method:
    """`curves` by recording; `cost` in seconds of a core per second of speech; `size` in bytes, None if it needs none;
    `parts`: how many of opening, width and rounding it has; `is_told`: it gets the text too."""

    name: str
    is_ours: bool
    curves: dict[str, Curve]
    cost: float
    size: int | None
    parts: int = 3

    @property
    def is_told(self) -> bool:
        return ", told " in self.name


def resampled(one: Recording, rate: int) -> np.ndarray:
    return soxr.resample(one.samples, one.rate, rate) if one.rate != rate else one.samples


def write_wav(path: Path, samples: np.ndarray, rate: int) -> None:
    soundfile.write(path, samples, rate, subtype="PCM_16")


# umo.


def arkit_mouth(coefficients: np.ndarray) -> np.ndarray:
    """ARKit's 52 coefficients `[T, 52]` to the mouth `[T, 3]`: `lip_opening`, `lips.width`, and pucker with funnel."""
    rounding = coefficients[:, SHAPE["mouthPucker"]] + coefficients[:, SHAPE["mouthFunnel"]]
    face = np.concatenate([np.zeros((len(coefficients), JAW)), coefficients], axis=1)
    return np.stack([lip_opening(face), lips.width(face), rounding], axis=1)


def arkit_visemes(coefficients: np.ndarray) -> np.ndarray:
    """ARKit's coefficients to the weights of 15 visemes as libumo gives them: read from `umo-core/pose/src/visemes.rs`,
    so that its table is not written twice."""
    source = (ROOT / "umo-core/pose/src/visemes.rs").read_text()

    def table(name: str) -> str:
        return source.split(f"const {name}:", 1)[1].split("= ", 1)[1].split(";\n", 1)[0]

    def plain(text: str) -> list:
        lines = (line.split("//")[0] for line in text.replace("&", "").splitlines())
        return json.loads("".join(lines).replace(" ", "").replace(",]", "]"))

    features, shapes, scale = plain(table("FEATURES")), np.array(plain(table("SHAPES"))), float(table("WIDTH"))
    values = np.stack([coefficients[:, [SHAPE[name] for name in names]].mean(1) for names in features], axis=1)
    distances = np.square(values[:, None] - shapes).sum(2)
    weights = np.exp(-(distances - distances.min(1, keepdims=True)) / (2 * scale**2))
    weights /= weights.sum(1, keepdims=True)
    # Sealed lips over an open jaw are a PP.
    (least, more), apart, most = (
        json.loads(table(name).translate(str.maketrans("()", "[]"))) for name in ("SEAL", "APART", "SEALED")
    )
    jaw, close, *_, up, down, _ = values.T

    def smooth(x: np.ndarray) -> np.ndarray:
        x = x.clip(0, 1)
        return x * x * (3 - 2 * x)

    given = most * smooth((close - least) / more) * smooth(1 - (jaw - close + (up + down) / 2) / apart)
    weights *= 1 - given[:, None]
    weights[:, 1] += given
    return weights


def _child_seconds(run: Callable[[], object]) -> float:
    """Seconds of a core that the programs started by `run` take."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def slope(recordings: Sequence[Recording], run: Callable[[np.ndarray, int], object]) -> float:
    """Seconds of a core per second of speech, without loading: of `LONG_S` of speech less `SHORT_S`."""
    rate = recordings[0].rate
    speech = np.concatenate([one.samples for one in recordings])[: int(LONG_S * rate)]
    short = speech[: int(SHORT_S * rate)]
    cost = _child_seconds(lambda: run(speech, rate)) - _child_seconds(lambda: run(short, rate))
    return cost / ((len(speech) - len(short)) / rate)


def _read_npz(path: Path) -> np.ndarray:
    with np.load(path) as file:
        order = [list(file["arkit_names"]).index(name) for name in ARKIT]
        return np.asarray(file["arkit"][:, order], np.float64)


def delayed(umo: Path, recordings: Sequence[Recording], horizons: Sequence[int]) -> list[Method]:
    """`umo animate` at each horizon with its other settings as they come; frame `f` is at `f / 30` seconds."""
    out = []
    with tempfile.TemporaryDirectory(prefix="umo-lips-") as name:
        folder = Path(name)
        speech = folder / "speech"
        speech.mkdir()
        for one in recordings:
            write_wav(speech / f"{one.name}.wav", one.samples, one.rate)
        for horizon in horizons:
            made = folder / f"made-{horizon}"
            program.run(umo, "batch", speech, "-o", made, "--format", "npz", "--horizon", horizon)
            faces = {one.name: _read_npz(made / f"{one.name}.npz") for one in recordings}

            def animate(samples: np.ndarray, rate: int, horizon: int = horizon) -> None:
                write_wav(folder / "timed.wav", samples, rate)
                options = ["--horizon", horizon, "--threads", 1]
                program.run(umo, "animate", folder / "timed.wav", "-o", folder / "timed.npz", *options)

            cost = slope(recordings, animate)
            is_default = horizon == max(HORIZONS)
            label = DEFAULT if is_default else f"umo, delayed, hears ahead {horizon / 10:.1f} s"
            times = {name: np.arange(len(face)) / FRAME_RATE for name, face in faces.items()}
            out += _ours(label, faces, times, cost, umo.stat().st_size, through_visemes=is_default)
    return out


def _ours(
    label: str,
    faces: dict[str, np.ndarray],
    times: dict[str, np.ndarray],
    cost: float,
    size: int,
    through_visemes: bool,
) -> list[Method]:
    """A row of umo's coefficients, and one of its visemes."""
    direct = {name: Curve(times[name], arkit_mouth(face)) for name, face in faces.items()}
    out = [Method(label, True, direct, cost, size)]
    if through_visemes:
        mapped = {name: Curve(times[name], visemes.mouth(arkit_visemes(face))) for name, face in faces.items()}
        out.append(Method(f"{label}, through its visemes", True, mapped, cost, size))
    return out


def live(umo: Path, model: Path, recordings: Sequence[Recording]) -> list[Method]:
    """The live mouth (`umo model stage mouth`) as a viewer sees it who hears the sound at once: at each of 60 pictures
    a second, the newest frame whose audio has come."""
    with safe_open(model, "np") as file:
        about = json.loads(file.metadata()["config"])["mouth"]
    columns = [ARKIT.index(name) for name in about["channels"]]
    ahead = about["ahead"] / (FRAME_RATE * about["rows"])

    def stage(samples: np.ndarray, rate: int) -> np.ndarray:
        with tempfile.TemporaryDirectory(prefix="umo-lips-") as name:
            given, made = Path(name, "in.safetensors"), Path(name, "out.safetensors")
            audio = soxr.resample(samples, rate, MODEL_RATE) if rate != MODEL_RATE else samples
            save_file({"audio": np.ascontiguousarray(audio, np.float32)}, given)
            program.run(umo, "model", "stage", "mouth", "--in", given, "--out", made)
            return load_file(made)["channels"]

    faces, times = {}, {}
    for one in recordings:
        channels = stage(one.samples, one.rate)
        pictures = np.arange(math.ceil(one.seconds * PICTURES)) / PICTURES
        # Before the first frame the mouth is at rest, as is the first frame.
        newest = np.floor((pictures - ahead) * FRAME_RATE + 1e-6).astype(int).clip(0, len(channels) - 1)
        faces[one.name] = np.zeros((len(pictures), len(ARKIT)))
        faces[one.name][:, columns] = channels[newest]
        times[one.name] = pictures
    cost = slope(recordings, stage)
    return _ours(LIVE, faces, times, cost, umo.stat().st_size, through_visemes=True)


# Peers.

# Files that a page downloads, in node_modules.
DOWNLOADS = {
    "HeadAudio": [
        "@met4citizen/headaudio/dist/headaudio.min.mjs",
        "@met4citizen/headaudio/dist/headworklet.min.mjs",
        "@met4citizen/headaudio/dist/model-en-mixed.bin",
    ],
    "wLipSync": ["wlipsync/dist/wlipsync-single.js"],
    "wawa-lipsync": ["wawa-lipsync/dist/wawa-lipsync.es.js"],
    "Rhubarb": ["rhubarb-lip-sync-wasm/dist"],
}


def bytes_of(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(one.stat().st_size for one in path.rglob("*") if one.is_file() and "__pycache__" not in one.parts)


def named(label: str) -> str:
    """The viseme of a peer's label."""
    return visemes.NAMES.get(label, label)


def mixed(weights: Sequence[dict[str, float]], viseme_of: Callable[[str], str]) -> np.ndarray:
    """Weights by a peer's labels to the mouth `[T, 3]`."""
    rows = np.zeros((len(weights), len(visemes.VISEMES)))
    for row, entry in zip(rows, weights, strict=True):
        for label, weight in entry.items():
            row[visemes.INDEX[viseme_of(label)]] += weight
    return visemes.mouth(rows)


def javascript(folder: Path, recordings: Sequence[Recording], with_rhubarb: bool) -> list[Method]:
    """HeadAudio, wLipSync, wawa-lipsync and Rhubarb in Node (`peers.mjs`)."""
    with tempfile.TemporaryDirectory(prefix="umo-lips-") as name:
        scratch = Path(name)
        entries = []
        for one in recordings:
            files = {"pcm48": scratch / f"{one.name}.48", "pcm16": scratch / f"{one.name}.16"}
            for rate, path in ((BROWSER_RATE, files["pcm48"]), (MODEL_RATE, files["pcm16"])):
                resampled(one, rate).astype("<f4").tofile(path)
            entries.append({"name": one.name, "text": one.text} | {key: str(path) for key, path in files.items()})
        vowels = {}
        for letter, path in vowel_recordings().items():
            samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
            vowels[letter] = str(scratch / f"{letter}.vowel")
            soxr.resample(samples.mean(1), rate, BROWSER_RATE).astype("<f4").tofile(vowels[letter])
        job, output = scratch / "job.json", scratch / "out.json"
        about = {"recordings": entries, "vowels": vowels, "withRhubarb": with_rhubarb, "output": str(output)}
        job.write_text(json.dumps(about))
        # Rhubarb prints a log, shown only if a peer fails.
        script = Path(__file__).with_name("peers.mjs")
        done = subprocess.run(["node", str(script), str(folder), str(job)], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"peers.mjs: {done.stderr[-2000:]}")
        results = json.loads(output.read_text())
    out = []
    for label, made in results.items():
        if not made:
            continue
        package = label.split(",")[0]
        viseme_of = {"wLipSync": visemes.VOWELS.get, "Rhubarb": visemes.RHUBARB.get}.get(package, named)
        curves = {
            name: Curve(np.array(entry["times"]), mixed(entry["weights"], viseme_of)) for name, entry in made.items()
        }
        costs = [made[one.name]["cpu"] / one.seconds for one in recordings]
        size = sum(bytes_of(folder / "node_modules" / path) for path in DOWNLOADS[package])
        out.append(Method(label, False, curves, statistics.median(costs), size))
    return out


def vowel_recordings() -> dict[str, Path]:
    """The five vowels that pylipsync's templates are made of, by uLipSync's letters."""
    import pylipsync

    folder = Path(pylipsync.__file__).parent / "phonemes/audio"
    letters = {"A": "aa", "I": "ih", "U": "ou", "E": "ee", "O": "oh"}
    return {letter: next((folder / name).glob("*.mp3")) for letter, name in letters.items()}


def _timed(
    label: str, recordings: Sequence[Recording], run: Callable[[Recording], Curve], package: Path | None, parts: int = 3
) -> Method:
    curves, costs = {}, []
    for one in recordings:
        before = time.process_time()
        curves[one.name] = run(one)
        costs.append((time.process_time() - before) / one.seconds)
    return Method(label, False, curves, statistics.median(costs), bytes_of(package) if package else None, parts)


def pylipsync_method(recordings: Sequence[Recording]) -> Method:
    """pyLipSync's analyser as it comes, 60 pictures a second; each segment counts at its middle."""
    import pylipsync

    analyzer = pylipsync.PhonemeAnalyzer()

    def run(one: Recording) -> Curve:
        segments = analyzer.extract_phoneme_segments(one.samples, one.rate, return_seconds=True)
        spoken = [{p.name: p.target for p in segment.phonemes if p.name in visemes.VRM} for segment in segments]
        times = np.array([(segment.start + segment.end) / 2 for segment in segments])
        return Curve(times, mixed(spoken, visemes.VRM.__getitem__))

    return _timed("pylipsync", recordings, run, Path(pylipsync.__file__).parent)


def openfacefx_methods(recordings: Sequence[Recording]) -> list[Method]:
    """OpenFaceFX from the loudness; from the text; from the text and the words' times."""
    import openfacefx
    from openfacefx.anchors import Anchor, anchored_segments
    from openfacefx.energy import generate_from_energy
    from openfacefx.g2p import G2P
    from openfacefx.pipeline import generate_from_alignment, generate_naive

    dictionary = G2P()
    dictionary.load_cmudict(str(Path(__file__).with_name("words.dict")))
    package = Path(openfacefx.__file__).parent

    def curve(track, seconds: float) -> Curve:
        times = np.arange(math.ceil(seconds * PICTURES)) / PICTURES
        rows = np.zeros((len(times), len(visemes.VISEMES)))
        for channel in track.channels:
            keys = np.array([(key.time, key.value) for key in channel.keys])
            rows[:, visemes.INDEX[named(channel.name)]] = np.interp(times, *keys.T)
        return Curve(times, visemes.mouth(rows))

    def energy(one: Recording) -> Curve:
        with tempfile.TemporaryDirectory(prefix="umo-lips-") as name:
            path = Path(name, "speech.wav")
            write_wav(path, one.samples, one.rate)
            return curve(generate_from_energy(str(path)), one.seconds)

    def told(one: Recording) -> Curve:
        return curve(generate_naive(one.text, one.seconds, g2p=dictionary), one.seconds)

    def timed(one: Recording) -> Curve:
        anchors = [Anchor(w.text, w.start, w.end) for w in one.words if w.text not in ("sil", "sp")]
        segments = anchored_segments(one.text, one.seconds, anchors, dictionary)
        return curve(generate_from_alignment(segments), one.seconds)

    out = [_timed("OpenFaceFX, loudness", recordings, energy, package)]
    if all(one.words for one in recordings):
        out.append(_timed("OpenFaceFX, told the text", recordings, told, package))
        out.append(_timed("OpenFaceFX, told words and times", recordings, timed, package))
    return out


def loudness(recordings: Sequence[Recording]) -> Method:
    """The speech's envelope as the opening of the lips."""

    def run(one: Recording) -> Curve:
        samples = resampled(one, MODEL_RATE)
        frames = len(samples) * FRAME_RATE // MODEL_RATE
        opening = lips.envelope(samples, frames)
        return Curve(np.arange(frames) / FRAME_RATE, np.stack([opening, 0 * opening, 0 * opening], axis=1))

    return _timed("loudness", recordings, run, None, parts=1)


def all_methods(umo: Path, model: Path, peers: Path, recordings: Sequence[Recording], is_small: bool) -> list[Method]:
    """All, or without the dearest: Rhubarb takes more than a second of a core for a second of speech."""
    horizons = (max(HORIZONS), 0) if is_small else HORIZONS[::-1]
    return [
        *delayed(umo, recordings, horizons),
        *live(umo, model, recordings),
        *javascript(peers, recordings, with_rhubarb=not is_small),
        pylipsync_method(recordings),
        *openfacefx_methods(recordings),
        loudness(recordings),
    ]
