"""Converts weights of published models to one umo file: HuBERT, k-means, T5, and the motion codecs of EMAGE."""

from umo_train.convert.model import Model, convert, write
from umo_train.convert.sources import SourceError

__all__ = ["Model", "SourceError", "convert", "write"]
