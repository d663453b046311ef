"""All measures of a model, over held-out items and real recordings; one function per group of measures."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from umo_train.metrics import agreement, beat, body, diversity, experts, fgd, frame_agreement, lips, motion, program
from umo_train.metrics import speed as speeds
from umo_train.metrics.item import Item, Motion
from umo_train.performer.lips import lip_opening
from umo_train.skeleton import PARTS

# Number of shuffles whose mean distance is the reference.
SHUFFLES = 16
# Number of takes whose mean distance is the model's: single takes differ by a half.
TAKES = 8


@dataclass(frozen=True)
class Subject:
    """The measured model and program."""

    umo: Path
    # The model embedded in the program by default.
    model: Path | None = None
    # The same model with float weights, for comparison with int8; `model` itself by default.
    exact: Path | None = None
    seed: int = 0
    # Other arguments of `umo animate`, such as `--horizon 0`.
    more: tuple[str, ...] = ()

    def animate(self, item: Item, seed: int | None = None, prompt: str | None = None) -> dict[str, np.ndarray]:
        return program.animate(
            self.umo, item, self.model, self.seed if seed is None else seed, prompt or None, more=self.more
        )


@dataclass(frozen=True)
class Made:
    """An item and the model's motion."""

    item: Item
    motion: Motion


@dataclass
class Measured:
    """Numbers by group (for `report.json`), and data for plots only."""

    groups: dict[str, Any] = field(default_factory=dict)
    held_out: list[Made] = field(default_factory=list)
    real: list[Made] = field(default_factory=list)
    performer: list[Motion] = field(default_factory=list)


def mouth(made: Sequence[Made]) -> dict[str, Any]:
    """Jaw and lips compared with the performer's, closures and pauses; also the performer's own values."""
    out: dict[str, Any] = {}
    for split in sorted({m.item.split for m in made}):
        rows = [m for m in made if m.item.split == split]
        frames = [min(len(m.motion["face"]), len(m.item.motion["face"])) for m in rows]
        own = [m.motion["face"][:n] for m, n in zip(rows, frames, strict=True)]
        given = [m.item.motion["face"][:n] for m, n in zip(rows, frames, strict=True)]
        opening = [lip_opening(face) for face in own]
        wanted = [lip_opening(face) for face in given]
        phones = [m.item.phones for m in rows]

        def share(found: list[np.ndarray]) -> float | None:
            joined = np.concatenate(found) if found else np.zeros(0)
            return float(joined.mean()) if len(joined) else None

        def follows(mouths: list[np.ndarray], rows: list[Made] = rows) -> float:
            pairs = [(o, lips.envelope(m.item.samples, len(o))) for o, m in zip(mouths, rows, strict=True)]
            return max(lips.lag_correlation(pairs).values())

        # Closures reached by a mouth that closes as often at unrelated times.
        apart = [np.roll(values, len(values) // 2) for values in opening]
        out[split or "all"] = {
            "items": len(rows),
            "jaw_correlation": lips.pearson(
                np.concatenate([lips.jaw_opening(face) for face in own]),
                np.concatenate([lips.jaw_opening(face) for face in given]),
            ),
            "lip_correlation": lips.pearson(np.concatenate(opening), np.concatenate(wanted)),
            "closures": share([lips.closures(o, p) for o, p in zip(opening, phones, strict=True)]),
            "closures_by_chance": share([lips.closures(o, p) for o, p in zip(apart, phones, strict=True)]),
            "closures_of_performer": share([lips.closures(o, p) for o, p in zip(wanted, phones, strict=True)]),
            "pauses": share([lips.pauses(o, lips.silences(p)) for o, p in zip(opening, phones, strict=True)]),
            "pauses_of_performer": share(
                [lips.pauses(o, lips.silences(p)) for o, p in zip(wanted, phones, strict=True)]
            ),
            "envelope_correlation": follows(opening),
            "envelope_correlation_of_performer": follows(wanted),
            "lip_deviation": float(np.concatenate(opening).std()),
            "lip_deviation_of_performer": float(np.concatenate(wanted).std()),
        }
    return out


def real_mouth(made: Sequence[Made]) -> dict[str, Any]:
    """Mouth compared with the speech's envelope by speaker, each at its best lag; stillness in the recordings'
    silences."""
    out: dict[str, Any] = {}
    for speaker in sorted({m.item.voice for m in made}):
        rows = [m for m in made if m.item.voice == speaker]
        opening = [lip_opening(m.motion["face"]) for m in rows]
        sound = [lips.envelope(m.item.samples, len(o)) for m, o in zip(rows, opening, strict=True)]
        lags = lips.lag_correlation(list(zip(opening, sound, strict=True)))
        still = [lips.pauses(o, lips.quiet_parts(m.item.samples)) for m, o in zip(rows, opening, strict=True)]
        still = np.concatenate(still)
        best = max(lags, key=lags.get)
        out[speaker] = {
            "recordings": len(rows),
            "correlation": lags[best],
            "lag": best,
            "by_lag": lags,
            "pauses": float(still.mean()) if len(still) else None,
        }
    return out


def captured_mouth(made: Sequence[Made], captured: Sequence[np.ndarray]) -> dict[str, Any]:
    """Mouth compared with captured ones `[T]`, by recording at its best lag; also the correlation of the speech's
    loudness."""
    out: dict[str, Any] = {}
    for m, wanted in zip(made, captured, strict=True):
        frames = min(len(m.motion["face"]), len(wanted))
        own = lip_opening(m.motion["face"][:frames])
        loud = lips.envelope(m.item.samples, frames)
        out[m.item.name] = {
            "correlation": max(lips.lag_correlation([(own, wanted[:frames])]).values()),
            "envelope_correlation": max(lips.lag_correlation([(loud, wanted[:frames])]).values()),
        }
    return out


def beats(made: Sequence[Made]) -> dict[str, Any]:
    """Beat constancy at BEAT's width and at the sharp one: onsets of all speech, accented syllables if known."""
    out: dict[str, Any] = {}
    turns = [beat.turning_points(m.motion) for m in made]
    theirs = [beat.turning_points(m.item.motion) if m.item.motion else None for m in made]
    sounds = {"onsets": [beat.onsets(m.item.samples) for m in made]}
    if all(m.item.phones for m in made):
        sounds["accents"] = [beat.stressed(m.item) for m in made]
    for name, events in sounds.items():
        for width, sigma in (("beat", beat.SIGMA_S), ("sharp", beat.SHARP_SIGMA_S)):
            for whose, points in (("", turns), ("_of_performer", theirs)):
                rows = [(e, t, m.item.seconds) for e, t, m in zip(events, points, made, strict=True) if t is not None]
                if rows:
                    found = beat.beat(rows, sigma)
                    out[f"{name}_{width}{whose}"] = asdict(found) | {"ratio": found.ratio}
    return out


def code_shapes(config: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """Number of codes of each moving part, and in layout `frames` number of levels."""
    if config.get("layout") != "frames":
        return {part: (config["vq"]["codes"],) for part in PARTS}
    return {part["name"]: (part["codes"], part["levels"]) for part in config["parts"] if part.get("channels")}


def distance(
    subject: Subject, made: Sequence[Made], encoder: fgd.AutoEncoder, seed: int = 0
) -> dict[str, float | None]:
    """FGD to the performer's motion for the same held-out speech, with reference values.

    The model's takes are without layers, which the performer lacks: the foot layer alone rotates ankles more than the
    performer does, and would dominate. `with_layers` is the distance of `made`.
    """
    rng = np.random.default_rng(seed)
    reference = [m.item.motion for m in made]
    target = encoder.features(reference)
    shapes = code_shapes(agreement.config_of(subject.umo, subject.model))
    drawn = [
        program.decode(
            subject.umo,
            {name: rng.integers(0, most, (len(m.motion["face"]), *levels)) for name, (most, *levels) in shapes.items()},
            subject.model,
        )
        for m in made
    ]
    again = [m.item.again for m in made if m.item.again is not None]

    def to_performer(motions: Sequence[Motion]) -> float:
        return fgd.frechet(encoder.features(motions), target)

    bare = replace(subject, more=(*subject.more, "--layers", "0"))
    takes = [
        to_performer([bare.animate(m.item, subject.seed + take, m.item.prompt) for m in made]) for take in range(TAKES)
    ]
    return {
        "model": float(np.mean(takes)),
        "least": min(takes),
        "most": max(takes),
        "with_layers": to_performer([m.motion for m in made]),
        "random_codes": to_performer(drawn),
        # Single shuffles of sixteen items differ by a third.
        "shuffled_chunks": float(
            np.mean([to_performer([fgd.shuffled(motion, rng) for motion in reference]) for _ in range(SHUFFLES)])
        ),
        # Noise of the measure: the performer with another seed, if known.
        "performer_again": to_performer(again) if len(again) > 1 else None,
        "windows": len(target),
    }


def variety(subject: Subject, items: Sequence[Item], seeds: int = 2) -> dict[str, Any]:
    """Diversity across seeds and prompts over items with other known takes, compared with the performer's; and the
    separability of prompts."""
    varied = [item for item in items if len(item.takes) > 1]
    if not varied:
        return {}
    prompts = [prompt for prompt in varied[0].takes if all(prompt in item.takes for item in varied)]
    made = [
        {prompt: [subject.animate(item, seed, prompt) for seed in range(seeds)] for prompt in prompts}
        for item in varied
    ]
    given = [{prompt: item.takes[prompt] for prompt in prompts} for item in varied]
    out: dict[str, Any] = {"items": len(varied), "prompts": prompts}
    for whose, sets in (("model", made), ("performer", given)):
        every = [
            (prompt, item.name, m)
            for item, takes in zip(varied, sets, strict=True)
            for prompt in takes
            for m in takes[prompt]
        ]
        out[whose] = {
            "seeds": float(np.mean([diversity.l1_between(motions) for takes in sets for motions in takes.values()])),
            "prompts": float(np.mean([diversity.across_prompts(takes) for takes in sets])),
            "spread": diversity.l1_spread([motions for *_, motions in every]),
            "separable": diversity.separability(every) if len(varied) > 1 else None,
        }
    return out


def smoothness(motions: Sequence[Motion]) -> dict[str, float]:
    return {
        "jerk": float(np.mean([motion.jerk(m) for m in motions])),
        # Contacts by height for all, as the program's motion has none.
        "foot_slide": float(np.mean([motion.foot_slide(m, motion.contacts(m)) for m in motions])),
        "speed": float(np.mean([motion.joint_speed(m).mean() for m in motions])),
    }


def tokens(subject: Subject, items: Sequence[Item], chunks: int = 80) -> dict[str, Any]:
    """Agreement of int8 with f32, and the use of codes and experts, over the beginnings of some items."""
    exact = subject.exact or subject.model
    config = agreement.config_of(subject.umo, exact)
    if config.get("layout") == "frames":
        each = max(chunks // len(items), 1)
        drawn = [c for item in items for c in frame_agreement.trace(subject.umo, item, exact, each)]
        used = frame_agreement.code_counts(drawn, config)
        return {
            "chunks": len(drawn),
            "agreement": frame_agreement.agreement(subject.umo, drawn, exact, subject.model),
            "codes_used": {part: int((c > 0).sum()) for part, c in used.items()},
            "code_entropy": {part: motion.use_entropy(c) for part, c in used.items()},
        }
    traced = [c for item in items for c in agreement.trace(subject.umo, item, exact, max(chunks // len(items), 1))]
    counts = agreement.code_counts(traced, config["vq"]["codes"])
    out: dict[str, Any] = {
        "chunks": len(traced),
        "agreement": agreement.agreement(subject.umo, traced, exact, subject.model),
        "codes_used": {part: int((c > 0).sum()) for part, c in counts.items()},
        "code_entropy": {part: motion.use_entropy(c) for part, c in counts.items()},
    }
    if exact:
        used = experts.first_choices(exact, traced)
        out["expert_use"] = {layer: (c / c.sum()).tolist() for layer, c in used.items()}
        out["expert_entropy"] = experts.entropy(used)
    return out


def measure(
    subject: Subject,
    held_out: Sequence[Item],
    real: Sequence[Item],
    encoder: fgd.AutoEncoder,
    seeds: int = 2,
    captured: Sequence[tuple[Item, np.ndarray]] = (),
) -> Measured:
    """All groups. `held_out` have motion and phones, `real` neither, `captured` the opening of a mouth; groups of empty
    lists are left out."""
    result = Measured()
    result.held_out = [Made(item, subject.animate(item, prompt=item.prompt)) for item in held_out]
    result.real = [Made(item, subject.animate(item)) for item in real]
    result.performer = [item.motion for item in held_out]
    groups = result.groups
    if held_out:
        groups["mouth"] = mouth(result.held_out)
        groups["beat"] = beats(result.held_out)
        groups["fgd"] = distance(subject, result.held_out, encoder)
        groups["variety"] = variety(subject, held_out, seeds)
        groups["performer"] = smoothness(result.performer) | body.body(result.performer)
    if real:
        groups["real_mouth"] = real_mouth(result.real)
        groups["real_beat"] = beats(result.real)
        groups["body"] = body.body([m.motion for m in result.real])
    if captured:
        made = [Made(item, subject.animate(item)) for item, _ in captured]
        groups["captured_mouth"] = captured_mouth(made, [opening for _, opening in captured])
    all_made = [m.motion for m in (*result.held_out, *result.real)]
    groups["model"] = smoothness(all_made)
    groups["tokens"] = tokens(subject, (held_out or real)[:4])
    groups["speed"] = asdict(speeds.speed(subject.umo, subject.model))
    return result
