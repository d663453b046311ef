"""From nothing to a model file, step by step. Each step resumes where it stopped, and is skipped if it is done."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import yaml
from tqdm import tqdm

from umo_train import export, processes
from umo_train.audio import listener, tokens
from umo_train.convert import vq
from umo_train.data import corpus
from umo_train.device import best
from umo_train.frames import steps as frame_steps
from umo_train.interp.model import Interpolation
from umo_train.interp.train import InterpPlan
from umo_train.interp.train import train as train_interp
from umo_train.lm import moe
from umo_train.lm.examples import Examples, Stream
from umo_train.lm.model import LanguageModel
from umo_train.lm.start import from_t5
from umo_train.lm.train import StagePlan, mixture, train_stage
from umo_train.model_config import channels, model_file_config, pieces, sizes, templates
from umo_train.motion.networks import RootNetwork, VqVae
from umo_train.motion.train import TokenizerPlan, tokenize, train_part, train_root
from umo_train.performer import perform
from umo_train.performer.style import PROMPTS, STYLES
from umo_train.plan import Config, Run
from umo_train.skeleton import CHANNELS, PARTS
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Phone, Utterance

STEPS = (
    "import",
    "voices",
    "speech",
    "people",
    "actions",
    "motion",
    "start",
    "audio",
    "tokenizers",
    "report",
    "codes",
    "pack",
    "lm",
    "interp",
    "export",
    "mouth",
)
# Steps whose items can be shared by several machines.
SHARED = ("speech", "actions", "motion")
# Steps of a plan that names none, if its layout has them: speech and motion are made.
_DEFAULT = ("speech", "motion", "audio", "tokenizers", "report", "codes", "lm", "interp", "export")


def only(settings: Run, name: str) -> None:
    """The step `tokenizers` for one network alone."""
    _steps(settings)["tokenizers"](settings, (name,))


def run(settings: Run, steps: tuple[str, ...] = ()) -> None:
    """The steps given, or all of the plan. Of several processes (`accelerate launch`) the first makes everything but
    the language model, which all train."""
    known = _steps(settings)
    for step in steps or settings.plan.get("steps", [name for name in _DEFAULT if name in known]):
        if step not in known:
            raise ValueError(f"a plan of this layout has no step `{step}`: it has {', '.join(known)}")
        if step == "lm" or processes.is_first():
            known[step](settings)
        processes.wait()


def step_import(s: Run) -> None:
    """Imports third-party data sets."""
    from umo_train.data import imported

    imported.import_clips(s.plan["import"], s.work, s.corpus, channels(s.plan)["face"] - 6)


def step_voices(s: Run) -> None:
    """Adds voices for imported motions."""
    from umo_train.speech import revoice

    revoice.revoice_corpus(s.corpus, [revoice.find(v) for v in s.plan["voices"]], s.plan["workers"])


def step_speech(s: Run) -> None:
    plan = corpus.SpeechPlan(**s.plan["speech"] | {"held_out": tuple(s.plan["speech"]["held_out"])})
    corpus.make_speech(plan, s.corpus, s.plan["workers"], s.shard)


def step_people(s: Run) -> None:
    """Adds recorded people, if the plan names any."""
    from umo_train.people.make import PeoplePlan, make_people

    plan = s.plan.get("people")
    if not plan:
        raise ValueError("the step `people` needs a section `people` in the plan: `root` and `sets`")
    make_people(PeoplePlan(**plan | {"root": s.work / plan["root"]}), s.corpus, s.plan["workers"])


def step_actions(s: Run) -> None:
    """Adds actions from clips, if the plan names any."""
    plan = s.plan.get("actions")
    if not plan:
        raise ValueError("the step `actions` needs a section `actions` in the plan: `clips`")
    files = tuple(path for pattern in plan["clips"] for path in sorted(s.work.glob(pattern)))
    if not files:
        raise ValueError(f"no clips at {', '.join(str(s.work / pattern) for pattern in plan['clips'])}")
    corpus.make_actions(corpus.ActionPlan(**plan | {"clips": files}), s.corpus, s.plan["workers"], s.shard)


def step_motion(s: Run) -> None:
    seeds = s.plan.get("motion", {}).get("seeds", 0)
    corpus.make_motion(s.corpus, s.plan["workers"], s.shard, _heard_accents(s), seeds)


def _heard_accents(s: Run) -> corpus.HeardAccents | None:
    """Accents for the performer if the plan has `motion: {accents: units}`: those from the preceding step `audio`."""
    accents = s.plan.get("motion", {}).get("accents", "phones")
    if accents == "phones":
        return None
    folder = s.folder / "audio_tokens"
    if accents != "units" or not folder.exists():
        raise ValueError(f"motion.accents: {accents}: `phones`, or `units` after the step `audio`")
    about = tokens.model_config(s.plan["audio"])["accents"]
    return corpus.HeardAccents(folder, about["first"], about["delay"], listener.TOKEN_RATE)


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
    if s.plan["tokenizers"].get("weights"):
        _published_tokenizers(s)
        return
    for name in names:
        plan = _tokenizer_plan(s, name)
        only = ("lower", "height") if name == "root" else (name,)
        # Faces move with speech: where there is none, they are at rest throughout.
        train = corpus.with_motion(s.corpus, "train", spoken=name == "face")
        motions = [tuple(corpus.read_motion(s.corpus, item, only).values()) for item in train]
        if name == "root":
            train_root(plan, motions, s.folder)
        else:
            train_part(plan, name, [motion for (motion,) in motions], s.folder)


def _published_tokenizers(s: Run) -> None:
    """EMAGE's or Language of Motion's tokenizers, as in the paper."""
    tensors = vq.convert([Path(path) for path in s.plan["tokenizers"]["weights"]], sizes(s))
    s.folder.mkdir(parents=True, exist_ok=True)
    for name in (*PARTS, "root"):
        model = _network(s, name)
        state = {key.removeprefix(f"vq.{name}."): tensor for key, tensor in tensors.items() if f"vq.{name}." in key}
        # Channels are used directly: no normalisation, no training statistics.
        model.load_state_dict(model.state_dict() | state)
        torch.save({"model": model.state_dict()}, s.folder / f"tokenizer_{name}.pt")


def _network(s: Run, name: str) -> VqVae | RootNetwork:
    plan = _tokenizer_plan(s, name)
    if name == "root":
        return RootNetwork(plan.width, CHANNELS["lower"], plan.layers)
    return VqVae(plan.width, channels(s.plan)[name], plan.layers, plan.codes)


def tokenizers(s: Run) -> dict[str, VqVae]:
    out = {}
    for part in PARTS:
        model = _network(s, part)
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
    models = {part: model.to(best()) for part, model in tokenizers(s).items()}
    silent = {entry.name for entry in corpus.entries(s.corpus) if not entry.spoken}
    for path in tqdm(corpus.paths(s.corpus, "motion"), "codes"):
        target = out / f"{path.stem}.npy"
        if not target.exists():
            motion = corpus.read_motion(s.corpus, path.stem)
            codes = np.stack([tokenize(models[part], motion[part]) for part in PARTS])
            if path.stem in silent:
                # The face was not recorded, so it has no codes.
                codes[PARTS.index("face")] = -1
            np.save(target, codes)
    made = channels(s.plan) == CHANNELS
    rest = _performers_rest(models) if made else _most_common(s)
    (s.folder / "rest.yaml").write_text(yaml.safe_dump(rest))


def _performers_rest(models: dict[str, VqVae]) -> dict[str, int]:
    """Codes of the performer in silence."""
    still = perform(_silence(20.0), STYLES["neutral"], 0)
    return {part: int(np.bincount(tokenize(models[part], still[part])[30:]).argmax()) for part in PARTS}


def _most_common(s: Run) -> dict[str, int]:
    """Each part's most frequent code of recorded people, from frames without speech, if there are any."""
    counts = np.zeros((2, len(PARTS), s.plan["tokenizers"]["codes"]), int)
    for entry in corpus.entries(s.corpus, "train"):
        path = s.folder / "codes" / f"{entry.name}.npy"
        if not entry.spoken or not path.exists():
            continue
        codes = np.load(path)
        speaking = np.zeros(codes.shape[1], bool)
        for word in entry.words:
            speaking[int(word.start * FRAME_RATE) : int(np.ceil(word.end * FRAME_RATE))] = True
        for part, row in enumerate(codes):
            for kind, frames in enumerate((row[~speaking], row)):
                counts[kind, part] += np.bincount(frames, minlength=counts.shape[2])
    best_of = counts[0] if counts[0].sum() else counts[1]
    return dict(zip(PARTS, best_of.argmax(1).tolist(), strict=True))


def _silence(seconds: float) -> Utterance:
    samples = np.zeros(int(seconds * SAMPLE_RATE), np.float32)
    return Utterance("silence", "", samples, (Phone(SILENCE, 0.0, seconds),))


def examples(s: Run, config: Config, split: str, *, augment: bool, kind: type[Examples] = Examples) -> Examples:
    """Codes, units and texts of a split."""
    rate = config["audio"]["token_rate"]
    streams = []
    for entry in corpus.entries(s.corpus, split):
        codes, units = (_array(s.folder / kind / f"{entry.name}.npy") for kind in ("codes", "audio_tokens"))
        if codes is None and units is None:
            continue
        # An empty prompt does not describe the style: examples with a prompt use another of the same style.
        prompts = entry.prompt or (PROMPTS[entry.style][-1] if entry.style else "")
        first, *more = (np.array(pieces(s).encode(prompt), int) for prompt in prompts.split("\n"))
        text, spoken = np.array(pieces(s).encode(entry.text), int), None
        if s.plan.get("text", {}).get("windows") and entry.words:
            text, spoken = _timed(s, entry, rate)
        streams.append(Stream(codes, units, text, first, tuple(more), spoken))
    tokenizer = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    silence = int(tokenizer(np.zeros(SAMPLE_RATE, np.float32))[20])
    delay = s.plan["audio"].get("listener", {}).get("delay")
    return kind(config, streams, silence, augment=augment, templates=templates(s), delay=delay)


def _array(path: Path) -> np.ndarray | None:
    return np.load(path) if path.exists() else None


def _timed(s: Run, entry: corpus.Entry, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Ids of an item's words, and the first and last audio token of each."""
    ids = [pieces(s).encode(word.text) for word in entry.words]
    times = [(word.start * rate, word.end * rate) for word in entry.words]
    return np.concatenate(ids), np.repeat(times, [len(word) for word in ids], axis=0)


def step_lm(s: Run) -> None:
    """Pre-training, stage 1 and stage 2; upcycling at the first stage that is not dense."""
    config = model_file_config(s)
    train = examples(s, config, "train", augment=True)
    held = examples(s, config, s.plan.get("held_out", "test_voice"), augment=False)
    torch.manual_seed(s.plan["seed"])
    model: LanguageModel | None = None
    for stage in s.plan["stages"]:
        stage = stage | {"tasks": mixture(stage["tasks"], train), "targets": tuple(stage.get("targets", (5,)))}
        plan = StagePlan(**{"seed": s.plan["seed"]} | stage)
        path = s.folder / f"lm_{plan.name}.safetensors"
        before = model
        model = LanguageModel(config, dense=plan.dense, marked=s.plan.get("marked", False))
        if path.exists():
            model.load_state_dict(export.load_state(path))
            continue
        if before is not None:
            model.load_state_dict(carried(before, plan, config))
        elif "init" in s.plan["lm"]:
            start = from_t5(Path(s.plan["lm"]["init"]), config, dense=plan.dense, seed=plan.seed)
            model.load_state_dict(start)
        train_stage(plan, model, train, held, s.folder)
        if processes.is_first():
            export.save_state(path, train_result(s.folder, plan, model))
        processes.wait()


def carried(before: LanguageModel, plan: StagePlan, config: Config) -> dict[str, torch.Tensor]:
    """Initial weights of a stage: the previous one's, upcycled from dense to sparse if needed."""
    state = before.state_dict()
    upcycles = not moe.layers(before) and not plan.dense
    return moe.upcycled(state, config["lm"]["experts"], plan.seed) if upcycles else state


def train_result(folder: Path, plan: StagePlan, model: LanguageModel) -> dict[str, torch.Tensor]:
    """The f32 weights of a stage's last checkpoint, by name."""
    copies = _trained(folder / f"lm_{plan.name}.pt", "optimizer")["copies"]
    names = [name for name, _ in model.named_parameters()]
    return dict(zip(names, copies, strict=True))


def step_interp(s: Run) -> None:
    config = model_file_config(s)
    # Windows of all four parts: of people who speak.
    names = corpus.with_motion(s.corpus, "train", spoken=True)
    codes = [np.load(s.folder / "codes" / f"{name}.npy").astype(np.int64) for name in names]
    books = {part: model.quantizer.embedding.weight.detach() for part, model in tokenizers(s).items()}
    train_interp(InterpPlan(**s.plan["interp_training"], seed=s.plan["seed"]), config, codes, s.folder, books)


def step_mouth(s: Run) -> None:
    """`run/mouth.safetensors`: the live mouth, as a separate part."""
    from umo_train.mouth.make import make

    make(s)


def step_export(s: Run, interpolation: Interpolation | None = None) -> None:
    """Writes `run/NAME.safetensors` in bf16, from which `umo model quantize` makes the int8 model. `interpolation`
    replaces the run's interpolation network."""
    config = model_file_config(s)
    language = export.load_state(s.folder / f"lm_{s.plan['stages'][-1]['name']}.safetensors")
    export.sharpen(language, config["vocab"], s.plan.get("sharpen", {}))
    if interpolation is None:
        interpolation = Interpolation(config)
        interpolation.load_state_dict(_trained(s.folder / "interp.pt", "model"))
    root = _network(s, "root")
    root.load_state_dict(_trained(s.folder / "tokenizer_root.pt", "model"))
    motion = {part: model.folded() for part, model in tokenizers(s).items()} | {"root": root.state_dict()}
    audio = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    named = export.tensors(
        audio.tensors(),
        language,
        interpolation.state_dict(),
        motion,
        s.text_model(),
        torch.bfloat16,
    )
    export.write(s.folder / f"{s.plan['name']}.safetensors", config, named)


_COMMON: dict[str, Callable[..., None]] = {
    "import": step_import,
    "voices": step_voices,
    "speech": step_speech,
    "people": step_people,
    "actions": step_actions,
    "motion": step_motion,
    "audio": step_audio,
    "mouth": step_mouth,
}
# Steps by the plan's layout.
_LAYOUTS = {
    "parts": _COMMON
    | {
        "tokenizers": step_tokenizers,
        "codes": step_codes,
        "lm": step_lm,
        "interp": step_interp,
        "export": step_export,
    },
    "frames": _COMMON | frame_steps.STEPS,
}


def _steps(settings: Run) -> dict[str, Callable[..., None]]:
    """The steps of the plan's layout, by name."""
    layout = settings.plan.get("layout", "parts")
    if layout not in _LAYOUTS:
        raise ValueError(f"no layout `{layout}`: expected {' or '.join(_LAYOUTS)}")
    return _LAYOUTS[layout]
