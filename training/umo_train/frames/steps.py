"""The steps of a plan of layout `frames`, where they differ from the paper's layout (`umo_train/pipeline.py`)."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from tqdm import tqdm

from umo_train import export, processes
from umo_train.audio import tokens
from umo_train.data import corpus
from umo_train.device import best
from umo_train.frames import parts, report
from umo_train.frames.examples import FrameExamples, FrameStream
from umo_train.frames.interp import VectorInterpolation, VectorPlan
from umo_train.frames.interp import train as train_interp
from umo_train.frames.model import FrameModel, for_file
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.frames.tokenizers import (
    RootItem,
    RootPlan,
    decoded,
    plan_of,
    tokenize,
    train_part,
    train_root,
)
from umo_train.frames.train import FrameStagePlan, train_stage
from umo_train.lm import moe
from umo_train.metrics.item import Item, Motion
from umo_train.model_config import AUDIO_TASK, END, MOTION_TASK, TEXT_END, TEXT_TASK, common_sizes, face, pieces
from umo_train.motion.networks import RootNetwork
from umo_train.performer import intent, perform
from umo_train.performer.style import PROMPTS, STYLES
from umo_train.plan import Config, Run
from umo_train.skeleton import CHANNELS
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance

# Places for a prompt, which are empty without one: guidance goes from the second to the first (SPEC 2.16).
TEMPLATES: dict[str, list[Any]] = {
    "audio_to_motion": [AUDIO_TASK, "audio", MOTION_TASK, TEXT_TASK, "text", TEXT_END, "history", END],
    "text_to_motion": [TEXT_TASK, "text", TEXT_END, "history", END],
}
INTENT = "intent"


def names_of_face(s: Run) -> list[str]:
    return face(s.plan)["names"]


def parts_of(s: Run) -> list[Part]:
    """The plan's parts. An annotation is `intent`, whose codes the performer says.

    Raises `ValueError` for an annotation that nobody makes.
    """
    out = parts.read(s.plan, names_of_face(s))
    for part in out:
        if not part.moves and (part.name, part.codes, part.levels) != (INTENT, intent.CODES, 1):
            raise ValueError(f"part `{part.name}` has no channels: the performer says `{INTENT}` alone, "
                             f"of {intent.CODES} codes and 1 level")  # fmt: skip
    return out


def moving(s: Run) -> list[Part]:
    """The parts that have channels."""
    return [part for part in parts_of(s) if part.moves]


def names(s: Run, split: str, *, spoken: bool) -> list[str]:
    """Items of a split that have a motion, and speech if asked."""
    made = {path.stem for path in corpus.paths(s.corpus, "motion")}
    entries = corpus.entries(s.corpus, split)
    return [entry.name for entry in entries if entry.name in made and (entry.spoken or not spoken)]


def step_tokenizers(s: Run, only: tuple[str, ...] = ()) -> None:
    """Needs one part's motion of every training item in memory."""
    given = {entry["name"]: entry for entry in s.plan["parts"]}
    stride, seed = s.plan["window"]["keyframe_stride"], s.plan["seed"]
    for part in moving(s):
        if only and part.name not in only:
            continue
        region, at = parts.columns(part, names_of_face(s))
        # Faces move with speech: where there is none, they are at rest throughout.
        items = names(s, "train", spoken=region == "face")
        motions = [corpus.read_motion(s.corpus, item, (region,))[region][:, at] for item in items]
        train_part(plan_of(s.plan["tokenizers"], given[part.name], stride, seed), part, motions, s.folder)
    if not only or "root" in only:
        _train_root(s)


def _train_root(s: Run) -> None:
    """Needs the lower body's tokenizers: the root follows what their codes say."""
    models = tokenizers(s, "lower")
    order, stride = [part for part in moving(s) if part.name in models], s.plan["window"]["keyframe_stride"]
    items = []
    for name in tqdm(names(s, "train", spoken=False), "lower body"):
        motion = corpus.read_motion(s.corpus, name, ("lower", "height"))
        said: list[np.ndarray] = [motion["lower"].copy() for _ in range(2)]
        for part in order:
            _, at = parts.columns(part, names_of_face(s))
            codes = tokenize(models[part.name], motion["lower"][:, at])
            for lower, each in zip(said, (1, stride), strict=True):
                lower[:, at] = decoded(models[part.name], codes, stride=each)
        items.append(RootItem(motion["lower"], tuple(said), motion["height"]))
    train_root(root_plan(s), items, s.folder)


def root_plan(s: Run) -> RootPlan:
    return RootPlan(**s.plan["tokenizers"]["root"], seed=s.plan["seed"])


def root_network(s: Run) -> RootNetwork:
    plan = root_plan(s)
    model = RootNetwork(plan.width, CHANNELS["lower"], plan.layers)
    model.load_state_dict(_trained(s.folder / "tokenizer_root.pt", "model"))
    return model.eval()


def tokenizers(s: Run, of: str | None = None) -> dict[str, ResidualVqVae]:
    """Of every part with channels, or of those of one body part."""
    out = {}
    for part in moving(s):
        region, at = parts.columns(part, names_of_face(s))
        if of is None or region == of:
            model = ResidualVqVae(part, len(at))
            model.load_state_dict(_trained(s.folder / f"tokenizer_{part.name}.pt", "model"))
            out[part.name] = model.eval()
    return out


def _trained(path: Path, name: str) -> Config:
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: run the step that makes it first")
    return torch.load(path, map_location="cpu", weights_only=True)[name]


def step_report(s: Run) -> None:
    """`run/tokenizers.md` and `.json`: what goes through the tokenizers, on items that none of them was trained on."""
    items = []
    for split in ("test_voice", "test_sentence"):
        for item in corpus.items(s.corpus, split):
            speech = item.utterance
            motion = corpus.read_motion(s.corpus, item.name)
            items.append(Item(item.name, speech.voice, speech.samples, speech.phones, motion, split=split))
    rows = report.measure(
        items, tokenizers(s), moving(s), names_of_face(s), root_network(s), s.plan["window"]["keyframe_stride"]
    )
    report.write(rows, s.folder)
    print(report.markdown(rows))


def codes_of(s: Run, order: list[Part], models: dict[str, ResidualVqVae], motion: Motion) -> np.ndarray:
    """Codes of every frame `[T, J]`; those of an annotation are the motion's own."""
    out = []
    for part in order:
        if part.moves:
            out.append(tokenize(models[part.name], parts.own(part, names_of_face(s), motion)))
        else:
            out.append(np.asarray(motion[part.name])[:, None].astype(np.int16))
    return np.concatenate(out, 1)


def step_codes(s: Run) -> None:
    """Every item's motion as codes, `run/codes/NAME.npy` `[T, J]`, and the codes of standing still, `run/rest.yaml`."""
    out = s.folder / "codes"
    out.mkdir(parents=True, exist_ok=True)
    order, models = parts_of(s), {name: model.to(best()) for name, model in tokenizers(s).items()}
    silent = {entry.name for entry in corpus.entries(s.corpus) if not entry.spoken}
    of_face = is_face(s)
    for path in tqdm(corpus.paths(s.corpus, "motion"), "codes"):
        target = out / f"{path.stem}.npy"
        if target.exists():
            continue
        motion = corpus.read_motion(s.corpus, path.stem)
        if any(part.name == INTENT for part in order):
            motion[INTENT] = corpus.read_intent(s.corpus, path.stem)
        codes = codes_of(s, order, models, motion)
        if path.stem in silent:
            # Nobody says what a face does that was not recorded.
            codes[:, np.repeat(of_face, [part.levels for part in order])] = -1
        np.save(target, codes)
    still = perform(_silence(20.0), STYLES["neutral"], 0)
    codes = codes_of(s, order, models, still)[30:]
    rest, at = {}, 0
    for part in order:
        rest[part.name] = middle(codes[:, at : at + part.levels], models.get(part.name))
        at += part.levels
    (s.folder / "rest.yaml").write_text(yaml.safe_dump(rest))


def is_face(s: Run) -> list[bool]:
    """Of each part, whether it is of the face."""
    return [part.moves and parts.columns(part, names_of_face(s))[0] == "face" for part in parts_of(s)]


@torch.no_grad()
def middle(codes: np.ndarray, model: ResidualVqVae | None) -> list[int]:
    """The codes, of `[T, levels]`, whose vector is nearest to the mean of all; of an annotation the most frequent."""
    if model is None:
        return [int(np.bincount(level).argmax()) for level in codes.T]
    vectors = model.vectors(torch.from_numpy(codes.astype(np.int64)).to(model.mean.device))
    return codes[int((vectors - vectors.mean(0)).square().sum(1).argmin())].tolist()


def _silence(seconds: float) -> Utterance:
    samples = np.zeros(int(seconds * SAMPLE_RATE), np.float32)
    return Utterance("silence", "", samples, (Phone(SILENCE, 0.0, seconds),))


def model_file_config(s: Run) -> Config:
    """`config` of the model file."""
    rest = yaml.safe_load((s.folder / "rest.yaml").read_text())
    config = common_sizes(s, ()) | {
        "layout": "frames",
        "parts": [part.config(rest[part.name]) for part in parts_of(s)],
        "depth": s.plan["depth"],
        "vq": {
            "width": root_plan(s).width,
            "root": {"channels": CHANNELS["lower"], "layers": root_plan(s).layers},
        },
        "templates": TEMPLATES,
    }
    config["audio"]["ahead"] = s.plan["audio"].get("ahead", 0)
    if "speech" in s.plan:
        config["prompts"] = [prompt for prompts in PROMPTS.values() for prompt in prompts if prompt]
    return config


def examples(s: Run, config: Config, split: str, *, augment: bool) -> FrameExamples:
    """Codes, units and prompts of a split."""
    streams = []
    for entry in corpus.entries(s.corpus, split):
        found = [s.folder / kind / f"{entry.name}.npy" for kind in ("codes", "audio_tokens")]
        codes, units = (np.load(path) if path.exists() else None for path in found)
        if codes is None and units is None:
            continue
        prompts = PROMPTS[entry.style] if entry.style in PROMPTS else entry.prompt.split("\n")
        ids = tuple(np.array(pieces(s).encode(prompt), np.int64) for prompt in prompts)
        streams.append(FrameStream(codes, units, ids))
    tokenizer = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    silence = int(tokenizer(np.zeros(SAMPLE_RATE, np.float32))[20])
    delay = s.plan["audio"].get("listener", {}).get("delay")
    body = [not of_face for of_face in is_face(s)]
    return FrameExamples(config, parts_of(s), body, streams, silence, augment=augment, delay=delay)


def stage_plan(s: Run, stage: Config) -> FrameStagePlan:
    given = stage | ({"targets": tuple(stage["targets"])} if "targets" in stage else {})
    return FrameStagePlan(**{"seed": s.plan["seed"]} | given)


def step_lm(s: Run) -> None:
    """The stages of the plan; upcycling at the first that is not dense."""
    config, order = model_file_config(s), parts_of(s)
    train = examples(s, config, "train", augment=True)
    held = examples(s, config, s.plan.get("held_out", "test_voice"), augment=False)
    torch.manual_seed(s.plan["seed"])
    model: FrameModel | None = None
    for stage in s.plan["stages"]:
        plan = stage_plan(s, stage)
        path = s.folder / f"lm_{plan.name}.safetensors"
        before = model
        model = FrameModel(config, order, dense=plan.dense, marked=s.plan.get("marked", False))
        if path.exists():
            model.load_state_dict(export.load_state(path))
            continue
        if before is not None:
            state = before.state_dict()
            upcycles = not moe.layers(before) and not plan.dense
            model.load_state_dict(moe.upcycled(state, config["lm"]["experts"], plan.seed) if upcycles else state)
        train_stage(plan, model, train, held, s.folder)
        if processes.is_first():
            copies = _trained(s.folder / f"lm_{plan.name}.pt", "optimizer")["copies"]
            trained = [name for name, _ in model.named_parameters()]
            export.save_state(path, dict(zip(trained, copies, strict=True)))
        processes.wait()


def step_interp(s: Run) -> None:
    config = model_file_config(s)
    codes = [np.load(s.folder / "codes" / f"{name}.npy") for name in names(s, "train", spoken=True)]
    plan = VectorPlan(**s.plan["interp_training"], seed=s.plan["seed"])
    train_interp(plan, config, parts_of(s), codes, tokenizers(s), s.folder)


def step_export(s: Run) -> None:
    """`run/NAME.safetensors`, bf16; `umo quantize` makes the int8 one."""
    config, order = model_file_config(s), parts_of(s)
    language = for_file(export.load_state(s.folder / f"lm_{s.plan['stages'][-1]['name']}.safetensors"))
    interpolation = VectorInterpolation(config, order)
    interpolation.load_state_dict(_trained(s.folder / "interp.pt", "model"))
    motion = {name: model.folded() for name, model in tokenizers(s).items()} | {"root": root_network(s).state_dict()}
    audio = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    named = export.tensors(
        audio.tensors(), language, interpolation.state_dict(), motion, s.text_model(), torch.bfloat16
    )
    export.write(s.folder / f"{s.plan['name']}.safetensors", config, named)
