"""The steps of a plan of layout `frames` that differ from the paper's layout (`umo_train/pipeline.py`)."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
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
from umo_train.frames import chain, packed, parts, published, report
from umo_train.frames.examples import FrameStream, heard_token
from umo_train.frames.interp import VectorInterpolation, VectorPlan
from umo_train.frames.interp import train as train_interp
from umo_train.frames.model import FrameModel, for_file
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.packed import Packed
from umo_train.frames.parts import Part
from umo_train.frames.root import RootItem, RootPlan, solved
from umo_train.frames.tokenizers import (
    decoded,
    encode,
    feet_of,
    plan_of,
    train_part,
    with_feet,
)
from umo_train.frames.train import FrameStagePlan, train_stage
from umo_train.lm import moe
from umo_train.metrics.item import Item, Motion
from umo_train.model_config import AUDIO_TASK, END, MOTION_TASK, TEXT_END, TEXT_TASK, common_sizes, face, pieces
from umo_train.motion.networks import RootNetwork
from umo_train.performer import intent, perform
from umo_train.performer.actions import ACTIONS
from umo_train.performer.style import PROMPTS, STYLES, UNTOLD
from umo_train.plan import Config, Run
from umo_train.skeleton import CHANNELS
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance

# Slots for a prompt, empty without one: guidance extrapolates from the second to the first (SPEC 2.16).
TEMPLATES: dict[str, list[Any]] = {
    "audio_to_motion": [AUDIO_TASK, "audio", MOTION_TASK, TEXT_TASK, "text", TEXT_END, "history", END],
    "text_to_motion": [TEXT_TASK, "text", TEXT_END, "history", END],
}
INTENT = "intent"
# Sampling weight of an action for motion from text alone, relative to speech of its length.
_ACTIONS_FROM_TEXT = 8.0


def names_of_face(s: Run) -> list[str]:
    return face(s.plan)["names"]


def parts_of(s: Run) -> list[Part]:
    """The plan's parts. An annotation is `intent`, with the performer's codes.

    Raises `ValueError` for an annotation that nothing produces.
    """
    out = parts.read(s.plan, names_of_face(s))
    for part in out:
        if not part.moves and (part.name, part.codes, part.levels) != (INTENT, intent.CODES, 1):
            raise ValueError(f"part `{part.name}` has no channels: the performer only provides `{INTENT}`, "
                             f"of {intent.CODES} codes and 1 level")  # fmt: skip
    return out


def moving(s: Run) -> list[Part]:
    """The parts that have channels."""
    return [part for part in parts_of(s) if part.moves]


def step_start(s: Run) -> None:
    """Takes tokenizers and the interpolation network from the model file that the plan names as `start`, relative to
    itself.
    """
    path = s.plans / s.plan["start"]
    published.start(path, s.folder, parts_of(s), names_of_face(s), root_plan(s), [*steps_more(s)])


def steps_more(s: Run) -> dict[str, int]:
    """Parts whose published tokenizers are trained further, and their numbers of steps."""
    return dict(s.plan["tokenizers"].get("more", {}))


def step_tokenizers(s: Run, only: tuple[str, ...] = ()) -> None:
    """Part after part, each on the errors that those before it leave. Needs the body motion of every training item in
    memory. With `tokenizers.more`, only those, starting from the published model's."""
    given = {entry["name"]: entry for entry in s.plan["parts"]}
    stride, seed = s.plan["window"]["keyframe_stride"], s.plan["seed"]
    order, more = moving(s), steps_more(s)
    for i, part in enumerate(order):
        if (only and part.name not in only) or (more and part.name not in more):
            continue
        begun = None
        if more:
            given[part.name] |= {"steps": more[part.name]}
            begun = _trained(s.folder / published.tokenizer(part.name), "model")
        region, _ = parts.columns(part, names_of_face(s))
        # Faces move with speech: without it, they are at rest throughout.
        items = trained_on(s, spoken=region == "face")
        motions, beside = [], []
        body = region in chain.REGIONS
        before = chain.before(order[:i], part) if body else []
        models = tokenizers(s, before)
        for item in tqdm(items, f"targets of {part.name}"):
            motion = corpus.read_motion(s.corpus, item, chain.REGIONS if body else (region,))
            _, said = encode(before, models, motion, names_of_face(s))
            motions.append(said.aims(part))
            if feet_of(part):
                beside.append(with_feet(motion["lower"], said.channels["lower"]))
        plan = plan_of(s.plan["tokenizers"], given[part.name], stride, seed)
        train_part(plan, part, motions, s.folder, beside or None, begun)
    # The root network is fitted to the decoded lower body.
    if "root" in only or (not only and (not more or "lower" in more)):
        _solve_root(s)


def chosen_by(s: Run) -> list[str]:
    """Spoken training items by which a plan may be chosen (`tokenizers.validation`), from all over the corpus."""
    found, count = corpus.with_motion(s.corpus, "train", spoken=True), s.plan["tokenizers"].get("validation", 0)
    return [found[(2 * k + 1) * len(found) // (2 * count)] for k in range(count)]


def trained_on(s: Run, *, spoken: bool) -> list[str]:
    """The other training items; with `tokenizers.every` only every n-th."""
    kept = set(chosen_by(s))
    found = [name for name in corpus.with_motion(s.corpus, "train", spoken=spoken) if name not in kept]
    return found[:: s.plan["tokenizers"].get("every", 1)]


def _solve_root(s: Run) -> None:
    """Needs the lower body's tokenizers: the root network is fitted to their decoded output."""
    face_names, stride = names_of_face(s), s.plan["window"]["keyframe_stride"]
    order = [part for part in moving(s) if parts.columns(part, face_names)[0] == "lower"]
    models, items = tokenizers(s, order), []
    for name in tqdm(trained_on(s, spoken=False), "lower body"):
        motion = corpus.read_motion(s.corpus, name, (*chain.REGIONS, "height"))
        codes, whole = encode(order, models, motion, face_names)
        said = [whole.channels["lower"], motion["lower"].copy()]
        for part in order:
            _, at = parts.columns(part, face_names)
            said[1][:, at] = decoded(models[part.name], codes[part.name], stride=stride)
        items.append(RootItem(motion["lower"], tuple(said), motion["height"]))
    solved(root_plan(s), items, s.folder)


def root_plan(s: Run) -> RootPlan:
    return RootPlan(**s.plan["tokenizers"]["root"], seed=s.plan["seed"])


def root_network(s: Run) -> RootNetwork:
    plan = root_plan(s)
    model = RootNetwork(plan.width, CHANNELS["lower"], plan.layers)
    model.load_state_dict(_trained(s.folder / "tokenizer_root.pt", "model"))
    return model.eval()


def tokenizers(s: Run, of: list[Part] | None = None) -> dict[str, ResidualVqVae]:
    """Tokenizers of all parts with channels, or of some parts, which may use only the first of their trained levels."""
    out = {}
    for part in moving(s) if of is None else filter(lambda part: part.moves, of):
        model = ResidualVqVae(part, len(parts.columns(part, names_of_face(s))[1]))
        state, wanted = _trained(s.folder / f"tokenizer_{part.name}.pt", "model"), model.state_dict()
        model.load_state_dict({name: state[name] for name in wanted})
        out[part.name] = model.eval()
    return out


def _trained(path: Path, name: str) -> Config:
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: run the step that makes it first")
    return torch.load(path, map_location="cpu", weights_only=True)[name]


def step_report(s: Run) -> None:
    """`run/tokenizers.md` and `.json`: what goes through the tokenizers, on items that none of them was trained on and
    by which nothing was chosen. With `tokenizers.validation`, `run/tokenizers_validation.*` has the same of the items
    that are there to choose by."""
    splits = ("test_voice", "test_sentence")
    held = [entry for split in splits for entry in corpus.with_motion(s.corpus, split, spoken=True)]
    models, root = tokenizers(s), root_network(s)
    for name, wanted in (("tokenizers_validation", chosen_by(s)), ("tokenizers", held)):
        if wanted:
            rows = report.measure(
                [_item(s, item) for item in wanted],
                models,
                moving(s),
                names_of_face(s),
                root,
                s.plan["window"]["keyframe_stride"],
            )
            report.write(rows, s.folder, name)
            print(f"{name}: {len(wanted)} items\n\n{report.markdown(rows)}")


def _item(s: Run, name: str) -> Item:
    item = corpus.read_item(s.corpus / "speech" / f"{name}.npz")
    speech, motion = item.utterance, corpus.read_motion(s.corpus, name)
    return Item(name, speech.voice, speech.samples, speech.phones, motion, split=item.split)


def codes_of(s: Run, order: list[Part], models: dict[str, ResidualVqVae], motion: Motion) -> np.ndarray:
    """Codes of every frame `[T, J]`; those of an annotation come from the motion."""
    said, _ = encode(order, models, motion, names_of_face(s))
    own = {part.name: np.asarray(motion[part.name])[:, None].astype(np.int16) for part in order if not part.moves}
    return np.concatenate([(said | own)[part.name] for part in order], 1)


def step_codes(s: Run) -> None:
    """Every item's motion as codes, `run/codes/NAME.npy` `[T, J]`, and the codes of standing still, `run/rest.yaml`."""
    out = s.folder / "codes"
    out.mkdir(parents=True, exist_ok=True)
    silent = {entry.name for entry in corpus.entries(s.corpus) if not entry.spoken and not _acts(entry)}
    items = [path.stem for path in corpus.paths(s.corpus, "motion")]
    missing = [name for name in items if not (out / f"{name}.npy").exists()]
    # One process uses the GPU.
    workers = 1 if best().type == "cuda" else s.plan["workers"]
    shares = [(s, missing[k::workers], silent) for k in range(workers)]
    with ThreadPoolExecutor(1) if workers == 1 else ProcessPoolExecutor(workers) as pool:
        list(pool.map(_encode_items, shares))
    order, models = parts_of(s), tokenizers(s)
    still = perform(_silence(20.0), STYLES["neutral"], 0)
    codes = codes_of(s, order, models, still)[30:]
    rest, at = {}, 0
    for part in order:
        rest[part.name] = middle(codes[:, at : at + part.levels], models.get(part.name))
        at += part.levels
    (s.folder / "rest.yaml").write_text(yaml.safe_dump(rest))


def _encode_items(share: tuple[Run, list[str], set[str]]) -> None:
    s, items, silent = share
    if s.plan["workers"] > 1:
        torch.set_num_threads(1)
    order, models = parts_of(s), {name: model.to(best()) for name, model in tokenizers(s).items()}
    of_face = np.repeat(is_face(s), [part.levels for part in order])
    for name in tqdm(items, "codes"):
        motion = corpus.read_motion(s.corpus, name)
        if any(part.name == INTENT for part in order):
            motion[INTENT] = corpus.read_intent(s.corpus, name)
        codes = codes_of(s, order, models, motion)
        if name in silent:
            # The face was not recorded, so it has no codes; in actions it is the performer's.
            codes[:, of_face] = -1
        corpus.write_array(s.folder / "codes" / f"{name}.npy", codes)


def is_face(s: Run) -> list[bool]:
    """Whether each part belongs to the face."""
    return [part.moves and parts.columns(part, names_of_face(s))[0] == "face" for part in parts_of(s)]


@torch.no_grad()
def middle(codes: np.ndarray, model: ResidualVqVae | None) -> list[int]:
    """The codes in `[T, levels]` whose vector is nearest to the mean; for an annotation the most frequent."""
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
        "depth": dict(s.plan["depth"]),
        "vq": {
            "width": root_plan(s).width,
            "root": {"channels": CHANNELS["lower"], "layers": root_plan(s).layers},
        },
        "templates": TEMPLATES,
    }
    config["audio"]["ahead"] = s.plan["audio"].get("ahead", 0)
    # The plan says whether to use it, the model file which of a keyframe's audio tokens, and for the body how many
    # tokens earlier than in training.
    sooner = config["depth"].pop("body_sooner", 0)
    if config["depth"].pop("heard", False):
        config["depth"]["heard"] = heard_token(config, s.plan["audio"].get("listener", {}).get("delay"))
        if sooner:
            config["depth"]["body_heard"] = config["depth"]["heard"] + sooner
    if "speech" in s.plan:
        told = list(PROMPTS.values())
        if "actions" in s.plan:
            told += [action.prompts for action in ACTIONS.values()]
        config["prompts"] = [prompt for prompts in told for prompt in prompts if prompt]
    return config


def packed_of(s: Run, config: Config) -> Packed:
    """Codes, units and prompts of the splits used for training and measuring."""
    splits = {split: _streams(s, split) for split in ("train", _held_out(s))}
    tokenizer = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    silence = int(tokenizer(np.zeros(SAMPLE_RATE, np.float32))[20])
    delay = s.plan["audio"].get("listener", {}).get("delay")
    return Packed(config, silence, delay, [not of_face for of_face in is_face(s)], splits)


def _held_out(s: Run) -> str:
    return str(s.plan.get("held_out", "test_voice"))


def step_pack(s: Run) -> None:
    """`run/packed.xz`: everything that the step `lm` needs besides the plan."""
    packed.write(s.folder / packed.NAME, packed_of(s, model_file_config(s)))


def _streams(s: Run, split: str) -> list[FrameStream]:
    streams, order = [], parts_of(s)
    for entry in corpus.entries(s.corpus, split):
        found = [s.folder / kind / f"{entry.name}.npy" for kind in ("codes", "audio_tokens")]
        codes, units = (np.load(path) if path.exists() else None for path in found)
        if codes is None and units is None:
            continue
        prompts = PROMPTS[entry.style] if entry.style in PROMPTS else entry.prompt.split("\n")
        ids = tuple(np.array(pieces(s).encode(prompt), np.int64) for prompt in prompts)
        told = bool(entry.style) and entry.style not in UNTOLD
        acts = _acts(entry)
        # Text alone mainly asks for actions: speech comes with a voice.
        weight = _ACTIONS_FROM_TEXT if acts else 1.0
        starts = begins(codes, order, s.plan["window"]["keyframe_stride"]) if acts and codes is not None else ()
        streams.append(FrameStream(codes, units, ids, told, weight, starts, entry.person))
    return streams


def _acts(entry: corpus.Entry) -> bool:
    return entry.style.startswith("action ")


def begins(codes: np.ndarray, order: list[Part], stride: int) -> tuple[int, ...]:
    """Keyframes of codes `[frames, J]` at which an arm starts to move after both rested; empty without intent."""
    at = 0
    for part in order:
        if part.name == INTENT:
            resting = codes[::stride, at] == intent.REST
            return tuple((np.flatnonzero(resting[:-1] & ~resting[1:]) + 1).tolist())
        at += part.levels
    return ()


def stage_plan(s: Run, stage: Config) -> FrameStagePlan:
    given = stage | ({"targets": tuple(stage["targets"])} if "targets" in stage else {})
    return FrameStagePlan(**{"seed": s.plan["seed"]} | given)


def step_lm(s: Run) -> None:
    """The stages of the plan; upcycling happens at the first one that is not dense. With `start_language_model` the
    first continues from the published model's weights."""
    pack, order = s.folder / packed.NAME, parts_of(s)
    data = packed.read(pack) if pack.exists() else packed_of(s, model_file_config(s))
    config = data.config
    train = data.examples(order, "train", augment=True)
    held = data.examples(order, _held_out(s), augment=False)
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
        if before is None and s.plan.get("start_language_model"):
            model.load_state_dict(published.language_model(s.plans / s.plan["start"]))
        elif before is not None:
            state = before.state_dict()
            upcycles = not moe.layers(before) and not plan.dense
            model.load_state_dict(moe.upcycled(state, config["lm"]["experts"], plan.seed) if upcycles else state)
        train_stage(plan, model, train, held, s.folder, s.until)
        if processes.is_first():
            export.save_state(path, copies(s.folder, plan, model))
        processes.wait()


def copies(folder: Path, plan: FrameStagePlan, model: FrameModel) -> dict[str, torch.Tensor]:
    """The f32 weights of a stage's last checkpoint, by name."""
    names = [name for name, _ in model.named_parameters()]
    return dict(zip(names, _trained(folder / f"lm_{plan.name}.pt", "optimizer")["copies"], strict=True))


def step_interp(s: Run) -> None:
    config = model_file_config(s)
    codes = [np.load(s.folder / "codes" / f"{name}.npy") for name in corpus.with_motion(s.corpus, "train", spoken=True)]
    plan = VectorPlan(**s.plan["interp_training"], seed=s.plan["seed"])
    train_interp(plan, config, parts_of(s), codes, tokenizers(s), s.folder)


def step_export(s: Run) -> None:
    """`run/NAME.safetensors`, bf16; `umo model quantize` makes the int8 one."""
    language = export.load_state(s.folder / f"lm_{s.plan['stages'][-1]['name']}.safetensors")
    export_model(s, s.folder / f"{s.plan['name']}.safetensors", model_file_config(s), parts_of(s), language)


def export_model(s: Run, path: Path, config: Config, order: list[Part], language: dict[str, torch.Tensor]) -> None:
    """Writes a model file of a language model and the run's tokenizers; parts in `order` may lack levels."""
    interpolation = VectorInterpolation(config, order)
    interpolation.load_state_dict(_trained(s.folder / "interp.pt", "model"))
    motion = {name: model.folded() for name, model in tokenizers(s, order).items()}
    motion["root"] = root_network(s).state_dict()
    audio = tokens.load(s.folder / "audio.safetensors", s.plan["audio"])
    named = export.tensors(
        audio.tensors(), for_file(language), interpolation.state_dict(), motion, s.text_model(), torch.bfloat16
    )
    # Small differences of large values do not survive rounding.
    named |= {f"vq.root.{name}": tensor.contiguous() for name, tensor in motion["root"].items()}
    export.write(path, config, named)


STEPS: dict[str, Callable[..., None]] = {
    "start": step_start,
    "tokenizers": step_tokenizers,
    "report": step_report,
    "codes": step_codes,
    "pack": step_pack,
    "lm": step_lm,
    "interp": step_interp,
    "export": step_export,
}
