"""Names of joints, visemes and the ARKit face."""

from __future__ import annotations

from ._generated import JOINT_COUNT, VISEME_COUNT
from ._library import lib

JOINTS: tuple[str, ...] = tuple(lib.umo_joint_name(i).decode() for i in range(JOINT_COUNT))
VISEMES: tuple[str, ...] = tuple(lib.umo_viseme_name(i).decode() for i in range(VISEME_COUNT))

# The columns of the Live Link Face app, in its order and spelling.
SHAPES = (
    *("EyeBlinkLeft", "EyeLookDownLeft", "EyeLookInLeft", "EyeLookOutLeft", "EyeLookUpLeft", "EyeSquintLeft"),
    *("EyeWideLeft", "EyeBlinkRight", "EyeLookDownRight", "EyeLookInRight", "EyeLookOutRight", "EyeLookUpRight"),
    *("EyeSquintRight", "EyeWideRight", "JawForward", "JawRight", "JawLeft", "JawOpen", "MouthClose", "MouthFunnel"),
    *("MouthPucker", "MouthRight", "MouthLeft", "MouthSmileLeft", "MouthSmileRight", "MouthFrownLeft"),
    *("MouthFrownRight", "MouthDimpleLeft", "MouthDimpleRight", "MouthStretchLeft", "MouthStretchRight"),
    *("MouthRollLower", "MouthRollUpper", "MouthShrugLower", "MouthShrugUpper", "MouthPressLeft", "MouthPressRight"),
    *("MouthLowerDownLeft", "MouthLowerDownRight", "MouthUpperUpLeft", "MouthUpperUpRight", "BrowDownLeft"),
    *("BrowDownRight", "BrowInnerUp", "BrowOuterUpLeft", "BrowOuterUpRight", "CheekPuff", "CheekSquintLeft"),
    *("CheekSquintRight", "NoseSneerLeft", "NoseSneerRight", "TongueOut"),
)


def is_arkit(names: tuple[str, ...]) -> bool:
    return {name.lower() for name in names} == {shape.lower() for shape in SHAPES}
