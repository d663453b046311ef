"""Imports glTF files into Blender (PyPI's bpy) and compares bones, keys and shapes with what `motion.py` reads in them.

blender.py FILE.glb…
"""

import sys
from contextlib import redirect_stdout
from pathlib import Path

import bpy
import motion
import numpy as np
from report import Report

FRAMES = (0, 30, 77, 150, 228)


def imported(path: str) -> tuple[bpy.types.Object, list[bpy.types.Object]]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 30
    with redirect_stdout(sys.stderr):
        bpy.ops.import_scene.gltf(filepath=path)
    objects = list(bpy.context.scene.objects)
    return next(o for o in objects if o.type == "ARMATURE"), [o for o in objects if o.type == "MESH"]


def judge(path: str) -> None:
    report = Report(f"glTF 2.0: {Path(path).name}", f"Blender {bpy.app.version_string}")
    file = motion.read(path)
    armature, meshes = imported(path)
    bones = {bone.name for bone in armature.data.bones}
    animated = {file.nodes[node]["name"] for node, track in file.tracks if track == "rotation"}
    report.check("a bone of each animated node", bones >= animated, f"{len(bones)} bones, {len(animated)} animated")
    action = armature.animation_data.action
    keys = {len(curve.keyframe_points) for curve in action.fcurves}
    frames = len(next(iter(file.tracks.values()))[0])
    report.check("keys of each curve", keys == {frames}, f"{len(action.fcurves)} curves of {frames} keys")
    shapes = [mesh.data.shape_keys for mesh in meshes if mesh.data.shape_keys]
    count = max((len(keys.key_blocks) - 1 for keys in shapes), default=0)
    report.check("shape keys", count >= 52, count)
    report.check("shape keys move", any(keys.animation_data and keys.animation_data.action for keys in shapes))
    errors = []
    for frame in (frame for frame in FRAMES if frame < frames):
        bpy.context.scene.frame_set(frame)
        bpy.context.view_layer.update()
        for name in animated:
            x, y, z = (armature.matrix_world @ armature.pose.bones[name].matrix).translation
            expected = file.world(file.index(name), np.array([frame / 30]))[1][0]
            # Blender's axes: Z up, and glTF's Z forward is its -Y.
            errors.append(float(np.linalg.norm(np.array([x, z, -y]) - expected)))
    report.within("bones in the world", max(errors) * 1000, 1, " mm")


for argument in sys.argv[1:]:
    judge(argument)
