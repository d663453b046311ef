"""`config` of the model file, from a plan."""

import re
from functools import lru_cache
from typing import Any

import sentencepiece
import yaml

from umo_train.audio import tokens
from umo_train.performer.style import PROMPTS
from umo_train.plan import Config, Run
from umo_train.skeleton import ARKIT, CHANNELS, JOINTS_OF, OFFSETS_M, PARENTS, PARTS

# Text ids that mark the tasks in templates; they belong to no piece that prompts need.
AUDIO_TASK, MOTION_TASK, TEXT_TASK, TEXT_END = 8, 9, 10, 11
END = 1
# Templates that the program uses; a plan may have more, for tasks used only in training.
_OF_THE_PROGRAM = ("audio_to_motion", "audio_to_motion_with_text", "text_to_motion")
_MARKED = {
    "audio_to_motion": [AUDIO_TASK, "audio", MOTION_TASK, *PARTS, END],
    "audio_to_motion_with_text": [AUDIO_TASK, "audio", MOTION_TASK, TEXT_TASK, "text", TEXT_END, *PARTS, END],
    "text_to_motion": [TEXT_TASK, "text", TEXT_END, *PARTS, END],
}


def face(plan: Config) -> Config:
    """`config.face`: 52 ARKit shapes by default."""
    given = plan.get("face", {"kind": "arkit"})
    if given["kind"] == "arkit":
        return {"kind": "arkit", "names": list(ARKIT)}
    return {"kind": given["kind"], "names": [f"expression_{i}" for i in range(given["coefficients"])]}


def channels(plan: Config) -> dict[str, int]:
    """Channels of each part, with the plan's number of face channels."""
    return CHANNELS | {"face": 6 * len(JOINTS_OF["face"]) + len(face(plan)["names"])}


def vocabulary(s: Run, parts: tuple[str, ...] = PARTS) -> Config:
    """Text, then the parts' codes and audio in Language of Motion's order."""
    # T5's vocabulary has ids without pieces in its SentencePiece model.
    text = pieces(s).get_piece_size() + s.plan.get("text", {}).get("extra_ids", 0)
    vocab: Config = {"size": 0, "pad": 0, "eos": END, "decoder_start": 0}
    first = text + 3
    codes = s.plan["tokenizers"]["codes"]
    for name, count, unused in (*((part, codes, 0) for part in parts), ("audio", s.plan["audio"]["units"], 2)):
        start = first + count + unused
        vocab[name] = {"first": first, "codes": count, "start": start, "end": start + 1, "mask": start + 2}
        first = start + 3
    vocab["size"] = first
    return vocab


@lru_cache(maxsize=2)
def _pieces(model: bytes) -> sentencepiece.SentencePieceProcessor:
    return sentencepiece.SentencePieceProcessor(model_proto=model)


def pieces(s: Run) -> sentencepiece.SentencePieceProcessor:
    return _pieces(s.text_model())


def templates(s: Run) -> dict[str, list[Any]]:
    """Templates of every task. A plan gives them as sentences with `{audio}`, `{text}` and the parts as slots."""
    given: dict[str, str] = s.plan.get("templates", {})
    out = {}
    for name, sentence in given.items():
        ids: list[Any] = []
        for i, piece in enumerate(re.split(r"\{(\w+)\}", sentence)):
            ids += [piece] if i % 2 else pieces(s).encode(piece.strip())
        out[name] = [*ids, END]
    return _MARKED | out


def common_sizes(s: Run, parts: tuple[str, ...]) -> Config:
    """Config entries common to both layouts; `parts` are those with ids in the vocabulary."""
    plan = s.plan
    return {
        "name": plan["name"],
        "license": plan["license"],
        "frame_rate": 30,
        **plan["window"],
        "audio": tokens.model_config(plan["audio"]),
        "vocab": vocabulary(s, parts),
        "lm": {key: value for key, value in plan["lm"].items() if key != "init"},
        "interp": plan["interp"],
        "face": face(plan),
        "sampling": plan["sampling"],
        "skeleton": {"parents": list(PARENTS), "offsets_m": [[round(float(x), 4) for x in row] for row in OFFSETS_M]},
    }


def sizes(s: Run) -> Config:
    """Everything except the rest codes, which are known once the motion is."""
    plan = s.plan
    vq: Config = {"codes": plan["tokenizers"]["codes"], "width": plan["tokenizers"]["width"]}
    for name in (*PARTS, "root"):
        width = channels(plan)["lower" if name == "root" else name]
        vq[name] = {"channels": width, "layers": plan["tokenizers"][name]["layers"]}
    every = templates(s)
    return common_sizes(s, PARTS) | {"vq": vq, "templates": {name: every[name] for name in _OF_THE_PROGRAM}}


def model_file_config(s: Run) -> Config:
    """`config` of the model file."""
    config = sizes(s) | {"rest": yaml.safe_load((s.folder / "rest.yaml").read_text())}
    # A model of the performer's motion knows only the performer's prompts.
    if "speech" in s.plan:
        config["prompts"] = [prompt for prompts in PROMPTS.values() for prompt in prompts if prompt]
    return config
