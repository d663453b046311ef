"""Lets tests import the package and each other's synthetic data from any working directory."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
