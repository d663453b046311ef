"""The bars of the default model, evaluated from the measures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Groups = dict[str, Any]


@dataclass(frozen=True)
class Bar:
    """`value` is None if it could not be measured, which counts as missed."""

    name: str
    value: float | None
    bar: float
    at_least: bool
    note: str = ""

    @property
    def met(self) -> bool:
        if self.value is None:
            return False
        return self.value >= self.bar if self.at_least else self.value <= self.bar


def _found(read: Callable[[], float | None]) -> float | None:
    """None if a group or a key is missing, or a share has no samples."""
    try:
        return read()
    except (KeyError, TypeError, ZeroDivisionError, ValueError):
        return None


def _least(groups: Groups, key: str) -> float:
    return min(split[key] for split in groups["mouth"].values())


def _fgd_over(groups: Groups, other: str) -> float:
    return groups["fgd"]["model"] / groups["fgd"][other]


def judge(groups: Groups) -> list[Bar]:
    """Every bar in the order of the model card."""
    worst = "the worst split"
    rows: list[tuple[str, Callable[[], float | None], float, bool, str]] = [
        ("jaw against the performer's, correlation", lambda: _least(groups, "jaw_correlation"), 0.88, True, worst),
        (
            "lip opening against the performer's, correlation",
            lambda: _least(groups, "lip_correlation"), 0.88, True, worst,
        ),
        ("lips closed within 1 frame at p b m", lambda: _least(groups, "closures"), 0.93, True, worst),
        ("mouth still in pauses of 0.4 s and more", lambda: _least(groups, "pauses"), 0.95, True, worst),
        (
            "real speech: mouth against envelope, correlation",
            lambda: min(speaker["correlation"] for speaker in groups["real_mouth"].values()),
            0.5, True, "the worst speaker, best lag within 2 frames",
        ),
        (
            "captured mouths: correlation over the envelope's own",
            lambda: min(one["correlation"] / one["envelope_correlation"] for one in groups["captured_mouth"].values()),
            1.0, True, "the worst recording",
        ),
        (
            "beat constancy on accented syllables over that of shifted audio",
            lambda: groups["beat"]["accents_sharp"]["ratio"], 1.25, True, "sigma 0.1 s",
        ),
        ("FGD over that of random codes", lambda: _fgd_over(groups, "random_codes"), 0.25, False, ""),
        ("FGD over that of shuffled chunks", lambda: _fgd_over(groups, "shuffled_chunks"), 0.3, False, ""),
        (
            "diversity across seeds over the performer's",
            lambda: groups["variety"]["model"]["seeds"] / groups["variety"]["performer"]["seeds"], 0.5, True, "",
        ),
        (
            "diversity across prompts over the performer's",
            lambda: groups["variety"]["model"]["prompts"] / groups["variety"]["performer"]["prompts"], 0.5, True, "",
        ),
        ("prompts told apart", lambda: groups["variety"]["model"]["separable"], 0.9, True, "share of windows of 5 s"),
        (
            "actions from text known for what was asked", lambda: groups["actions"]["model"], 0.9, True,
            "share, by a classifier of the performer's",
        ),
        ("head's standard deviation: yaw, degrees", lambda: groups["body"]["head_yaw"], 2.5, True, "without a prompt"),
        ("head's standard deviation: pitch, degrees", lambda: groups["body"]["head_pitch"], 2.0, True, ""),
        ("head's standard deviation: roll, degrees", lambda: groups["body"]["head_roll"], 1.5, True, ""),
        ("gesture phrases, median, s", lambda: groups["body"]["phrase_median"], 2.0, True, ""),
        ("wrists' jerk, 95 %, m/s3", lambda: groups["body"]["wrist_jerk_95"], 260.0, False, "people have 188"),
        ("codes of int8 as of f32", lambda: groups["tokens"]["agreement"]["all"], 0.98, True, "share, same history"),
    ]  # fmt: skip
    return [Bar(name, _found(read), bar, at_least, note) for name, read, bar, at_least, note in rows]
