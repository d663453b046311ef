"""Reads audio files of any rate and format as samples at 16 kHz."""

from pathlib import Path

import numpy as np
import soundfile
import soxr

from umo_train.data.clip import DataError
from umo_train.speech.utterance import SAMPLE_RATE


def samples(path: Path) -> np.ndarray:
    """One channel, f32, -1..1; the mean of several."""
    try:
        channels, rate = soundfile.read(path, dtype="float32", always_2d=True)
    except soundfile.LibsndfileError as error:
        raise DataError(f"{path}: cannot read audio from it, fetch it again: {error}") from error
    if not np.isfinite(channels).all():
        raise DataError(f"{path}: samples that are not numbers, fetch it again")
    return soxr.resample(channels.mean(1), rate, SAMPLE_RATE).astype(np.float32)
