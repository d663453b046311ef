"""Trains the small SentencePiece vocabulary of the default model from words that describe speech and movement.

Usage: python training/text/make_tokenizer.py [OUT]      (needs the packages `sentencepiece` and `protobuf`)

No normalisation table is stored (`identity`), which keeps the file small; ids 0, 1, 2 are padding, end and unknown as
in T5. The sentences come from the grammar below, so the file may be redistributed with this project.
"""

import io
import itertools
import sys

import sentencepiece as spm

PIECES = 180

WHO = ["a person", "someone", "the speaker", "a woman", "a man", "a young person", "an old friend"]
HOW = (
    "calm, calmly, excited, excitedly, happy, happily, sad, sadly, angry, angrily, tired, nervous, friendly, "
    "serious, proud, shy, surprised, bored, slow, slowly, fast, quickly, gently"
).split(", ")
DOES = (
    "waves, nods, shakes the head, points, points to the left, points to the right, shrugs, bows, counts, claps, "
    "leans forward, leans back, looks up, looks down, looks around, opens both arms, crosses the arms, raises the "
    "right hand, raises the left hand, steps forward, steps back, walks, turns around, stands still, explains an "
    "idea, tells a story, asks a question, greets a friend, says goodbye, laughs, smiles, listens, thinks, "
    "speaks, talks, whispers, shouts, sings, argues, agrees, refuses, welcomes the guests"
).split(", ")
WITH = (
    "with both hands, with one hand, with open palms, with big gestures, with small gestures, while speaking"
).split(", ")


def sentences() -> list[str]:
    """Every sentence of the grammar, in a fixed order."""
    plain = [f"{who} {does}" for who, does in itertools.product(WHO, DOES)]
    styled = [f"{who} {does} {how}" for who, does, how in itertools.product(WHO[:3], DOES, HOW)]
    longer = [f"{does} {way}" for does, way in itertools.product(DOES, WITH)]
    return plain + styled + longer + HOW + [f"{a}, {b}" for a, b in itertools.combinations(HOW, 2)]


def main() -> None:
    out = sys.argv[1] if len(sys.argv) > 1 else "cli/assets/text.model"
    model = io.BytesIO()
    spm.SentencePieceTrainer.train(
        sentence_iterator=iter(sentences()),
        model_writer=model,
        model_type="unigram",
        vocab_size=PIECES,
        character_coverage=1.0,
        normalization_rule_name="identity",
        required_chars="abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,;:!?'\"-()",
        pad_id=0,
        eos_id=1,
        unk_id=2,
        bos_id=-1,
        minloglevel=2,
        num_threads=1,
    )
    with open(out, "wb") as file:
        file.write(model.getvalue())


if __name__ == "__main__":
    main()
