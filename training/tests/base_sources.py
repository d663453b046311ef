"""Small synthetic stand-ins for the data sets and networks of configs/base.yaml, in their real formats."""

import io
import sys
from pathlib import Path

import numpy as np
import sentencepiece
import soundfile
import torch
from scipy.spatial.transform import Rotation
from transformers import HubertConfig, HubertModel, T5Config, T5ForConditionalGeneration

from test_data_beat2 import write_words

BEAT2 = {"2_scott_0_1_1": "train", "2_scott_0_2_2": "additional", "4_lawrence_0_1_1": "val", "2_scott_0_3_3": "test"}
SECONDS = 4.0
SPOKEN = "hello there my old friend"
EXTRA_IDS = 100
# Rows of Flan-T5's table beyond its vocabulary.
SPARE_ROWS = 28


def everything(work: Path) -> None:
    beat2(work / "data" / "beat_english_v2.0.0")
    amass(work / "data" / "amass", work / "data" / "HumanML3D")
    librispeech(work / "data" / "LibriSpeech" / "train-clean-360")
    hubert(work / "weights" / "hubert-base-ls960")
    flan_t5(work / "weights" / "flan-t5-base")


def speech(seconds: float, seed: int) -> np.ndarray:
    """Noise with changing band and loudness, so that there are units to find."""
    random = np.random.default_rng(seed)
    time = np.arange(int(seconds * 16000)) / 16000
    pitch = 150 + 900 * np.repeat(random.random(int(seconds * 8) + 1), 2000)[: len(time)]
    wave = np.sin(2 * np.pi * np.cumsum(pitch) / 16000) * (0.2 + 0.2 * np.sin(2 * np.pi * 3 * time))
    return (wave + 0.01 * random.normal(size=len(time))).astype(np.float32)


def _smooth(frames: int, width: int, random: np.random.Generator) -> np.ndarray:
    steps = random.normal(size=(frames + 30, width)).cumsum(0)
    window = np.hanning(17) / np.hanning(17).sum()
    return np.apply_along_axis(np.convolve, 0, steps, window, "valid")[:frames]


def beat2(root: Path) -> None:
    for part in ("smplxflame_30", "wave16k", "textgrid"):
        (root / part).mkdir(parents=True)
    rows = "".join(f"{name},{split}\n" for name, split in BEAT2.items())
    (root / "train_test_split.csv").write_text("id,type\n" + rows)
    frames = int(SECONDS * 30)
    for seed, name in enumerate(BEAT2):
        random = np.random.default_rng(seed)
        np.savez(
            root / "smplxflame_30" / f"{name}.npz",
            betas=np.zeros(300),
            poses=0.05 * _smooth(frames, 165, random),
            expressions=0.2 * _smooth(frames, 100, random),
            trans=0.01 * _smooth(frames, 3, random) + (0, 1.2, 0),
            mocap_frame_rate=30,
        )
        soundfile.write(root / "wave16k" / f"{name}.wav", speech(SECONDS, seed), 16000)
        words = [(0.5 + 0.5 * i, 0.9 + 0.5 * i, text) for i, text in enumerate(SPOKEN.split())]
        phones = [(start, end, "AH1") for start, end, _ in words]
        grid = root / "textgrid" / f"{name}.TextGrid"
        write_words(grid, ("words", words), ("phones", phones))
        grid.write_text(grid.read_text().replace("xmax = 2.1\n", f"xmax = {SECONDS}\n"))


def amass(root: Path, texts: Path) -> None:
    """Two motions with one description each: one of the first half of a motion twice, one of the second half once."""
    (texts / "texts").mkdir(parents=True)
    frames = int(SECONDS * 60)
    for seed, name in enumerate(("CMU/01/01_01_poses", "KIT/3/walk02_poses")):
        random = np.random.default_rng(50 + seed)
        poses = 0.03 * _smooth(frames, 156, random)
        poses[:, :3] += Rotation.from_euler("x", 90, degrees=True).as_rotvec()
        path = root / f"{name}.npz"
        path.parent.mkdir(parents=True)
        np.savez(path, poses=poses, trans=0.01 * _smooth(frames, 3, random) + (0, 0, 0.9), mocap_framerate=60.0)
    half = int(SECONDS * 10)
    rows = [
        "source_path,start_frame,end_frame,new_name",
        f"./pose_data/KIT/3/walk02_poses.npy,0,{half},000000.npy",
        f"./pose_data/KIT/3/walk02_poses.npy,{half},{2 * half},000001.npy",
    ]
    (texts / "index.csv").write_text("\n".join(rows) + "\n")
    (texts / "texts" / "000000.txt").write_text("a man walks.#a/DET man/NOUN#0.0#0.0\nsomebody walks#x/X#0.0#0.0\n")
    (texts / "texts" / "000001.txt").write_text("a man stops#a/DET#nan#nan\n")


def librispeech(root: Path) -> None:
    chapter = root / "84" / "121123"
    chapter.mkdir(parents=True)
    lines = []
    for i in range(2):
        soundfile.write(chapter / f"84-121123-{i:04}.flac", speech(2.0 + i, 90 + i), 16000)
        lines.append(f"84-121123-{i:04} MY OLD FRIEND WALKS {'AND STOPS' if i else ''}".strip())
    (chapter / "84-121123.trans.txt").write_text("\n".join(lines) + "\n")


def hubert(folder: Path) -> HubertModel:
    """Real strides, few channels, one layer more than used."""
    torch.manual_seed(1)
    config = HubertConfig(
        conv_dim=(8,) * 7,
        hidden_size=16,
        intermediate_size=24,
        num_attention_heads=2,
        num_hidden_layers=3,
        num_conv_pos_embeddings=16,
        num_conv_pos_embedding_groups=4,
        num_feat_extract_layers=7,
    )
    model = HubertModel(config).eval()
    for parameter in model.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    model.save_pretrained(folder)
    return model


def flan_t5(folder: Path) -> T5ForConditionalGeneration:
    """The smoke plan's sizes, and a SentencePiece model with 100 ids fewer than T5's vocabulary."""
    folder.mkdir(parents=True)
    made = io.BytesIO()
    sentencepiece.SentencePieceTrainer.train(
        sentence_iterator=iter(
            [SPOKEN, "a man walks and stops", "Move to this speech: after these poses: in this way: write down say"] * 8
        ),
        model_writer=made,
        vocab_size=60,
        hard_vocab_limit=False,
        pad_id=0,
        eos_id=1,
        unk_id=2,
        bos_id=-1,
        minloglevel=2,
    )
    (folder / "spiece.model").write_bytes(made.getvalue())
    pieces = sentencepiece.SentencePieceProcessor(model_proto=made.getvalue()).get_piece_size()
    torch.manual_seed(2)
    config = T5Config(
        vocab_size=pieces + EXTRA_IDS + SPARE_ROWS,
        d_model=32,
        d_kv=8,
        d_ff=48,
        num_heads=4,
        num_layers=2,
        num_decoder_layers=1,
        feed_forward_proj="gated-gelu",
        tie_word_embeddings=False,
        dropout_rate=0.0,
        pad_token_id=0,
        eos_token_id=1,
        decoder_start_token_id=0,
    )
    model = T5ForConditionalGeneration(config).eval()
    # transformers 5 uses the embedding table regardless of the config.
    model.lm_head = torch.nn.Linear(32, config.vocab_size, bias=False)
    model.save_pretrained(folder)
    return model


def voice(folder: Path) -> dict[str, str]:
    """A program that speaks every word for a third of a second."""
    program = folder / "speak.py"
    program.write_text(
        "import sys, wave, math, struct\n"
        "text, wav, times = sys.argv[1:]\n"
        "words = text.split()\n"
        "n = len(words) * 16000 // 3\n"
        "with wave.open(wav, 'wb') as out:\n"
        "    out.setparams((1, 2, 16000, n, 'NONE', ''))\n"
        "    out.writeframes(b''.join(struct.pack('<h', int(9000 * math.sin(i / 9))) for i in range(n)))\n"
        "with open(times, 'w') as out:\n"
        "    out.writelines(f'{i / 3} {(i + 1) / 3} {word}\\n' for i, word in enumerate(words))\n"
    )
    return {"name": "thirds", "command": f"{sys.executable} {program} {{text}} {{wav}} {{words}}"}
