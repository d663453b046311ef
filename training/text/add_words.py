"""Adds the words of the performer's prompts to a SentencePiece vocabulary, each as one piece.

Usage: python training/text/add_words.py [BASE] [OUT]      (needs the packages `sentencepiece` and
`protobuf`)

Prompts are few and short. Spelled in letters, "he bows" and "he boxes" share most of their pieces,
and a model can distinguish them only late. The pieces of BASE keep their ids; the new ones are
appended.
"""

import sys

from sentencepiece import sentencepiece_model_pb2 as proto

from umo_train.performer.actions import ACTIONS
from umo_train.performer.style import PROMPTS

BASE, OUT = "cli/assets/text.model", "training/text/people.model"
# SentencePiece's marker of the space before a word.
SPACE = "\u2581"


def words() -> list[str]:
    """Words of all prompts in alphabetical order, without trailing punctuation."""
    prompts = [*PROMPTS.values(), *(action.prompts for action in ACTIONS.values())]
    return sorted({word.strip(",") for some in prompts for prompt in some for word in prompt.split()})


def main() -> None:
    base, out = [*sys.argv[1:], *(BASE, OUT)[len(sys.argv) - 1 :]]
    with open(base, "rb") as file:
        model = proto.ModelProto.FromString(file.read())
    pieces = {piece.piece: piece for piece in model.pieces}
    for word in words():
        piece = pieces.get(SPACE + word) or model.pieces.add(piece=SPACE + word)
        # The maximum score: whole words win over their parts.
        piece.score = 0.0
    model.trainer_spec.vocab_size = len(model.pieces)
    with open(out, "wb") as file:
        file.write(model.SerializeToString())


if __name__ == "__main__":
    main()
