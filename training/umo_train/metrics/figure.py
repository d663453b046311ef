"""A simple figure drawn from motion: a body of capsules by forward kinematics, and a face from ARKit's coefficients."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, PathPatch, Polygon
from matplotlib.path import Path as Outline
from scipy.spatial.transform import Rotation

from umo_train.skeleton import JOINT, PARENTS, SHAPE

INK, SKIN, LEFT, RIGHT, LEGS = "#2d3742", "#e9c9ae", "#d9593d", "#2b7a9e", "#5d6b7a"
# Half-width in metres of the capsule that ends at a joint.
_WIDTH = {
    "head": 0.05, "knee": 0.078, "ankle": 0.056, "foot": 0.042, "elbow": 0.048, "wrist": 0.038,
}  # fmt: skip
_FINGER, _PALM = 0.0125, 0.021
# Radius of the edges between shoulders and hips.
_TRUNK = 0.055


def _capsules() -> list[tuple[int, int, float, str]]:
    """Start joint, end joint, half-width and colour of each bone."""
    out = []
    for name, joint in JOINT.items():
        side, _, bone = name.rpartition("_")
        finger = joint >= JOINT["left_index1"]
        if not finger and bone not in _WIDTH:
            continue
        colour = {"left": LEFT, "right": RIGHT}.get(side, SKIN)
        if bone in ("knee", "ankle", "foot"):
            colour = LEGS
        width = (_PALM if name.endswith("1") else _FINGER) if finger else _WIDTH[bone]
        out.append((PARENTS[joint], joint, width, colour))
    return out


CAPSULES = _capsules()


def _blend(colour: str, other: str, share: float) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return tuple((1 - share) * np.array(to_rgb(colour)) + share * np.array(to_rgb(other)))


def draw_body(
    axes: Axes, places: np.ndarray, facing: np.ndarray, x: float, turn: float, points_per_metre: float
) -> None:
    """Draws joints' `places` `[55, 3]` around `x` of axes in metres, seen from the front and rotated by `turn` radians
    to its left.

    `facing` is the head's world matrix.
    """
    view = Rotation.from_euler("y", turn).as_matrix()
    at = (places - [places[0, 0], 0, places[0, 2]]) @ view.T
    # The viewer is in front, so the left hand is on the right of the picture.
    spots, depth = at[:, :2] + [x, 0], at[:, 2]
    axes.add_patch(Ellipse((x, -0.01), 0.62, 0.07, color="#e7eaee", zorder=0, lw=0))
    _draw_trunk(axes, spots, depth, points_per_metre)
    for start, end, width, colour in CAPSULES:
        near = (depth[start] + depth[end]) / 2
        # Farther parts are paler, as in haze.
        haze = 0.0 if colour == LEGS else float(np.clip(0.12 - 0.6 * near, 0, 0.4))
        shade = _blend(colour, "#ffffff", haze)
        ends = spots[[start, end]].T
        line = 2 * width * points_per_metre
        rim = 1.2 if width > _PALM else 0.5
        axes.plot(*ends, color="white", lw=line + rim, solid_capstyle="round", zorder=10 + near - 1e-4)
        axes.plot(*ends, color=shade, lw=line, solid_capstyle="round", zorder=10 + near)
    _draw_head(axes, at[JOINT["head"]], view @ facing, x)


def _draw_trunk(axes: Axes, spots: np.ndarray, depth: np.ndarray, points_per_metre: float) -> None:
    """Chest and hips as two rounded shapes that meet at a narrower waist."""

    def of(name: str) -> np.ndarray:
        return spots[JOINT[name]]

    waist = [
        0.68 * of("spine1") + 0.32 * (0.3 * of(f"{side}_shoulder") + 0.7 * of(f"{side}_hip"))
        for side in ("right", "left")
    ]
    waist = [of("spine1") + 1.3 * (point - of("spine1")) for point in waist]
    chest = [of("left_shoulder"), of("neck"), of("right_shoulder"), *waist]
    hips = [waist[1], waist[0], of("right_hip"), of("left_hip")]
    near = 10 + depth[[JOINT["left_shoulder"], JOINT["right_shoulder"], JOINT["spine2"]]].mean()
    line = 2 * _TRUNK * points_per_metre
    # Hips overlap the thighs without an edge, like trousers.
    over = 10 + depth[[JOINT["left_hip"], JOINT["right_hip"], JOINT["left_knee"], JOINT["right_knee"]]].max() + 0.02
    for corners, colour, order, rim in ((hips, LEGS, over, 0.0), (chest, INK, max(near, over + 0.01), 1.6)):
        shape = {"facecolor": colour, "joinstyle": "round"}
        if rim:
            axes.add_patch(Polygon(corners, edgecolor="white", lw=line + rim, zorder=order - 1e-3, **shape))
        axes.add_patch(Polygon(corners, edgecolor=colour, lw=line, zorder=order, **shape))


def _draw_head(axes: Axes, at: np.ndarray, facing: np.ndarray, x: float) -> None:
    middle = at + facing @ [0, 0.085, 0.02]
    tilt = np.degrees(np.arctan2(-(facing @ [0, 1, 0])[0], (facing @ [0, 1, 0])[1]))
    near = 10 + middle[2] + 0.1
    # A head is deeper than wide: it is broader from the side.
    broad = 0.155 + 0.05 * abs((facing @ [0, 0, 1])[0])
    outline = {"angle": tilt, "edgecolor": "white", "lw": 0.8}
    axes.add_patch(Ellipse((middle[0] + x, middle[1]), broad, 0.235, facecolor=SKIN, zorder=near, **outline))
    for spot, size, colour in (
        ((0.033, 0.02, 0.085), 0.016, INK),
        ((-0.033, 0.02, 0.085), 0.016, INK),
        ((0, -0.015, 0.115), 0.022, "#d8ab8a"),
    ):
        place = middle + facing @ spot
        if place[2] > middle[2] - 0.01:
            axes.add_patch(Ellipse((place[0] + x, place[1]), size, size, color=colour, zorder=near + 0.01, lw=0))


def _curve(points: np.ndarray) -> np.ndarray:
    """A smooth curve through a few points (Catmull-Rom)."""
    padded = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    t = np.linspace(0, 1, 9)[:-1, None]
    a, b, c, d = (padded[i : len(padded) - 3 + i, None] for i in range(4))
    out = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
    return np.concatenate([out.reshape(-1, 2), points[-1:]])


def draw_face(axes: Axes, coefficients: np.ndarray, x: float, size: float = 1.0) -> None:
    """Draws 52 coefficients as a face around `x` of axes, 2 units high at `size` 1. Its left is on the right."""

    def of(name: str) -> float:
        return float(coefficients[SHAPE[name]])

    jaw = of("jawOpen")

    def put(points: np.ndarray) -> np.ndarray:
        return np.asarray(points) * size + [x, 0]

    def line(points: list[tuple[float, float]], width: float, colour: str = INK, order: float = 3) -> None:
        axes.plot(*put(_curve(np.array(points))).T, color=colour, lw=width * size, solid_capstyle="round", zorder=order)

    chin = -0.92 - 0.22 * jaw
    angle = np.linspace(0, 2 * np.pi, 80)
    oval = np.stack([0.72 * np.sin(angle), np.where(np.cos(angle) > 0, 1.0, -chin) * np.cos(angle)], 1)
    axes.add_patch(Polygon(put(oval), facecolor=SKIN, edgecolor="#c9a184", lw=1, zorder=1))
    for side, sign in (("Left", 1), ("Right", -1)):
        _draw_eye(axes, of, put, side, sign)
        inner = 0.16 * of("browInnerUp") - 0.12 * of(f"browDown{side}")
        outer = 0.16 * of(f"browOuterUp{side}") - 0.06 * of(f"browDown{side}")
        brow = [(0.13, 0.43 + inner), (0.3, 0.5 + (inner + outer) / 2), (0.5, 0.42 + outer)]
        line([(sign * a, b) for a, b in brow], 3.0)
    sneer = 0.03 * (of("noseSneerLeft") + of("noseSneerRight"))
    line([(-0.09, -0.1 + sneer), (0, -0.15 + sneer), (0.09, -0.1 + sneer)], 1.4, "#b98a6c")
    _draw_mouth(axes, of, put)


def _draw_eye(axes: Axes, of, put, side: str, sign: int) -> None:
    """White, iris and lids; the lids close with the blink."""
    blink, wide, squint = of(f"eyeBlink{side}"), of(f"eyeWide{side}"), of(f"eyeSquint{side}")
    opened = max(0.0, 0.13 * (1 - blink) * (1 - 0.35 * squint) + 0.04 * wide)
    t = np.linspace(-1, 1, 15)
    across = 0.3 * sign + 0.15 * t
    top, under = 0.2 + opened * (1 - t**2) - 0.04 * blink, 0.2 - (0.5 * opened) * (1 - t**2) - 0.04 * blink
    ring = put(np.concatenate([np.stack([across, top], 1), np.stack([across, under], 1)[::-1]]))
    white = Polygon(ring, facecolor="white", edgecolor="none", zorder=2)
    axes.add_patch(white)
    # Outward is towards the body's own side; inward to the nose.
    aside = 0.07 * sign * (of(f"eyeLookOut{side}") - of(f"eyeLookIn{side}"))
    up = 0.06 * (of(f"eyeLookUp{side}") - of(f"eyeLookDown{side}"))
    scale = put([[1, 0]])[0, 0] - put([[0, 0]])[0, 0]
    for radius, colour in ((0.08, "#4a6a85"), (0.038, "#17202a")):
        iris = Ellipse(
            put([[0.3 * sign + aside, 0.215 + up]])[0],
            2 * radius * scale,
            2 * radius * scale,
            color=colour,
            zorder=2.2,
            lw=0,
        )
        axes.add_patch(iris)
        iris.set_clip_path(white)
    axes.plot(*put(np.stack([across, top], 1)).T, color=INK, lw=1.6 * scale, zorder=2.4, solid_capstyle="round")


def _draw_mouth(axes: Axes, of, put) -> None:
    """Two lips around a dark gap, opened by jaw, closing and lip raising."""

    def both(name: str) -> float:
        return (of(f"{name}Left") + of(f"{name}Right")) / 2

    jaw, pucker, funnel = of("jawOpen"), of("mouthPucker"), of("mouthFunnel")
    gap = max(0.0, jaw - of("mouthClose"))
    upper = 0.10 * both("mouthUpperUp") + 0.04 * funnel - 0.04 * both("mouthPress")
    lower = 0.42 * gap + 0.12 * both("mouthLowerDown") + 0.06 * funnel
    half = (
        0.27 * (1 - 0.42 * pucker - 0.28 * funnel - 0.12 * gap)
        + 0.07 * both("mouthStretch")
        + 0.06 * both("mouthSmile")
    )
    middle = np.array(
        [0.06 * (of("mouthLeft") - of("mouthRight")), -0.45 - 0.16 * jaw * min(1.0, of("mouthClose") / max(jaw, 1e-3))]
    )
    t = np.linspace(-1, 1, 25)
    corner = {side: 0.11 * of(f"mouthSmile{side}") - 0.11 * of(f"mouthFrown{side}") for side in ("Left", "Right")}
    lift = np.where(t > 0, corner["Left"], corner["Right"]) * np.abs(t) ** 1.5 - 0.16 * jaw * 0.3 * np.abs(t) ** 2
    arch = np.sqrt(np.clip(1 - t**2, 0, 1))
    thick_upper = 0.075 * (1 - 0.8 * of("mouthRollUpper")) * (1 - 0.4 * both("mouthPress")) + 0.03 * (pucker + funnel)
    thick_lower = 0.085 * (1 - 0.8 * of("mouthRollLower")) * (1 - 0.4 * both("mouthPress")) + 0.03 * (pucker + funnel)
    bow = 1 - 0.22 * np.exp(-((t / 0.13) ** 2))
    rows = {
        "top": lift + arch * upper + thick_upper * arch * bow,
        "inner_top": lift + arch * max(upper, 0),
        "inner_under": lift - arch * lower,
        "under": lift - arch * lower - thick_lower * arch,
    }
    lines = {name: put(np.stack([half * t, row], 1) + middle) for name, row in rows.items()}

    def between(first: str, second: str, colour: str, order: float) -> Polygon:
        patch = Polygon(
            np.concatenate([lines[first], lines[second][::-1]]), facecolor=colour, edgecolor="none", zorder=order
        )
        axes.add_patch(patch)
        return patch

    hole = between("inner_top", "inner_under", "#4a1520", 3)
    opened = max(upper, 0) + lower
    if opened > 0.06:
        # The upper teeth hang into the gap, the tongue lies in it.
        teeth = put(np.stack([half * 0.8 * t, lift + arch * max(upper, 0) - 0.055 * arch], 1) + middle)
        patch = Polygon(
            np.concatenate([lines["inner_top"], teeth[::-1]]), facecolor="#f6f2ea", edgecolor="none", zorder=3.1
        )
        axes.add_patch(patch)
        patch.set_clip_path(hole)
        tongue = np.stack([half * 0.62 * t, lift - lower + 0.35 * opened * arch * (1 - 0.5 * gap)], 1) + middle
        patch = PathPatch(
            Outline(np.concatenate([put(tongue), lines["inner_under"][::-1]])), facecolor="#b5525c", lw=0, zorder=3.05
        )
        axes.add_patch(patch)
        patch.set_clip_path(hole)
    between("top", "inner_top", "#b8605c", 3.3)
    between("inner_under", "under", "#c46f69", 3.3)
    if opened < 0.02:
        axes.plot(*lines["inner_top"].T, color="#7d3638", lw=1.1, zorder=3.4)
