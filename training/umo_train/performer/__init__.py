"""A procedural performer: rule-based motion for speech, which the default model learns from."""

from umo_train.performer.lips import lip_opening
from umo_train.performer.perform import perform
from umo_train.performer.style import PROMPTS, STYLES, Style

__all__ = ["PROMPTS", "STYLES", "Style", "lip_opening", "perform"]
