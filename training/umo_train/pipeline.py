"""From nothing to a model file, step by step. Each step goes on where it stopped and is skipped where it is done."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import sentencepiece
import torch
import yaml
from tqdm import tqdm

from umo_train import export
from umo_train.audio import tokens
from umo_train.audio.mel import model_config
from umo_train.data import corpus
from umo_train.interp.model import Interpolation
from umo_train.interp.train import InterpPlan
from umo_train.interp.train import train as train_interp
from umo_train.lm import moe
from umo_train.lm.examples import Examples, Stream
from umo_train.lm.model import LanguageModel
from umo_train.lm.train import StagePlan, train_stage
from umo_train.motion.networks import RootNetwork, VqVae
from umo_train.motion.train import TokenizerPlan, tokenize, train_part, train_root
from umo_train.performer import perform
from umo_train.performer.style import PROMPTS, STYLES
from umo_train.skeleton import ARKIT, CHANNELS, OFFSETS_M, PARENTS, PARTS
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance

Config = dict[str, Any]
STEPS = ("speech", "motion", "audio", "tokenizers", "codes", "lm", "interp", "export")
# Text ids that mark the tasks in templates; they name no piece that prompts need.
AUDIO_TASK, MOTION_TASK, TEXT_TASK, TEXT_END = 8, 9, 10, 11


@dataclass
class Run:
    """A plan (the YAML file's content), the folder that its paths are relative to, the corpus' folder and the folder of
    everything made from it."""

    plan: Config
    plans: Path
    corpus: Path
    folder: Path

    @staticmethod
    def read(config: Path, work: Path, *, smoke: bool = False) -> "Run":
        plan = yaml.safe_load(config.read_text())
        if smoke:
            smallest = yaml.safe_load((config.parent / "smoke.yaml").read_text())
            plan = _merged(plan, smallest)
        return Run(plan, config.parent, work / "corpus", work / "run")

    def text_model(self) -> bytes:
        """The SentencePiece model of prompts and transcripts."""
        return (self.plans / self.plan["text_model"]).read_bytes()


def _merged(base: Config, over: Config) -> Config:
    out = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict) and not value.pop("replace", False)
        out[key] = _merged(base[key], value) if both else value
    return out


def run(settings: Run, steps: tuple[str, ...] = STEPS) -> None:
    for step in steps:
        globals()[f"step_{step}"](settings)


def step_speech(s: Run) -> None:
    plan = corpus.SpeechPlan(**s.plan["speech"] | {"held_out": tuple(s.plan["speech"]["held_out"])})
    corpus.make_speech(plan, s.corpus, s.plan["workers"])


def step_motion(s: Run) -> None:
    corpus.make_motion(s.corpus, s.plan["workers"])


def step_audio(s: Run) -> None:
    tokenizer = tokens.fit(s.corpus, s.folder / "audio.safetensors", s.plan["audio"], s.plan["seed"])
    recordings = s.plan["audio"]["recordings"]
    tokens.tokenize(s.corpus, s.folder / "audio_tokens", tokenizer, recordings, s.plan["workers"])


def _tokenizer_plan(s: Run, name: str) -> TokenizerPlan:
    plan = s.plan["tokenizers"]
    shared = {key: plan[key] for key in ("codes", "width", "batch", "frames")}
    return TokenizerPlan(**shared, **plan[name], stride=s.plan["window"]["keyframe_stride"], seed=s.plan["seed"])


def step_tokenizers(s: Run, names: tuple[str, ...] = (*PARTS, "root")) -> None:
    """Needs one part's motion of every training item in memory: 1.2 GB for the hands of 15 hours."""
    train = _names(s, "train")
    for name in names:
        plan = _tokenizer_plan(s, name)
        only = ("lower", "height") if name == "root" else (name,)
        motions = [tuple(corpus.read_motion(s.corpus, item, only).values()) for item in train]
        if name == "root":
            train_root(plan, motions, s.folder)
        else:
            train_part(plan, name, [motion for (motion,) in motions], s.folder)


def _names(s: Run, split: str) -> list[str]:
    """Items of a split that have a motion."""
    made = {path.stem for path in (s.corpus / "motion").glob("?????.npz")}
    return [item.name for item in corpus.items(s.corpus, split) if item.name in made]


def tokenizers(s: Run) -> dict[str, VqVae]:
    out = {}
    for part in PARTS:
        plan = _tokenizer_plan(s, part)
        model = VqVae(plan.width, CHANNELS[part], plan.layers, plan.codes)
        model.load_state_dict(_trained(s.folder / f"tokenizer_{part}.pt", "model"))
        out[part] = model.eval()
    return out


def _trained(path: Path, name: str) -> Config:
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: run the step that makes it first")
    return torch.load(path, map_location="cpu", weights_only=True)[name]


def step_codes(s: Run) -> None:
    """Every item's motion as codes, `run/codes/NAME.npy` `[4, T]`, and the codes of standing still."""
    out = s.folder / "codes"
    out.mkdir(parents=True, exist_ok=True)
    models = tokenizers(s)
    for path in tqdm(sorted((s.corpus / "motion").glob("?????.npz")), "codes"):
        target = out / f"{path.stem}.npy"
        if not target.exists():
            motion = corpus.read_motion(s.corpus, path.stem)
            np.save(target, np.stack([tokenize(models[part], motion[part]) for part in PARTS]))
    still = perform(_silence(20.0), STYLES["neutral"], 0)
    rest = {}
    for part in PARTS:
        codes = tokenize(models[part], still[part])
        rest[part] = int(np.bincount(codes[30:]).argmax())
    (s.folder / "rest.yaml").write_text(yaml.safe_dump(rest))


def _silence(seconds: float) -> Utterance:
    samples = np.zeros(int(seconds * SAMPLE_RATE), np.float32)
    return Utterance("silence", "", samples, (Phone(SILENCE, 0.0, seconds),))


def model_file_config(s: Run) -> Config:
    """`config` of the model file."""
    plan = s.plan
    text = sentencepiece.SentencePieceProcessor(model_proto=s.text_model()).get_piece_size()
    vocab: Config = {"size": 0, "pad": 0, "eos": 1, "decoder_start": 0}
    first = text + 3
    codes = plan["tokenizers"]["codes"]
    for name, count, unused in (*((part, codes, 0) for part in PARTS), ("audio", plan["audio"]["units"], 2)):
        start = first + count + unused
        vocab[name] = {"first": first, "codes": count, "start": start, "end": start + 1, "mask": start + 2}
        first = start + 3
    vocab["size"] = first
    parts = list(PARTS)
    tokenizer = tokens.Tokenizer.load(s.folder / "audio.safetensors", plan["audio"])
    vq: Config = {"codes": codes, "width": plan["tokenizers"]["width"]}
    for name in (*PARTS, "root"):
        channels = CHANNELS["lower" if name == "root" else name]
        vq[name] = {"channels": channels, "layers": plan["tokenizers"][name]["layers"]}
    return {
        "name": plan["name"],
        "license": plan["license"],
        "frame_rate": 30,
        **plan["window"],
        "audio": model_config(tokenizer.mel, plan["audio"]["units"]),
        "vocab": vocab,
        "lm": plan["lm"],
        "interp": plan["interp"],
        "vq": vq,
        "face": {"kind": "arkit", "names": list(ARKIT)},
        "templates": {
            "audio_to_motion": [AUDIO_TASK, "audio", MOTION_TASK, *parts, 1],
            "audio_to_motion_with_text": [AUDIO_TASK, "audio", MOTION_TASK, TEXT_TASK, "text", TEXT_END, *parts, 1],
            "text_to_motion": [TEXT_TASK, "text", TEXT_END, *parts, 1],
        },
        "rest": yaml.safe_load((s.folder / "rest.yaml").read_text()),
        "sampling": plan["sampling"],
        "skeleton": {"parents": list(PARENTS), "offsets_m": [[round(float(x), 4) for x in row] for row in OFFSETS_M]},
    }


def examples(s: Run, config: Config, split: str, *, augment: bool) -> Examples:
    """Codes, units and texts of a split."""
    pieces = sentencepiece.SentencePieceProcessor(model_proto=s.text_model())
    streams = []
    for item in corpus.items(s.corpus, split):
        path = s.folder / "codes" / f"{item.name}.npy"
        if not path.exists():
            continue
        units = np.load(s.folder / "audio_tokens" / f"{item.name}.npy")
        text = np.array(pieces.encode(item.utterance.text))
        # An empty prompt says nothing of the style: examples with a prompt take another of the same style's.
        prompt = item.prompt or PROMPTS[item.style][-1]
        streams.append(Stream(np.load(path), units, text, np.array(pieces.encode(prompt))))
    tokenizer = tokens.Tokenizer.load(s.folder / "audio.safetensors", s.plan["audio"])
    silence = int(tokenizer(np.zeros(SAMPLE_RATE, np.float32))[20])
    return Examples(config, streams, silence, augment=augment)


def step_lm(s: Run) -> None:
    """Pre-training of a dense model, upcycling, stage 1 and stage 2."""
    config = model_file_config(s)
    train, held = examples(s, config, "train", augment=True), examples(s, config, "test_voice", augment=False)
    torch.manual_seed(s.plan["seed"])
    model: LanguageModel | None = None
    for stage in s.plan["stages"]:
        plan = StagePlan(**stage | {"targets": tuple(stage.get("targets", (5,))), "seed": s.plan["seed"]})
        path = s.folder / f"lm_{plan.name}.safetensors"
        before = model
        model = LanguageModel(config, dense=plan.dense)
        if path.exists():
            model.load_state_dict(export.load_state(path))
            continue
        if before is not None:
            state = before.state_dict()
            was_dense, experts = not moe.layers(before), config["lm"]["experts"]
            model.load_state_dict(moe.upcycled(state, experts, plan.seed) if was_dense and not plan.dense else state)
        train_stage(plan, model, train, held, s.folder)
        export.save_state(path, train_result(s.folder, plan, model))


def train_result(folder: Path, plan: StagePlan, model: LanguageModel) -> dict[str, torch.Tensor]:
    """The f32 weights of a stage's last checkpoint under their names."""
    copies = _trained(folder / f"lm_{plan.name}.pt", "optimizer")["copies"]
    names = [name for name, _ in model.named_parameters()]
    return dict(zip(names, copies, strict=True))


def step_interp(s: Run) -> None:
    config = model_file_config(s)
    codes = [np.load(s.folder / "codes" / f"{name}.npy").astype(np.int64) for name in _names(s, "train")]
    train_interp(InterpPlan(**s.plan["interp_training"], seed=s.plan["seed"]), config, codes, s.folder)


def step_export(s: Run) -> None:
    """`run/NAME.safetensors`, bf16; `umo quantize` makes the int8 one."""
    config = model_file_config(s)
    language = export.load_state(s.folder / f"lm_{s.plan['stages'][-1]['name']}.safetensors")
    interpolation = Interpolation(config)
    interpolation.load_state_dict(_trained(s.folder / "interp.pt", "model"))
    plan = _tokenizer_plan(s, "root")
    root = RootNetwork(plan.width, CHANNELS["lower"], plan.layers)
    root.load_state_dict(_trained(s.folder / "tokenizer_root.pt", "model"))
    motion = {part: model.folded() for part, model in tokenizers(s).items()} | {"root": root.state_dict()}
    audio = tokens.Tokenizer.load(s.folder / "audio.safetensors", s.plan["audio"])
    named = export.tensors(
        audio.mel.tensors() | {"audio.kmeans.centroids": audio.centroids},
        language,
        interpolation.state_dict(),
        motion,
        s.text_model(),
        torch.bfloat16,
    )
    export.write(s.folder / f"{s.plan['name']}.safetensors", config, named)
