"""A small SentencePiece model with T5's special ids, and the sentencepiece package's encoding of awkward prompts."""

import io
import json
from importlib.metadata import version
from pathlib import Path

import sentencepiece

PIECES = 400
SENTENCES = Path(__file__).with_name("sentences.txt")

PROMPTS = (
    "",
    " ",
    "a person waves",
    "A person waves with the right hand.",
    "a  person   waves",
    "  leading and trailing spaces  ",
    "first line\nsecond line",
    "tab\tand\r\nreturn",
    "speak with a happy voice, calm hands and small gestures",
    "don't stop; she's \"angry\" (very) - or is she?",
    "0123456789 3.14 1,000",
    "naïve café über façade",
    "nai\u0308ve cafe\u0301",
    "ﬁne ﬂow ½ ① ＡＢＣ ｶﾞ",
    "Привет, мир",
    "日本語のテキスト",
    "wave 👋🏽 now 👩‍👩‍👧",
    "no\u00a0break\u2003em\u200bzero\ufeffbom",
    "soft\u00adhyphen \u0007bell",
    "▁lower▁one▁eighth▁block",
    "<pad></s><unk> <extra_id_0>",
    "qqqqzzzzxxxx",
    "ΑαΒβ ∑∞≠",
    "עברית و عربى",
    "word" * 60,
    "~",
    "a",
    "\n",
    "a person walks forward slowly and then waves with both hands. " * 80,
)


def make(folder: Path) -> bytes:
    """Trains the model and writes `text.model` and `cases.json`; returns the model's bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    written = io.BytesIO()
    sentencepiece.SentencePieceTrainer.train(
        sentence_iterator=iter(SENTENCES.read_text(encoding="utf-8").splitlines()),
        model_writer=written,
        vocab_size=PIECES,
        model_type="unigram",
        pad_id=0,
        eos_id=1,
        unk_id=2,
        bos_id=-1,
        byte_fallback=False,
        num_threads=1,
        minloglevel=2,
    )
    model = written.getvalue()
    (folder / "text.model").write_bytes(model)
    processor = sentencepiece.SentencePieceProcessor(model_proto=model)
    assert processor.vocab_size() == PIECES
    assert (processor.pad_id(), processor.eos_id(), processor.unk_id()) == (0, 1, 2)
    rows = [{"text": prompt, "ids": processor.encode(prompt, add_bos=False, add_eos=False)} for prompt in PROMPTS]
    assert any(2 in row["ids"] for row in rows) and len({i for row in rows for i in row["ids"]}) > 60
    head = json.dumps({"sentencepiece": version("sentencepiece"), "pieces": PIECES})[:-1]
    body = ",\n".join("    " + json.dumps(row) for row in rows)
    (folder / "cases.json").write_text(f'{head}, "cases": [\n{body}\n]}}\n', encoding="utf-8")
    print(f"text: {len(model)} bytes, {len(rows)} prompts")
    return model
