"""How somebody talks, as numbers and as a text prompt."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """Each 0..1: size and speed of movement, gestures per accent, how wide arms and posture open, and the face's mood
    (0 stern, 0.5 neutral, 1 smiling)."""

    energy: float = 0.5
    gesture_rate: float = 0.5
    openness: float = 0.5
    mood: float = 0.5


# The named styles; each has its prompts in `PROMPTS`.
STYLES = {
    "neutral": Style(),
    "calm": Style(energy=0.15, gesture_rate=0.2, openness=0.3, mood=0.55),
    "excited": Style(energy=1.0, gesture_rate=0.9, openness=0.95, mood=0.9),
    "explaining": Style(energy=0.65, gesture_rate=1.0, openness=0.7, mood=0.5),
    "stern": Style(energy=0.4, gesture_rate=0.35, openness=0.15, mood=0.0),
    "shy": Style(energy=0.2, gesture_rate=0.3, openness=0.0, mood=0.65),
}
PROMPTS = {
    "neutral": ("", "talking", "a person talks"),
    "calm": ("calm", "speaking calmly", "relaxed and quiet"),
    "excited": ("excited", "happy and excited", "full of energy"),
    "explaining": ("explaining", "giving a lecture", "explaining something"),
    "stern": ("stern", "serious", "angry and strict"),
    "shy": ("shy", "timid", "nervous and shy"),
}
