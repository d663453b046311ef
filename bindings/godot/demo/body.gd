extends RefCounted
## A placeholder body for an avatar: bones at the model's joints, capsules around them, and a face.

const SKIN := Color(0.93, 0.72, 0.58)
const SHIRT := Color(0.22, 0.47, 0.72)
const TROUSERS := Color(0.25, 0.27, 0.34)


## Gives a skeleton the bones of the model, standing on the floor, with meshes.
static func build(skeleton: Skeleton3D, avatar: UmoAvatar3D) -> void:
	var names := avatar.get_joint_names()
	var parents := avatar.get_joint_parents()
	var offsets := avatar.get_joint_offsets()
	var places: Array[Vector3] = []
	for joint in names.size():
		var parent := parents[joint]
		places.append(offsets[joint] + (places[parent] if parent >= 0 else Vector3.ZERO))
		skeleton.add_bone(names[joint])
		skeleton.set_bone_parent(joint, parent)
		skeleton.set_bone_rest(joint, Transform3D(Basis.IDENTITY, offsets[joint]))
	var lowest := 0.0
	for place in places:
		lowest = minf(lowest, place.y)
	skeleton.set_bone_rest(0, Transform3D(Basis.IDENTITY, offsets[0] + Vector3.UP * (0.02 - lowest)))
	skeleton.reset_bone_poses()
	for joint in names.size():
		if parents[joint] >= 0 and names[joint] not in ["jaw", "left_eye", "right_eye"]:
			_limb(skeleton, parents[joint], names[parents[joint]], names[joint], offsets[joint])
	_head(skeleton)


static func _limb(skeleton: Skeleton3D, bone: int, from: String, to: String, along: Vector3) -> void:
	var radius := 0.055
	var color := SHIRT
	if from.contains("hip") or from.contains("knee") or from.contains("ankle") or to.contains("hip"):
		radius = 0.07 if from.contains("hip") or to.contains("hip") else 0.05
		color = TROUSERS
	elif from == "neck" or from.contains("elbow"):
		radius = 0.04
		color = SKIN
	elif from.contains("spine") or from == "pelvis":
		radius = 0.1
	if from.contains("wrist") or to.right(1).is_valid_int() and not to.contains("spine"):
		radius = 0.012
		color = SKIN
	var mesh := CapsuleMesh.new()
	mesh.radius = radius
	mesh.height = along.length() + 2 * radius
	var limb := MeshInstance3D.new()
	limb.mesh = mesh
	limb.material_override = _paint(color)
	var at := _attach(skeleton, skeleton.get_bone_name(bone), from + "_to_" + to)
	limb.position = along / 2
	if along.normalized().cross(Vector3.UP).length() > 1e-3:
		limb.basis = Basis(Quaternion(Vector3.UP, along.normalized()))
	at.add_child(limb)


static func _head(skeleton: Skeleton3D) -> void:
	var at := _attach(skeleton, "head", "Head")
	var ball := SphereMesh.new()
	ball.radius = 0.105
	ball.height = 0.25
	var head := MeshInstance3D.new()
	head.mesh = ball
	head.position = Vector3(0, 0.075, 0.02)
	head.material_override = _paint(SKIN)
	at.add_child(head)
	var face := MeshInstance3D.new()
	face.name = "Face"
	face.mesh = _face()
	face.position = head.position
	at.add_child(face)


static func _attach(skeleton: Skeleton3D, bone: String, called: String) -> BoneAttachment3D:
	var at := BoneAttachment3D.new()
	at.name = called
	skeleton.add_child(at)
	at.bone_name = bone
	return at


static func _paint(color: Color) -> StandardMaterial3D:
	var paint := StandardMaterial3D.new()
	paint.albedo_color = color
	paint.roughness = 0.8
	return paint


## Mouth, eyes and brows as flat shapes on the front of the head, with the most visible blend shapes.
static func _face() -> ArrayMesh:
	var mesh := ArrayMesh.new()
	mesh.blend_shape_mode = Mesh.BLEND_SHAPE_MODE_NORMALIZED
	# Effect of each shape on a point: [part, displacement].
	var shapes := {
		"jawOpen": func(part: String, p: Vector2) -> Vector2:
			return Vector2(-0.15 * p.x, -0.028 if p.y < 0 else 0.0) if part == "mouth" else Vector2.ZERO,
		"mouthFunnel": func(part: String, p: Vector2) -> Vector2:
			return Vector2(-0.45 * p.x, 0.8 * p.y) if part == "mouth" else Vector2.ZERO,
		"mouthSmileLeft": func(part: String, p: Vector2) -> Vector2:
			return Vector2(0.35, 0.6) * maxf(p.x, 0) if part == "mouth" else Vector2.ZERO,
		"mouthSmileRight": func(part: String, p: Vector2) -> Vector2:
			return Vector2(-0.35, 0.6) * maxf(-p.x, 0) if part == "mouth" else Vector2.ZERO,
		"eyeBlinkLeft": func(part: String, p: Vector2) -> Vector2:
			return Vector2(0, -0.85 * p.y) if part == "left_eye" else Vector2.ZERO,
		"eyeBlinkRight": func(part: String, p: Vector2) -> Vector2:
			return Vector2(0, -0.85 * p.y) if part == "right_eye" else Vector2.ZERO,
		"browInnerUp": func(part: String, p: Vector2) -> Vector2:
			return Vector2(0, 0.014) if part.ends_with("brow") else Vector2.ZERO,
	}
	for shape in shapes:
		mesh.add_blend_shape(shape)
	var parts := [
		["mouth", Vector2(0, -0.055), Vector2(0.034, 0.007), Color(0.45, 0.1, 0.12)],
		["left_eye", Vector2(0.038, 0.018), Vector2(0.013, 0.017), Color(0.12, 0.1, 0.1)],
		["right_eye", Vector2(-0.038, 0.018), Vector2(0.013, 0.017), Color(0.12, 0.1, 0.1)],
		["left_brow", Vector2(0.038, 0.055), Vector2(0.022, 0.004), Color(0.3, 0.2, 0.12)],
		["right_brow", Vector2(-0.038, 0.055), Vector2(0.022, 0.004), Color(0.3, 0.2, 0.12)],
	]
	for part in parts:
		var still := _disc(part[1], part[2], func(_p: Vector2) -> Vector2: return Vector2.ZERO)
		var moved: Array[Array] = []
		for shape in shapes:
			var arrays := _disc(part[1], part[2], func(p: Vector2) -> Vector2: return shapes[shape].call(part[0], p))
			moved.append(arrays.slice(0, 3))
		mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, still, moved)
		mesh.surface_set_material(mesh.get_surface_count() - 1, _paint(part[3]))
	return mesh


## An ellipse on the front of the head, each point moved by `move`.
static func _disc(center: Vector2, size: Vector2, move: Callable) -> Array:
	const POINTS := 24
	var points := PackedVector3Array()
	var normals := PackedVector3Array()
	var tangents := PackedFloat32Array()
	var indices := PackedInt32Array()
	for i in POINTS + 1:
		var p := Vector2.ZERO if i == POINTS else Vector2.from_angle(TAU * i / POINTS) * size
		var flat: Vector2 = center + p + move.call(p)
		# Just in front of the head's ellipsoid.
		var depth := sqrt(maxf(0, 1 - (flat.x / 0.105) ** 2 - (flat.y / 0.125) ** 2)) * 0.105 + 0.003
		points.append(Vector3(flat.x, flat.y, depth))
		normals.append(Vector3.BACK)
		tangents.append_array([1, 0, 0, 1])
		if i < POINTS:
			indices.append_array([POINTS, (i + 1) % POINTS, i])
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = points
	arrays[Mesh.ARRAY_NORMAL] = normals
	arrays[Mesh.ARRAY_TANGENT] = tangents
	arrays[Mesh.ARRAY_INDEX] = indices
	return arrays


## Reads a 16-bit WAV file directly: no import, and Godot before 4.4 cannot load WAV at run time.
static func wav(path: String) -> AudioStreamWAV:
	var bytes := FileAccess.get_file_as_bytes(path)
	var stream := AudioStreamWAV.new()
	var at := 12
	while at + 8 <= bytes.size():
		var size := bytes.decode_u32(at + 4)
		match bytes.slice(at, at + 4).get_string_from_ascii():
			"fmt ":
				stream.stereo = bytes.decode_u16(at + 10) == 2
				stream.mix_rate = bytes.decode_u32(at + 12)
				stream.format = AudioStreamWAV.FORMAT_16_BITS
			"data":
				stream.data = bytes.slice(at + 8, at + 8 + size)
		at += 8 + size + size % 2
	return stream
