"""Actions prompted by text, from an animator's clips: stand, perform, stand again."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from umo_train.performer import clips, intent
from umo_train.performer.curves import plateaus
from umo_train.performer.perform import perform
from umo_train.performer.style import Style
from umo_train.skeleton import CONTACT, JOINT, JOINTS_OF, VELOCITY, places, rotation_6d, rotations
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Phone, Utterance

# Blend time between standing and the clip, seconds.
_BLEND_S = 0.45
# Speed above which a wrist gestures, m/s.
_STROKE_M_S = 0.35


@dataclass(frozen=True)
class Action:
    """`clips` are names of clips that show it, each played once, or looped for about the given seconds."""

    prompts: tuple[str, ...]
    clips: tuple[str, ...]
    loop_s: float = 0.0
    feeling: str | None = None


ACTIONS = {
    "bow": Action(("she bows", "he bows", "bow", "a person bows"), ("Bow",)),
    "scratch head": Action(("she scratches her head", "he scratches his head", "scratching the head"), ("Confused",)),
    "drink": Action(("she drinks", "he drinks something", "drinking"), ("Consume Item",)),
    "dance": Action(
        ("she dances", "he dances", "dance", "a person dances"),
        ("Dance Charleston", "Dance Body Roll", "Dance Reach Hip", "Dance_Loop"), 6.0, "joy",
    ),
    "sway": Action(("she is dizzy", "he is dizzy", "dizzy"), ("Dizzy",), 4.5),
    "refuse": Action(("she refuses", "he waves it off", "no, no"), ("Reject",)),
    "shiver": Action(("she shivers", "he is cold", "shivering"), ("Shivering",), 3.0),
    "throw": Action(("she throws a ball", "he throws something", "throw"), ("Throw Object",)),
    "cheer": Action(("she cheers", "he celebrates", "victory"), ("Victory",), 3.0, "joy"),
    "press": Action(("she presses a button", "he points at it", "pressing a button"), ("Interact",)),
    "pick up": Action(("she picks something up", "he takes something from a table", "pick it up"), ("PickUp_Table",)),
    "punch": Action(("she punches", "he boxes", "a punch"), ("Punch_Cross",), 2.5, "anger"),
    "walk": Action(("she walks", "he walks", "walk", "a person walks"), ("Walk_Loop", "Walk_Formal_Loop"), 6.0),
}  # fmt: skip


def read_clips(files: list[Path]) -> dict[str, np.ndarray]:
    """Rotations `[T, 55, 3, 3]` of all clips used by actions. Raises `ValueError` if one is missing."""
    found = {clip.name: clip.local for path in files for clip in clips.read(path)}
    wanted = [name for action in ACTIONS.values() for name in action.clips]
    missing = [name for name in wanted if name not in found]
    if missing:
        raise ValueError(f"no clip named {', '.join(missing)} in {len(files)} files")
    return {name: found[name] for name in wanted}


def act(
    action: Action, found: dict[str, np.ndarray], seconds: float, seed: int
) -> tuple[Utterance, dict[str, np.ndarray]]:
    """Silence and the motion of repeating an action, with the performer's standing in between: channels as from
    `perform`."""
    random = np.random.default_rng(seed)
    frames = int(seconds * FRAME_RATE)
    samples = np.zeros(frames * SAMPLE_RATE // FRAME_RATE, np.float32)
    silence = Utterance("silence", "", samples, (Phone(SILENCE, 0.0, len(samples) / SAMPLE_RATE),))
    style = Style(energy=random.uniform(0.2, 0.5), openness=random.uniform(0.3, 0.6), feeling=action.feeling)
    motion = perform(silence, style, seed)
    frames = silence.frames

    local, t = rotations(motion), np.arange(frames) / FRAME_RATE
    at = random.uniform(0.8, 2.0)
    acting = np.zeros(frames)
    while True:
        played = _take(action, found, random)
        length = len(played) / FRAME_RATE
        if at + length + 0.6 > seconds:
            break
        share = plateaus(t, at + _BLEND_S, at + length - _BLEND_S, _BLEND_S, _BLEND_S)
        near = np.flatnonzero(share > 0.0)
        shown = played[np.clip(near - int(at * FRAME_RATE), 0, len(played) - 1)]
        # Jaw and eyes come from the performer.
        kept = [JOINT[name] for name in ("jaw", "left_eye", "right_eye")]
        shown[:, kept] = local[near][:, kept]
        local[near] = clips.blended(local[near], shown, share[near])
        acting = np.maximum(acting, share)
        at += length + random.uniform(0.8, 2.5)
    _write(motion, local, acting)
    return silence, motion


def _take(action: Action, found: dict[str, np.ndarray], random: np.random.Generator) -> np.ndarray:
    """A clip at a random pace, looped as configured, possibly mirrored."""
    local = found[str(random.choice(action.clips))]
    pace = random.uniform(0.85, 1.2)
    if action.loop_s:
        wanted = random.uniform(0.75, 1.25) * action.loop_s * FRAME_RATE * pace
        local = np.concatenate([local] * max(1, round(wanted / len(local))))
    local = clips.resampled(local, np.arange(0.0, len(local) - 1, pace))
    return clips.mirrored(local) if random.random() < 0.5 else local


def _write(motion: dict[str, np.ndarray], local: np.ndarray, acting: np.ndarray) -> None:
    """Writes rotations, the root's path and the gestures' phases into the performer's channels."""
    for part in ("hands", "upper", "lower"):
        joints = list(JOINTS_OF[part])
        motion[part][:, : 6 * len(joints)] = rotation_6d(local[:, joints]).reshape(len(local), -1)
    place, contact = clips.standing(local)
    motion["lower"][:, VELOCITY] = FRAME_RATE * np.diff(place, axis=0, append=place[-1:])
    motion["lower"][:, CONTACT] = contact
    motion["height"] = place[:, 1].astype(np.float32)
    wrists = places(local, place)[:, [JOINT["left_wrist"], JOINT["right_wrist"]]]
    speed = np.linalg.norm(np.gradient(wrists, axis=0), axis=-1) * FRAME_RATE
    phases = np.where((speed > _STROKE_M_S) & (acting > 0.5)[:, None], intent.STROKE, intent.REST)
    phases = np.where((phases == intent.REST) & (acting > 0.9)[:, None], intent.HOLD, phases)
    motion["intent"] = intent.codes(phases.T)
