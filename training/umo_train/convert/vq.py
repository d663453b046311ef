"""Motion codecs of EMAGE (one file a part) and Language of Motion (all in one): `VQVAEConvZero`, `VAEConvZero`."""

from collections.abc import Iterable
from pathlib import Path

from umo_train.convert.layout import Config, shapes
from umo_train.convert.sources import SourceError, Tensors, read, renamed
from umo_train.skeleton import PARTS

_CODECS = (*PARTS, "root")
# Name prefixes of a codec in files with several: Language of Motion's, then EMAGE's.
_PREFIXES = {
    "face": ("vae_face.", "vq_model_face."),
    "hands": ("vae_hand.", "vae_hands.", "vq_model_hands."),
    "upper": ("vae_upper.", "vq_model_upper."),
    "lower": ("vae_lower.", "vq_model_lower."),
    "root": ("vae_global.", "global_motion."),
}
_CODEBOOK = "quantizer.embedding.weight"
_FIRST = "encoder.main.0.weight"
# Statistics of a codebook's training.
_IGNORED = (r"quantizer\.embedding\.(cluster_size|embed_avg)",)
# Other contents of a whole program's checkpoint: the language model, body models, and metrics.
_OTHERS = ("lm.", "smplx.", "flame.", "_losses.", "metrics.", "Metrics.")


def convert(paths: Iterable[Path], config: Config) -> Tensors:
    """`vq.*` from files that together contain every codec once."""
    codecs: dict[str, tuple[Path, Tensors]] = {}
    for path in paths:
        for codec, source in _split(path, config).items():
            if codec in codecs:
                raise SourceError(f"{path}: the codec `{codec}` is in {codecs[codec][0]} too")
            codecs[codec] = path, source
    lacking = [codec for codec in _CODECS if codec not in codecs]
    if lacking:
        raise SourceError(f"no file has the codec of {', '.join(lacking)}: give each with --vq")
    out: Tensors = {}
    for codec, (path, source) in codecs.items():
        prefix = f"vq.{codec}."
        wanted = {name: shape for name, shape in shapes(config).items() if name.startswith(prefix)}
        names = {name: name.removeprefix(prefix) for name in wanted}
        out |= renamed(f"{path} ({codec} codec)", source, names, wanted, _IGNORED)
    return out


def _split(path: Path, config: Config) -> dict[str, Tensors]:
    """The codecs of one file, by name."""
    found = read(path)
    out: dict[str, Tensors] = {}
    rest = dict(found)
    for codec, prefixes in _PREFIXES.items():
        for prefix in prefixes:
            names = [name for name in rest if name.startswith(prefix)]
            out.setdefault(codec, {}).update({name.removeprefix(prefix): rest.pop(name) for name in names})
    out = {codec: tensors for codec, tensors in out.items() if tensors}
    if not out:
        return {_which(path, found, config): found}
    unknown = sorted(name for name in rest if not name.startswith(_OTHERS))
    if unknown:
        raise SourceError(f"{path}:\n  " + "\n  ".join(f"unknown: {name}" for name in unknown))
    return out


def _which(path: Path, tensors: Tensors, config: Config) -> str:
    """The part of a file with one codec: by its channels, and by the root network's missing codebook."""
    if _FIRST not in tensors:
        some = ", ".join(sorted(tensors)[:3]) or "nothing"
        raise SourceError(f"{path}: no codec in it: {_FIRST} is missing; it has {some} …")
    channels = tensors[_FIRST].shape[1]
    codecs = PARTS if _CODEBOOK in tensors else ("root",)
    fitting = [codec for codec in codecs if config["vq"][codec]["channels"] == channels]
    if len(fitting) == 1:
        return fitting[0]
    sizes = ", ".join(f"{codec} {config['vq'][codec]['channels']}" for codec in codecs)
    raise SourceError(f"{path}: a codec of {channels} channels, but the config has {sizes}")
