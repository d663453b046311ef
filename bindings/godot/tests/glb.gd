extends SceneTree
## Tests how Godot imports an animation from `umo animate`: godot --headless -s glb.gd -- ANIMATION.jsonl, with the same
## animation imported as res://speech.glb. The exit status is the number of failures.

## The motion's 55 joints, and the figure's 18 bones that follow them.
const BONES := 73

var failures := 0


func _initialize() -> void:
	var lines := FileAccess.get_file_as_string(OS.get_cmdline_user_args()[0]).strip_edges().split("\n")
	var header: Dictionary = JSON.parse_string(lines[0])
	var scene: Node = (load("res://speech.glb") as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	check_meshes(scene, header)
	await check_animation(scene, header, lines)
	print("a glb imports with skin, shapes and animation ... ", "ok" if failures == 0 else "FAILED")
	quit(mini(failures, 100))


func expect(holds: bool, what: String) -> void:
	if not holds:
		failures += 1
		printerr("    expected: ", what)


func only(scene: Node, kind: String) -> Node:
	var found := scene.find_children("*", kind, true, false)
	expect(found.size() == 1, "one %s, not %d" % [kind, found.size()])
	return found[0]


func check_meshes(scene: Node, header: Dictionary) -> void:
	var skeleton: Skeleton3D = only(scene, "Skeleton3D")
	expect(skeleton.get_bone_count() == BONES, "%d bones, not %d" % [BONES, skeleton.get_bone_count()])
	for joint in header.joints:
		expect(skeleton.find_bone(joint) >= 0, "a bone %s" % joint)
	var meshes := scene.find_children("*", "MeshInstance3D", true, false)
	expect(meshes.size() == 2, "body and face, not %d meshes" % meshes.size())
	for instance: MeshInstance3D in meshes:
		expect(instance.skin != null and instance.skin.get_bind_count() == BONES, "%s is skinned" % instance.name)
		expect(instance.get_node_or_null(instance.skeleton) == skeleton, "%s is on the skeleton" % instance.name)
		var arrays := instance.mesh.surface_get_arrays(0)
		expect(arrays[Mesh.ARRAY_TEX_UV] != null, "%s has texture coordinates" % instance.name)
		expect(arrays[Mesh.ARRAY_COLOR] == null, "%s has no colours in its vertices, which renderers show differently" % instance.name)
		var material: BaseMaterial3D = instance.mesh.surface_get_material(0)
		expect(material.albedo_texture != null, "%s has a texture" % instance.name)
		expect(arrays[Mesh.ARRAY_VERTEX].size() > 4000, "%s has vertices" % instance.name)
		if instance.name == "face":
			var shapes: Array = range(instance.get_blend_shape_count()).map(
				func(i: int) -> String: return instance.mesh.get_blend_shape_name(i))
			expect(shapes == header.face.names, "a blend shape for each channel, not %s" % [shapes])
			check_jaw(instance, arrays[Mesh.ARRAY_VERTEX])


## The jawOpen shape, stored sparse, moves some vertices down and leaves most unchanged.
func check_jaw(face: MeshInstance3D, rest: PackedVector3Array) -> void:
	var jaw := face.find_blend_shape_by_name("jawOpen")
	var moved: PackedVector3Array = face.mesh.surface_get_blend_shape_arrays(0)[jaw][Mesh.ARRAY_VERTEX]
	var down := 0
	var still := 0
	for i in rest.size():
		var by := moved[i] - rest[i]
		down += 1 if by.y < -0.01 else 0
		still += 1 if by.length() < 1e-5 else 0
	expect(down > 200, "the jaw goes down, not %d vertices" % down)
	expect(still > rest.size() / 3, "most of the head stays, not %d vertices" % still)


func check_animation(scene: Node, header: Dictionary, lines: PackedStringArray) -> void:
	var player: AnimationPlayer = only(scene, "AnimationPlayer")
	expect(player.has_animation("speech"), "an animation speech among %s" % [player.get_animation_list()])
	var length := player.get_animation("speech").length
	expect(absf(length - (header.frames - 1) / header.frame_rate) < 0.04, "all frames, not %f s" % length)
	var skeleton: Skeleton3D = only(scene, "Skeleton3D")
	var face: MeshInstance3D = scene.find_children("face", "MeshInstance3D", true, false)[0]
	player.play("speech")
	player.pause()
	for number in [0, lines.size() / 3, lines.size() - 2]:
		var frame: Dictionary = JSON.parse_string(lines[number + 1])
		player.seek(number / header.frame_rate, true)
		await process_frame
		for joint in 55:
			var wanted: Array = frame.rotations[joint]
			var bone := skeleton.get_bone_pose_rotation(skeleton.find_bone(header.joints[joint]))
			var angle := bone.angle_to(Quaternion(wanted[0], wanted[1], wanted[2], wanted[3]).normalized())
			expect(angle < 0.02, "%s of frame %d is turned right, not %f off" % [header.joints[joint], number, angle])
		for channel in frame.face.size():
			var value := face.get_blend_shape_value(face.find_blend_shape_by_name(header.face.names[channel]))
			expect(absf(value - frame.face[channel]) < 0.02, "%s of frame %d" % [header.face.names[channel], number])
