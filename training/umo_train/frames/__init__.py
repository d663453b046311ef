"""Training for layout `frames` (SPEC 2.12 to 2.16): residual codes of arbitrary parts, a keyframe per position."""
