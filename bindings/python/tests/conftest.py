"""Shared by the tests: the speech, the models, and the installation that the wheel was made from.
"""

import os
import warnings
import wave
from pathlib import Path

import numpy as np
import pytest

import umo

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def prefix():
    return Path(os.environ["UMO_PREFIX"])


@pytest.fixture(scope="session")
def hello():
    """16-bit samples and their rate."""
    with wave.open(str(ROOT / "assets/hello.wav")) as file:
        assert (file.getsampwidth(), file.getnchannels()) == (2, 1)
        return np.frombuffer(file.readframes(file.getnframes()), "<i2"), file.getframerate()


@pytest.fixture(scope="session")
def model():
    with warnings.catch_warnings():
        # The notice of an untrained model; test_model.py checks it.
        warnings.simplefilter("ignore", UserWarning)
        return umo.Model()


@pytest.fixture(scope="session")
def mouth_model():
    """A small model of random weights with a mouth network."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return umo.Model(ROOT / "tests/golden/mel_k2_arkit/model.safetensors")


@pytest.fixture(scope="session")
def whole(hello, model):
    return umo.animate(*hello, model=model)


@pytest.fixture(scope="session")
def live(hello, model):
    """Default frames of a session: no lookahead audio."""
    return umo.animate(*hello, model=model, horizon=0)
