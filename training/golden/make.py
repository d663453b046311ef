"""Makes `tests/golden`: small random model files and the outputs of other implementations for them."""

import argparse
import copy
import json
import platform
from importlib.metadata import version
from pathlib import Path

import torch
from torch import Tensor

import cases
import frame_cases
import layout
import store
import text
import weights
from audio import Mel, front_end
from frames import FrameReference, ResidualMotion
from models import MODELS, Model
from motion import Motion
from reference import Reference

SEED = 20
PACKAGES = ("torch", "transformers", "numpy", "scipy", "safetensors", "sentencepiece")
CALIBRATION_SAMPLES = 48000
CALIBRATION_FRAMES = 600


def round_trip(tensors: dict[str, Tensor], storage: str) -> dict[str, Tensor]:
    return store.unpack(store.pack(tensors, storage))


def fit(model: Model, tensors: dict[str, Tensor]) -> None:
    """Sets the tensors that depend on data: mel normalisation, centroids, and the codebooks behind encoders."""
    stored = round_trip(tensors, model.storage)
    clip = weights.audio(CALIBRATION_SAMPLES, weights.seeded(SEED, model.name, "calibration"))
    if model.config["audio"]["kind"] == "mel":
        features = Mel(model.config, stored).bands(clip)
        # Silence and the clip's edges are outliers that would distort the normalisation.
        loud = features[features[:, 0] > features[:, 0].median() - 4.0]
        tensors["audio.mel.mean"], tensors["audio.mel.scale"] = loud.mean(0), 1.0 / loud.std(0)
        stored = round_trip(tensors, model.storage)
    features = front_end(model.config, stored)(clip)
    rows = features.unique(dim=0)
    generator = weights.seeded(SEED, model.name, "centroids")
    tensors["audio.kmeans.centroids"] = weights.pick_rows(rows, model.config["audio"]["units"], generator)
    if not model.encoders:
        return
    if layout.is_frames(model.config):
        fit_levels(model, tensors, ResidualMotion(model.config, stored))
        return
    motion = Motion(model.config, stored)
    for part, joints in weights.PART_JOINTS.items():
        generator = weights.seeded(SEED, model.name, "codebook", part)
        channels = weights.motion(CALIBRATION_FRAMES, model.config["vq"][part]["channels"], joints, generator)
        book = weights.pick_rows(motion.latents(part, channels), layout.CODES, generator)
        tensors[f"vq.{part}.quantizer.embedding.weight"] = book


def fit_levels(model: Model, tensors: dict[str, Tensor], motion: ResidualMotion) -> None:
    """Fits each level's codebook to the residuals of the levels before it on real latents."""
    body = weights.body(model.config, CALIBRATION_FRAMES, weights.seeded(SEED, model.name, "codebook"))
    for part in motion.parts:
        left, books = motion.latents(part["name"], motion.own(body, part)), []
        for level in range(part["levels"]):
            generator = weights.seeded(SEED, model.name, "codebook", part["name"], level)
            book = weights.pick_rows(left, part["codes"], generator)
            left = left - book[torch.cdist(left, book).argmin(1)]
            books.append(book)
        tensors[f"vq.{part['name']}.quantizer.embedding.weight"] = torch.cat(books)


def make_model(model: Model, folder: Path, tokenizer: bytes) -> Reference | FrameReference:
    """Writes the model file and loads it back into the reference implementations."""
    shapes = layout.shapes(model.config, encoders=model.encoders)
    tensors = weights.draw(model.config, shapes, SEED)
    if model.upcycled:
        weights.upcycle(tensors)
    fit(model, tensors)
    packed = store.pack(tensors, model.storage)
    if model.tokenizer:
        packed["text.tokenizer"] = torch.frombuffer(bytearray(tokenizer), dtype=torch.uint8)
    path = folder / "model.safetensors"
    store.write(path, packed, {"format": "umo", "version": "1", "config": json.dumps(model.config)})
    config, stored = store.read_model(path, shapes, model.storage)
    assert config == model.config
    if layout.is_frames(config):
        return FrameReference(config, stored)
    return Reference(config, stored, dense=model.upcycled)


def make_cases(model: Model, reference: Reference | FrameReference, folder: Path) -> None:
    """Writes inputs and expected outputs; the first two models have the long lists."""
    made = cases.Cases(SEED, reference, copy.deepcopy(reference).double())
    thorough = not model.upcycled and model.storage != "I8"
    kind = model.config["audio"]["kind"]
    cases.add_audio(made, kind, (400, 5000, 16421) if thorough else (6007,))
    if layout.is_frames(model.config):
        frame_cases.add(made, model.config, encoders=model.encoders)
    else:
        cases.add_language_model(made, model.config, (3, 1) if thorough else (2,))
        cases.add_interpolation(made, model.config, (13, 16, 1) if thorough else (9,))
        cases.add_motion(made, (1, 5, 40) if thorough else (11,))
        if model.encoders:
            cases.add_encoders(made, model.config, (1, 23))
    if "mouth" in model.config:
        # One frame; an end within a row; silence in between.
        cases.add_mouth(made, (534, 5000, 20011))
    metadata = {
        "format": "umo-golden",
        "model": model.name,
        "seed": str(SEED),
        "cases": json.dumps(made.notes),
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
    }
    store.write(folder / "cases.safetensors", made.tensors, metadata)
    print(f"{model.name}: {sum(path.stat().st_size for path in folder.iterdir())} bytes")
    print(f"  experts used in each feed-forward: {reference.lm.experts_used()}")
    print(cases.describe(made))
    for name, note in made.notes.items():
        print(f"  {name}: {note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).resolve().parents[2] / "tests" / "golden"
    parser.add_argument("--out", type=Path, default=default, help="folder to write (default: %(default)s)")
    parser.add_argument("--only", help="make only this model")
    options = parser.parse_args()

    torch.set_num_threads(1)
    torch.backends.mha.set_fastpath_enabled(False)
    tokenizer = text.make(options.out / "text")
    with torch.no_grad():
        for model in MODELS:
            if options.only in (None, model.name):
                folder = options.out / model.name
                make_cases(model, make_model(model, folder, tokenizer), folder)


if __name__ == "__main__":
    main()
