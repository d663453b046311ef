"""A way of talking, as numbers and as a text prompt."""

import random
from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """Each 0..1: size and speed of movement, gestures per accent, openness of arms and posture, and the face's mood (0
    stern, 0.5 neutral, 1 smiling). `feeling` is an emotion of `feelings.FEELINGS`. A listening style does not speak:
    the voice is the interlocutor's."""

    energy: float = 0.5
    gesture_rate: float = 0.5
    openness: float = 0.5
    mood: float = 0.5
    feeling: str | None = None
    listens: bool = False


# The named styles; each has its prompts in `PROMPTS` and its share of the corpus in `_SHARES`.
STYLES = {
    "neutral": Style(),
    "explaining": Style(energy=0.65, gesture_rate=1.0, openness=0.7),
    "calm": Style(energy=0.15, gesture_rate=0.2, openness=0.3, mood=0.55),
    "excited": Style(energy=1.0, gesture_rate=0.9, openness=0.95, mood=0.9),
    "stern": Style(energy=0.4, gesture_rate=0.35, openness=0.15, mood=0.0),
    "shy": Style(energy=0.2, gesture_rate=0.3, openness=0.0, mood=0.65),
    "joyful": Style(energy=0.75, gesture_rate=0.7, openness=0.8, feeling="joy"),
    "sad": Style(energy=0.1, gesture_rate=0.15, openness=0.15, feeling="sadness"),
    "angry": Style(energy=0.9, gesture_rate=0.8, openness=0.55, feeling="anger"),
    "surprised": Style(energy=0.7, gesture_rate=0.6, openness=0.75, feeling="surprise"),
    "disgusted": Style(energy=0.4, gesture_rate=0.4, openness=0.3, feeling="disgust"),
    "afraid": Style(energy=0.5, gesture_rate=0.35, openness=0.05, feeling="fear"),
    "listening": Style(energy=0.3, gesture_rate=0.0, openness=0.4, listens=True),
}
PROMPTS = {
    "neutral": ("", "talking", "a person talks"),
    "explaining": ("explaining", "giving a lecture", "explaining something"),
    "calm": ("calm", "speaking calmly", "relaxed and quiet"),
    "excited": ("excited", "very excited", "full of energy"),
    "stern": ("stern", "serious", "strict and serious"),
    "shy": ("shy", "timid", "nervous and shy"),
    "joyful": ("joyful", "happy", "happy and cheerful"),
    "sad": ("sad", "sad and tired", "speaking sadly"),
    "angry": ("angry", "furious", "speaking angrily"),
    "surprised": ("surprised", "astonished", "cannot believe it"),
    "disgusted": ("disgusted", "full of disgust", "that is disgusting"),
    "afraid": ("afraid", "scared", "full of fear"),
    "listening": ("listening", "listening to somebody", "a person listens"),
}
# Styles without instruction: only examples of these are used without a prompt.
UNTOLD = ("neutral", "explaining")
_SHARES = {"neutral": 4.0, "explaining": 3.0, "listening": 1.2}


def draw(chance: random.Random) -> tuple[str, str]:
    """A style and one of its prompts."""
    style = chance.choices(list(STYLES), [_SHARES.get(name, 0.9) for name in STYLES])[0]
    return style, chance.choice(PROMPTS[style])
