"""A take's .npz file, posed by the `smplx` package on a stand-in for SMPL-X in the package's file layout, and compared
with the take's .glb file. No part of a licensed model is used: vertices are random, the joints are those of the .glb.

npz.py TAKE.npz TAKE.glb        PyTorch and `smplx` must be importable
"""

import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import motion
import numpy as np
import smplx
import torch
from report import Report
from smplx.joint_names import JOINT_NAMES
from smplx.vertex_ids import vertex_ids

JOINTS = 55
# Parts of `poses` in the order in which SMPLX.forward joins them, and their numbers of joints.
PARTS = {
    "global_orient": 1,
    "body_pose": 21,
    "jaw_pose": 1,
    "leye_pose": 1,
    "reye_pose": 1,
    "left_hand_pose": 15,
    "right_hand_pose": 15,
}
SHAPES, EXPRESSIONS, POSE_BASIS, LANDMARKS = 300, 100, 9 * (JOINTS - 1), 51
# Every eighth frame.
STRIDE = 8


def renamed(name: str) -> str:
    """umo's name of a joint of the package's."""
    return name.removesuffix("_smplhf")


def stand_in(folder: Path, rest: np.ndarray, parents: list[int]) -> np.ndarray:
    """Writes SMPLX_NEUTRAL.npz, whose first vertices are the joints and each other follows one; returns that joint."""
    random = np.random.default_rng(0)
    count = max(vertex_ids["smplx"].values()) + 1
    joint = np.arange(count) % JOINTS
    template = rest[joint] + random.uniform(-0.1, 0.1, (count, 3)) * (np.arange(count) >= JOINTS)[:, None]
    zeros = {"shapedirs": (count, 3, SHAPES + EXPRESSIONS), "posedirs": (count, 3, POSE_BASIS)}
    hands = {f"hands_components{side}": np.eye(45, dtype=np.float32) for side in "lr"}
    # Not zero, so that the poses are seen to be without it.
    hands |= {f"hands_mean{side}": np.full(45, 0.3, np.float32) for side in "lr"}
    np.savez(
        folder / "SMPLX_NEUTRAL.npz",
        v_template=template.astype(np.float32),
        f=np.zeros((1, 3), np.int64),
        J_regressor=np.eye(JOINTS, count, dtype=np.float32),
        kintree_table=np.array([parents, range(JOINTS)]),
        weights=np.eye(JOINTS, dtype=np.float32)[joint],
        lmk_faces_idx=np.zeros(LANDMARKS, np.int64),
        lmk_bary_coords=np.full((LANDMARKS, 3), 1 / 3, np.float32),
        **{name: np.zeros(shape, np.float32) for name, shape in zeros.items()},
        **hands,
    )
    return template - rest[joint]


def main(npz: str, glb: str) -> None:
    report = Report("SMPL-X .npz", f"smplx {version('smplx')}, torch {version('torch').split('+')[0]}")
    with np.load(npz) as arrays:
        take = {name: arrays[name] for name in arrays.files}
    file = motion.read(glb)
    names = [renamed(name) for name in JOINT_NAMES[:JOINTS]]
    present = {node.get("name") for node in file.nodes}
    report.check("joints of the package, in .glb by the same names", present.issuperset(names), len(names))
    nodes = [file.index(name) for name in names]
    parents = [nodes.index(file.parents[node]) if file.parents.get(node) in nodes else -1 for node in nodes]
    report.check("a parent before its joints", all(parent < joint for joint, parent in enumerate(parents)))
    rest = np.zeros((JOINTS, 3))
    for joint, parent in enumerate(parents):
        above = rest[parent] if parent >= 0 else 0
        rest[joint] = above + np.array(file.nodes[nodes[joint]].get("translation", (0, 0, 0)))

    frames = np.arange(0, len(take["poses"]), STRIDE)
    times = frames / float(take["mocap_frame_rate"])
    report.check("sizes of the parts", take["poses"].shape[1] == 3 * sum(PARTS.values()), take["poses"].shape[1])
    ends = 3 * np.cumsum(list(PARTS.values()))[:-1]
    parts = dict(zip(PARTS, np.split(take["poses"][frames], ends, axis=1), strict=True))
    with tempfile.TemporaryDirectory() as folder:
        offsets = stand_in(Path(folder), rest, parents)
        options = {"num_betas": SHAPES, "num_expression_coeffs": EXPRESSIONS, "use_pca": False}
        options |= {"flat_hand_mean": True, "batch_size": len(frames)}
        model = smplx.SMPLX(folder, gender=str(take["gender"]), **options)
    sizes = (take["betas"].shape[0], take["expressions"].shape[1])
    report.check("betas and expressions of the model's sizes", sizes == (model.num_betas, model.num_expression_coeffs))
    inputs = parts | {"transl": take["trans"][frames], "expression": take["expressions"][frames]}
    inputs["betas"] = np.tile(take["betas"], (len(frames), 1))
    with torch.no_grad():
        posed = model(**{name: torch.tensor(array) for name, array in inputs.items()})
    joints, vertices = posed.joints[:, :JOINTS].numpy(), posed.vertices.numpy()
    worlds = [file.world(node, times) for node in nodes]
    errors = [np.linalg.norm(joints[:, joint] - worlds[joint][1], axis=1).max() * 1000 for joint in range(JOINTS)]
    worst = int(np.argmax(errors))
    report.within(f"joints where .glb has them: {names[worst]}", errors[worst], 0.1, " mm")
    errors = []
    for joint, (rotation, position) in enumerate(worlds):
        own = np.arange(joint + JOINTS, len(offsets), JOINTS)
        expected = position[:, None] + motion.rotated(rotation[:, None], offsets[own])
        errors.append(np.linalg.norm(vertices[:, own] - expected, axis=-1).max() * 1000)
    worst = int(np.argmax(errors))
    report.within(f"vertices turn with the joints of .glb: {names[worst]}", errors[worst], 0.1, " mm")
    report.check("the body moves", float(np.ptp(joints[:, names.index("right_wrist")], axis=0).max()) > 0.02)


if __name__ == "__main__":
    main(*sys.argv[1:])
