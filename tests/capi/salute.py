"""Writes `salute.glb`: a character of a few bones with Mixamo's names, in a T-pose, and two short animations.

    python3 tests/capi/salute.py

`salute` brings the right hand to the head within 0.5 s, holds it and lowers it, 1.5 s in all; `turn` turns the head.
"""

import json
import math
import struct
from pathlib import Path

# Name, parent, position in the parent's frame in metres; the right side mirrors the left.
BODY = [
    ("Hips", None, (0.0, 0.95, 0.0)), ("Spine", "Hips", (0.0, 0.1, 0.0)), ("Spine1", "Spine", (0.0, 0.12, 0.0)),
    ("Spine2", "Spine1", (0.0, 0.12, 0.0)), ("Neck", "Spine2", (0.0, 0.18, 0.0)), ("Head", "Neck", (0.0, 0.1, 0.0)),
]
SIDE = [
    ("Shoulder", "Spine2", (0.06, 0.12, 0.0)), ("Arm", "Shoulder", (0.12, 0.0, 0.0)), ("ForeArm", "Arm", (0.27, 0.0, 0.0)),
    ("Hand", "ForeArm", (0.25, 0.0, 0.0)), ("UpLeg", "Hips", (0.09, -0.05, 0.0)), ("Leg", "UpLeg", (0.0, -0.42, 0.0)),
    ("Foot", "Leg", (0.0, -0.42, 0.0)), ("ToeBase", "Foot", (0.0, -0.06, 0.12)),
]


def turn(axis: int, degrees: float) -> list[float]:
    half = math.radians(degrees) / 2
    return [math.sin(half) if i == axis else 0.0 for i in range(3)] + [math.cos(half)]


def bones() -> list[tuple[str, str | None, tuple[float, float, float]]]:
    own = {name for name, _, _ in SIDE}
    sides = [
        (side + name, side + parent if parent in own else parent, (sign * x, y, z))
        for side, sign in (("Left", 1.0), ("Right", -1.0)) for name, parent, (x, y, z) in SIDE
    ]
    return BODY + sides


def main() -> None:
    names = [name for name, _, _ in bones()]
    nodes = [
        {"name": "mixamorig:" + name, "translation": list(place)}
        | ({"children": children} if (children := [names.index(n) for n, p, _ in bones() if p == name]) else {})
        for name, _, place in bones()
    ]
    arm = [turn(2, degrees) for degrees in (70, 10, 10, 70)]
    fore = [turn(1, degrees) for degrees in (0, 120, 120, 0)]
    head = [turn(1, degrees) for degrees in (0, 30, 0)]
    data, views, accessors = b"", [], []

    def accessor(rows: list[list[float]], kind: str) -> int:
        nonlocal data
        packed = b"".join(struct.pack(f"<{len(row)}f", *row) for row in rows)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        more = {"min": rows[0], "max": rows[-1]} if kind == "SCALAR" else {}
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(rows), "type": kind} | more)
        data += packed
        return len(accessors) - 1

    def animation(name: str, times: list[float], tracks: dict[str, list[list[float]]]) -> dict:
        start = accessor([[time] for time in times], "SCALAR")
        samplers = [{"input": start, "output": accessor(values, "VEC4")} for values in tracks.values()]
        channels = [
            {"sampler": i, "target": {"node": names.index(bone), "path": "rotation"}} for i, bone in enumerate(tracks)
        ]
        return {"name": name, "samplers": samplers, "channels": channels}

    animations = [
        animation("salute", [0.0, 0.5, 1.0, 1.5], {"RightArm": arm, "RightForeArm": fore}),
        animation("turn", [0.0, 0.5, 1.0], {"Head": head}),
    ]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes, "animations": animations,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    file = struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
    Path(__file__).with_name("salute.glb").write_bytes(file)


if __name__ == "__main__":
    main()
