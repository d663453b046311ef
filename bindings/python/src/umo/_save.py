"""Writes motions to the files that `umo animate` writes, value for value."""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

import numpy as np
import numpy.typing as npt

from ._generated import JOINT_COUNT
from ._gltf import FIGURES, glb, vrma
from ._library import suggestion
from ._names import JOINTS, SHAPES, is_arkit

if TYPE_CHECKING:
    from ._motion import Motion

Doubles = npt.NDArray[np.float64]

# As SMPL-X tools expect: shape coefficients of the neutral body, and expression coefficients per frame.
BETAS, EXPRESSIONS = 300, 100

# After the shapes, the angles of the Live Link Face app.
ANGLES = (
    *("HeadYaw", "HeadPitch", "HeadRoll", "LeftEyeYaw", "LeftEyePitch", "LeftEyeRoll"),
    *("RightEyeYaw", "RightEyePitch", "RightEyeRoll"),
)


def save(motion: Motion, path: Union[str, os.PathLike[str]], figure: Optional[str]) -> None:
    """Writes a motion in the format of the path's suffix."""
    path = Path(path)
    content = encoded(motion, path, figure)
    # Write to a temporary file and rename: a failed run leaves the existing file.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        # With the path that the caller knows.
        raise OSError(error.errno, error.strerror, str(path)) from None


def writer(path: Union[str, os.PathLike[str]]) -> Callable[[Motion, Optional[str]], bytes]:
    """The writer for the format of a path's suffix, passing on the figure if the format has one."""
    suffix = Path(path).suffix
    if suffix.lower() not in WRITERS:
        wrong = f"suffix `{suffix}` is unknown" if suffix else "it has no suffix"
        known = ", ".join(WRITERS)
        raise ValueError(f"cannot save `{path}`: {wrong}; expected one of {known}")
    return WRITERS[suffix.lower()]


def encoded(motion: Motion, path: Union[str, os.PathLike[str]], figure: Optional[str] = FIGURES[0]) -> bytes:
    """Contents of a file in the format of the path's suffix."""
    write = writer(path)
    if figure is not None and figure not in FIGURES:
        raise ValueError(f"figure {figure!r}: {suggestion(figure, FIGURES)}")
    if motion.axes != "gltf":
        raise ValueError(f"cannot save `{path}`: files use glTF's axes, this motion {motion.axes}'s; create it with axes='gltf'")
    if not len(motion):
        raise ValueError(f"cannot save `{path}`: the motion has no frames")
    if not all(np.isfinite(values).all() for values in (motion.rotations, motion.translation, motion.face)):
        raise ValueError(f"cannot save `{path}`: the motion has a value that is not a finite number")
    return write(motion, figure)


def shape_columns(names: tuple[str, ...]) -> list[int]:
    """Column of each of `SHAPES` among the face channels; raises `ValueError` for a missing one."""
    places = {name.lower(): place for place, name in enumerate(names)}
    for shape in SHAPES:
        if shape.lower() not in places:
            raise ValueError(f"csv needs the 52 ARKit blendshapes: this model's face lacks `{shape}`; save .npz or .jsonl")
    return [places[shape.lower()] for shape in SHAPES]


def npz(motion: Motion) -> bytes:
    """SMPL-X arrays, and the channels of an ARKit face."""
    frames, arkit = len(motion), is_arkit(motion.names)
    expressions = np.zeros((frames, EXPRESSIONS), np.float32)
    if not arkit:
        used = min(EXPRESSIONS, len(motion.names))
        expressions[:, :used] = motion.face[:, :used]
    whole = float(motion.rate).is_integer()
    arrays: dict[str, npt.NDArray[Any]] = {
        "betas": np.zeros(BETAS, np.float32),
        "poses": axis_angles(motion.rotations).reshape(frames, 3 * JOINT_COUNT),
        "expressions": expressions,
        "trans": np.ascontiguousarray(motion.translation),
        "model": np.array("smplx2020"),
        "gender": np.array("neutral"),
        "mocap_frame_rate": np.array(int(motion.rate), "<i8") if whole else np.array(motion.rate, "<f8"),
    }
    if arkit:
        arrays["arkit"] = np.ascontiguousarray(motion.face)
        arrays["arkit_names"] = np.array(motion.names)
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type, unused-ignore]
    return file.getvalue()


def csv(motion: Motion) -> bytes:
    """The face and the head's angles, as Live Link Face writes them."""
    places = shape_columns(motion.names)
    joints = ("neck", "head", "left_eye", "right_eye")
    neck, head, left, right = (matrices(motion.rotations[:, JOINTS.index(joint)]) for joint in joints)
    angles = np.concatenate([euler_yxz(part) for part in (product(neck, head), left, right)], 1)
    lines = [",".join(("Timecode", "BlendShapeCount", *SHAPES, *ANGLES))]
    for frame in range(len(motion)):
        values = [*motion.face[frame, places].tolist(), *angles[frame].tolist()]
        columns = (timecode(frame, motion.rate), str(len(SHAPES) + len(ANGLES)), *(f"{value:.6f}" for value in values))
        lines.append(",".join(columns))
    return ("\n".join(lines) + "\n").encode()


def timecode(frame: int, rate: float) -> str:
    """`HH:MM:SS:FF.mmm`: frames within the second, then thousandths of a frame."""
    seconds = math.floor(frame / rate + 1e-9)
    within = max(frame - seconds * rate, 0.0)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{within:06.3f}"


def jsonl(motion: Motion) -> bytes:
    """Everything, every value as computed."""
    return b"".join(line.encode() + b"\n" for line in json_lines(motion))


def json_lines(motion: Motion) -> Iterator[str]:
    if motion.skeleton is None:
        raise ValueError("jsonl needs a skeleton, which only a Motion from umo has; save .npz or .csv")
    parents, offsets = motion.skeleton
    names = {"kind": "arkit" if is_arkit(motion.names) else "smplx_expression", "names": motion.names}
    units = {
        "time": "seconds",
        "offsets": "metres, from the parent joint",
        "translation": "metres, added to the root's offset",
        "rotations": "unit quaternions x y z w, relative to the parent",
    }
    axes = {"x": "left of the body", "y": "up", "z": "forward", "handedness": "right"}
    yield (
        f'{{"format":"umo-animation","version":1,"frame_rate":{float(motion.rate)},"frames":{len(motion)},'
        f'"joints":{compact(JOINTS)},"parents":{compact(parents.tolist())},"offsets":{numbers(offsets)},'
        f'"face":{compact(names)},"units":{compact(units)},"axes":{compact(axes)}}}'
    )
    for frame in range(len(motion)):
        yield (
            f'{{"frame":{frame},"time":{frame / float(motion.rate)},"translation":{numbers(motion.translation[frame])},'
            f'"rotations":{numbers(motion.rotations[frame])},"face":{numbers(motion.face[frame])}}}'
        )


def bvh(motion: Motion) -> bytes:
    """The skeleton's motion, in centimetres and degrees; a joint's matrix is Z X Y."""
    if motion.skeleton is None:
        raise ValueError("bvh needs a skeleton, which only a Motion from umo has; save .npz or .csv")
    parents, offsets = motion.skeleton
    lines, order = ["HIERARCHY"], []

    def place(indent: str, offset: npt.NDArray[np.float32]) -> str:
        x, y, z = (offset.astype(np.float64) * 100.0).tolist()
        return f"{indent}\tOFFSET {x:.6f} {y:.6f} {z:.6f}"

    def write(joint: int, depth: int) -> None:
        order.append(joint)
        indent = "\t" * depth
        kind, position = ("JOINT", "3") if depth else ("ROOT", "6 Xposition Yposition Zposition")
        lines.extend([f"{indent}{kind} {JOINTS[joint]}", indent + "{"])
        lines.append(place(indent, offsets[joint] if depth else np.zeros(3, np.float32)))
        lines.append(f"{indent}\tCHANNELS {position} Zrotation Xrotation Yrotation")
        below = [child for child in range(joint + 1, len(parents)) if parents[child] == joint]
        for child in below:
            write(child, depth + 1)
        if not below:
            half: npt.NDArray[np.float32] = offsets[joint] * np.float32(0.5)
            is_long = np.sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]) >= 1e-3
            tip: npt.NDArray[np.float32] = half if is_long else np.array([0, 0, 0.02], np.float32)
            lines.extend([f"{indent}\tEnd Site", indent + "\t{", place(indent + "\t", tip), indent + "\t}"])
        lines.append(indent + "}")

    write(0, 0)
    lines.extend(["MOTION", f"Frames: {len(motion)}", f"Frame Time: {1.0 / float(motion.rate):.9f}"])
    root = (offsets[0] + motion.translation).astype(np.float64) * 100.0
    joints = [euler_zxy(matrices(motion.rotations[:, joint])) * (180.0 / math.pi) for joint in order]
    angles, before = np.stack(joints, 1), np.zeros((len(order), 3))
    for frame in range(len(motion)):
        before = continued(angles[frame], before)
        values = [*root[frame].tolist(), *before.ravel().tolist()]
        lines.append(" ".join(f"{value:.6f}" for value in values))
    return ("\n".join(lines) + "\n").encode()


def continued(angles: Doubles, before: Doubles) -> Doubles:
    """Among the angles [J, 3] of the same rotations, those nearest to the previous frame."""
    other = np.stack([angles[:, 0] + 180.0, 180.0 - angles[:, 1], angles[:, 2] + 180.0], 1)

    def near(candidate: Doubles) -> tuple[Doubles, Doubles]:
        turns = (before - candidate) / 360.0
        turned = candidate + 360.0 * np.trunc(turns + np.copysign(0.5, turns))
        off = np.abs(turned - before)
        return turned, off[:, 0] + off[:, 1] + off[:, 2]

    (first, way), (second, other_way) = near(angles), near(other)
    return np.where((other_way + 1e-6 < way)[:, None], second, first)


def compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def numbers(values: npt.NDArray[np.float32]) -> str:
    """A JSON list, nested like the array, of the shortest decimals that read back as the same floats."""
    if values.ndim > 1:
        return f"[{','.join(map(numbers, values))}]"
    return f"[{','.join(map(number, values))}]"


def number(value: np.float32) -> str:
    """A number as the program `umo` writes it: with an exponent below 1e-6 and from 1e13 up."""
    if value == 0 or 1e-6 <= abs(value) < 1e13:
        return np.format_float_positional(value, unique=True, trim="0")
    return np.format_float_scientific(value, unique=True, trim="-", exp_digits=1)


def normalized(rotations: npt.NDArray[np.float32]) -> tuple[Doubles, ...]:
    """Components x, y, z, w of quaternions [..., 4]. Sums have a fixed order, so that every digit equals the program
    `umo`'s.
    """
    x, y, z, w = np.moveaxis(rotations.astype(np.float64), -1, 0)
    length = np.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def arctan2(y: Doubles, x: Doubles) -> Doubles:
    """The C library's atan2: numpy's own may differ in the last digit."""
    return np.asarray(np.frompyfunc(math.atan2, 2, 1)(y, x), np.float64)


def axis_angles(rotations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Rotation vectors [..., 3]: the axis times the angle in radians, at most pi."""
    x, y, z, w = normalized(rotations)
    sine, sign = np.sqrt(x * x + y * y + z * z), np.copysign(1.0, w)
    # For small rotations the angle is twice the vector part; the quotient would be 0 / 0.
    small = sine < 1e-12
    scale = np.where(small, 2.0 * sign, 2.0 * arctan2(sine, np.abs(w)) * sign / np.where(small, 1.0, sine))
    return np.stack([x * scale, y * scale, z * scale], -1).astype(np.float32)


def matrices(rotations: npt.NDArray[np.float32]) -> Doubles:
    """Rotation matrices [T, 3, 3], for column vectors."""
    x, y, z, w = normalized(rotations)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def product(a: Doubles, b: Doubles) -> Doubles:
    """Product that applies `b` first, then `a`."""
    columns = [a[:, :, k, None] * b[:, None, k, :] for k in range(3)]
    return columns[0] + columns[1] + columns[2]  # type: ignore[no-any-return, unused-ignore]


def euler_yxz(m: Doubles) -> Doubles:
    """Angles [T, 3] in radians, with `m = Y(y) * X(x) * Z(z)`: yaw, pitch, roll."""
    cosine = np.hypot(m[:, 1, 1], m[:, 1, 0])
    pitch = arctan2(-m[:, 1, 2], cosine)
    # If the middle angle is a right angle, the other two rotate about the same axis (gimbal lock).
    locked = cosine < 1e-9
    yaw = np.where(locked, arctan2(-m[:, 2, 0], m[:, 0, 0]), arctan2(m[:, 0, 2], m[:, 2, 2]))
    roll = np.where(locked, 0.0, arctan2(m[:, 1, 0], m[:, 1, 1]))
    return np.stack([yaw, pitch, roll], 1)


def euler_zxy(m: Doubles) -> Doubles:
    """Angles [T, 3] in radians, with `m = Z(z) * X(x) * Y(y)`."""
    cosine = np.hypot(m[:, 2, 2], m[:, 2, 0])
    x = arctan2(m[:, 2, 1], cosine)
    locked = cosine < 1e-9
    z = np.where(locked, arctan2(m[:, 1, 0], m[:, 0, 0]), arctan2(-m[:, 0, 1], m[:, 1, 1]))
    y = np.where(locked, 0.0, arctan2(-m[:, 2, 0], m[:, 2, 2]))
    return np.stack([z, x, y], 1)


def _bare(write: Callable[[Motion], bytes]) -> Callable[[Motion, Optional[str]], bytes]:
    """Wraps the writer of a format without a figure."""
    return lambda motion, _: write(motion)


WRITERS: dict[str, Callable[[Motion, Optional[str]], bytes]] = {
    ".npz": _bare(npz),
    ".bvh": _bare(bvh),
    ".glb": glb,
    ".vrma": _bare(vrma),
    ".csv": _bare(csv),
    ".jsonl": _bare(jsonl),
}
