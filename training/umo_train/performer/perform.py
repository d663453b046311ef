"""The procedural performer: from speech with its phones to motion of face, hands, upper and lower body."""

import numpy as np

from umo_train.performer import (
    arms,
    bearing,
    clearance,
    expression,
    eyes,
    feelings,
    fingers,
    gestures,
    intent,
    legs,
    listening,
    mouth,
    posture,
)
from umo_train.performer.prosody import listen
from umo_train.performer.rotation import about, euler
from umo_train.performer.style import Style
from umo_train.skeleton import CHANNELS, CONTACT, JOINT, JOINTS_OF, SHAPE, VELOCITY, rotation_6d
from umo_train.speech.utterance import FRAME_RATE, Utterance

# Jaw rotation at jawOpen = 1, in radians.
JAW_OPEN = 0.35


def perform(utterance: Utterance, style: Style, seed: int, accents: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Channels of each part `[T, C]`, the pelvis' height `[T]` under "height", and the arms' intent as codes of
    `intent` `[T]` under "intent"; deterministic. `accents` in seconds replace the phones'."""
    heard = listen(utterance, accents)
    if style.listens:
        utterance = listening.unspoken(utterance)
    prosody = listen(utterance) if style.listens else heard
    # Separate random streams, so that a change to one part leaves the others unchanged.
    choices = np.random.default_rng(seed).spawn(9)
    answers = listening.answers(heard, choices[8]) if style.listens else []
    feeling, felt = None, np.ones(utterance.frames)
    if style.feeling:
        feeling, felt = feelings.FEELINGS[style.feeling], feelings.strength(prosody, choices[8])
    turned = bearing.bear(prosody, style, choices[6])
    stance = legs.stance(prosody, style, turned.trunk, choices[0])
    gestured = gestures.gesticulate(prosody, style, choices[2])
    nods = listening.nods(answers, prosody.t, choices[8])
    trunk = posture.stand(prosody, style, stance.hips, turned, gestured, nods, felt, choices[1])

    shapes = mouth.speak(utterance, prosody, style)
    expression.feel(shapes, prosody, style, choices[3])
    if feeling:
        feelings.show(shapes, feeling, felt)
    listening.attend(shapes, answers, prosody.t)
    expression.unsettle(shapes, prosody, choices[7])
    eyes.look(shapes, prosody, style, trunk.gaze, choices[4])
    eyes.blink(shapes, prosody, choices[5])
    shapes = np.clip(shapes, 0.0, 1.0)

    local = legs.solve(stance)
    local |= _trunk(trunk)
    states = _cleared(gestured.states, trunk, local)
    local |= _arms(states, trunk, local)
    joints = {part: np.stack([local[_NAMES[j]] for j in JOINTS_OF[part]], 1) for part in ("upper", "lower")}
    joints["hands"] = np.concatenate(list(fingers.pose(states[..., arms.FINGERS])), axis=1)
    joints["face"] = about("x", JAW_OPEN * shapes[:, None, SHAPE["jawOpen"]])
    motion = {part: np.zeros((utterance.frames, width), np.float32) for part, width in CHANNELS.items()}
    for part, matrices in joints.items():
        width = 6 * len(JOINTS_OF[part])
        motion[part][:, :width] = rotation_6d(matrices).reshape(utterance.frames, width)
    motion["face"][:, 6:] = shapes
    # Frame i + 1 is at frame i plus its velocity.
    motion["lower"][:, VELOCITY] = FRAME_RATE * np.diff(stance.place, axis=0, append=stance.place[-1:])
    motion["lower"][:, CONTACT] = np.repeat(stance.contact, 2, axis=0).T
    motion["height"] = stance.place[:, 1].astype(np.float32)
    motion["intent"] = intent.codes(gestured.phases)
    return motion


_NAMES = {index: name for name, index in JOINT.items()}


def _trunk(trunk: posture.Posture) -> dict[str, np.ndarray]:
    out = {f"spine{k + 1}": euler(angles) for k, angles in enumerate(trunk.spine)}
    out["neck"], out["head"] = euler(trunk.neck), euler(trunk.head)
    for side, name, collar in ((1.0, "left", trunk.collars[0]), (-1.0, "right", trunk.collars[1])):
        out[name + "_collar"] = about("y", -side * collar[:, 1]) @ about("z", side * collar[:, 0])
    return out


def _heading(trunk: posture.Posture) -> np.ndarray:
    return trunk.pelvis[:, 1] + sum(angles[:, 1] for angles in trunk.spine)


def _cleared(states: np.ndarray, trunk: posture.Posture, local: dict[str, np.ndarray]) -> np.ndarray:
    """The arms' states without hands in each other or in the body."""
    turned = np.tile(np.eye(3), (states.shape[1], len(JOINT), 1, 1))
    for name, matrices in local.items():
        turned[:, JOINT[name]] = matrices
    turned[:, JOINTS_OF["hands"]] = np.concatenate(list(fingers.pose(states[..., arms.FINGERS])), axis=1)

    def solve(states: np.ndarray) -> np.ndarray:
        for name, matrices in _arms(states, trunk, local).items():
            turned[:, JOINT[name]] = matrices
        return turned

    return clearance.clear(states, _heading(trunk), solve)


def _arms(states: np.ndarray, trunk: posture.Posture, local: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    chest = local["pelvis"] @ local["spine1"] @ local["spine2"] @ local["spine3"]
    collars = np.stack([local["left_collar"], local["right_collar"]])
    solved = arms.solve(states, chest, collars, _heading(trunk))
    out = {}
    for name, part in zip(("shoulder", "elbow", "wrist"), solved, strict=True):
        out["left_" + name], out["right_" + name] = part
    return out
