extends SceneTree
## Tests of the extension in a running Godot: godot --headless -s check.gd -- REFERENCE TAKE. The exit status is the
## number of failures.

const Body := preload("res://body.gd")
const MODEL := "res://addons/umo/umo-people.safetensors"
## Tolerance: bones are computed in f32 with a few more products than frames.
const CLOSE := 1e-4
const LAYERS := ["layer_gaze", "layer_idle", "layer_asymmetry", "layer_nods", "layer_mood", "layer_feet", "layer_body"]
## Timeout in seconds, for a busy machine.
const PATIENCE := 60.0

var failures := 0
var reference: PackedFloat32Array
var width: int
## Failures reported by signal.
var told: Array[String] = []


func _initialize() -> void:
	reference = FileAccess.get_file_as_bytes(OS.get_cmdline_user_args()[0]).to_float32_array()
	await process_frame
	for test in get_method_list().map(func(method: Dictionary) -> String: return method.name):
		if test.begins_with("test_"):
			var before := failures
			await call(test)
			print("%s ... %s" % [test.trim_prefix("test_"), "ok" if failures == before else "FAILED"])
			for node in root.get_children():
				node.queue_free()
			await process_frame
	print("%d failures" % failures)
	quit(mini(failures, 100))


func expect(holds: bool, what: String) -> void:
	if not holds:
		failures += 1
		printerr("    expected: ", what)


func make(properties := {}) -> UmoAvatar3D:
	var avatar := UmoAvatar3D.new()
	avatar.model = MODEL
	# Layers follow the clock while there are no frames: off where poses are compared.
	for layer in LAYERS:
		avatar.set(layer, 0.0)
	for property in properties:
		avatar.set(property, properties[property])
	avatar.failed.connect(func(message: String) -> void: told.append(message))
	told.clear()
	root.add_child(avatar)
	width = avatar.get_frame_floats()
	return avatar


func hello() -> PackedFloat32Array:
	var samples := PackedFloat32Array()
	var data := Body.wav("res://hello.wav").data
	for at in range(0, data.size(), 2):
		samples.append(data.decode_s16(at) / 32768.0)
	return samples


func player(stream: AudioStream, named := "Voice") -> AudioStreamPlayer:
	var voice := AudioStreamPlayer.new()
	voice.name = named
	voice.stream = stream
	root.add_child(voice)
	return voice


func wait(seconds: float) -> void:
	await create_timer(seconds).timeout


## Lets Godot run until the condition holds or time is up; returns whether it holds.
func until(holds: Callable) -> bool:
	var started := Time.get_ticks_msec()
	while not holds.call():
		if Time.get_ticks_msec() - started > PATIENCE * 1000:
			return false
		await wait(0.005)
	return true


## All frames of hello.wav, pushed in odd pieces.
func speak(avatar: UmoAvatar3D) -> PackedFloat32Array:
	var samples := hello()
	var frames := [PackedFloat32Array()]
	var at := [0]
	await until(func() -> bool:
		if at[0] < samples.size():
			at[0] += avatar.push_audio(samples.slice(at[0], at[0] + 1237))
			if at[0] == samples.size():
				avatar.finish()
		frames[0].append_array(avatar.pull_frames())
		return frames[0].size() >= reference.size())
	return frames[0]


func quaternion(frame: PackedFloat32Array, joint: int) -> Quaternion:
	var at := 3 + 4 * joint
	return Quaternion(frame[at], frame[at + 1], frame[at + 2], frame[at + 3])


## The reference frame at a time, interpolated as a renderer sees it.
func at_time(seconds: float) -> PackedFloat32Array:
	var last := reference.size() / width - 1
	var first := clampi(floori(seconds * 30), 0, last)
	var a := reference.slice(first * width, (first + 1) * width)
	var b := reference.slice(mini(first + 1, last) * width, (mini(first + 1, last) + 1) * width)
	var share := clampf(seconds * 30 - first, 0, 1)
	for i in width:
		if i < 3 or i >= 3 + 4 * 55:
			a[i] = lerpf(a[i], b[i], share)
	for joint in 55:
		var q := quaternion(a, joint).slerp(quaternion(b, joint), share)
		var at := 3 + 4 * joint
		a[at] = q.x
		a[at + 1] = q.y
		a[at + 2] = q.z
		a[at + 3] = q.w
	return a


## Forward kinematics: transforms of all joints relative to the floor's origin.
func places(avatar: UmoAvatar3D, frame: PackedFloat32Array) -> Array[Transform3D]:
	var joints: Array[Transform3D] = []
	for joint in 55:
		var parent := avatar.get_joint_parents()[joint]
		var local := Transform3D(Basis(quaternion(frame, joint)), avatar.get_joint_offsets()[joint])
		if parent < 0:
			local.origin += Vector3(frame[0], frame[1], frame[2])
		joints.append(local if parent < 0 else joints[parent] * local)
	return joints


func test_frames_have_the_bits_of_the_c_library() -> void:
	var frames: PackedFloat32Array = await speak(make())
	expect(frames.to_byte_array() == reference.to_byte_array(), "%d floats, bit by bit; got %d" % [reference.size(), frames.size()])


func test_a_reset_avatar_gives_the_same_bits_again() -> void:
	var avatar := make()
	await speak(avatar)
	avatar.reset()
	var frames: PackedFloat32Array = await speak(avatar)
	expect(frames.to_byte_array() == reference.to_byte_array(), "the reference's bits after a reset")


func test_bones_and_blend_shapes_follow_the_player() -> void:
	var skeleton := Skeleton3D.new()
	skeleton.name = "Body"
	root.add_child(skeleton)
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"skeleton": ^"/root/Body", "audio_player": ^"/root/Voice", "meshes": [^"/root/Body/Head/Face"] as Array[NodePath]})
	Body.build(skeleton, avatar)
	var face: MeshInstance3D = skeleton.get_node("Head/Face")
	var jaw: int = 3 + 4 * 55 + avatar.get_channel_names().find("jawOpen")
	voice.play()
	var times: Array[float] = []
	var moved := 0.0
	var worst := 0.0
	var off: Array[float] = []
	var late := Time.get_ticks_msec()
	while voice.playing and times.size() < 20000:
		var computed: int = avatar.stats().frames
		await process_frame
		var time := avatar.get_motion_time()
		# Poses before the first computed frame or after the last are not reference frames. Nor are poses when a busy machine
		# computes late: the avatar rests and eases back.
		if time * 30 > computed - 1:
			late = Time.get_ticks_msec()
		if time <= 0.2 or Time.get_ticks_msec() - late < 1000:
			continue
		times.append(time)
		off.append(absf(time - voice.get_playback_position()))
		var frame := at_time(time)
		for joint in 55:
			var shown := skeleton.get_bone_pose_rotation(joint)
			var wanted := quaternion(frame, joint)
			worst = maxf(worst, minf((shown - wanted).length(), (shown + wanted).length()))
			moved = maxf(moved, shown.angle_to(Quaternion.IDENTITY))
		var place := skeleton.get_bone_pose_position(0) - avatar.get_joint_offsets()[0]
		worst = maxf(worst, (place - Vector3(frame[0], frame[1], frame[2])).length())
		worst = maxf(worst, absf(face.get_blend_shape_value(face.find_blend_shape_by_name("jawOpen")) - frame[jaw]))
	expect(times.size() > 100 and times[-1] > 6, "poses over the whole speech, got %d" % times.size())
	expect(worst < CLOSE, "bones, hips and jaw within %f of the frames, got %f" % [CLOSE, worst])
	expect(moved > 0.02, "bones that move, got %f rad" % moved)
	# The median: a busy machine sometimes mixes late.
	off.sort()
	expect(off[off.size() / 2] < 0.1, "motion within 0.1 s of the player's position, got %f" % off[off.size() / 2])
	expect(await until(avatar.is_done), "a stream that is over")
	expect(avatar.stats().frames == 229, "229 frames computed, got %s" % avatar.stats())


## The humanoid profile's names, artist-like bone rolls, arms in an A-pose, a twist bone, a missing bone, half the size.
func test_another_rig_stands_where_the_frames_say() -> void:
	var avatar := make({"skeleton": ^"/root/Body"})
	var names := {}
	var profile := SkeletonProfileHumanoid.new()
	var pairs := {"pelvis": "Hips", "left_hip": "LeftUpperLeg", "left_knee": "LeftLowerLeg", "left_ankle": "LeftFoot",
		"left_foot": "LeftToes", "spine1": "Spine", "spine2": "Chest", "neck": "Neck", "head": "Head",
		"left_collar": "LeftShoulder", "left_shoulder": "LeftUpperArm", "left_elbow": "LeftLowerArm",
		"left_wrist": "LeftHand", "left_index1": "LeftIndexProximal", "left_pinky3": "LeftLittleDistal",
		"left_thumb1": "LeftThumbMetacarpal", "left_thumb3": "LeftThumbDistal", "jaw": "Jaw"}
	for joint in pairs:
		names[joint] = pairs[joint]
		names[joint.replace("left", "right")] = pairs[joint].replace("Left", "Right")
	for joint in names:
		expect(profile.find_bone(names[joint]) >= 0, "%s in Godot's profile" % names[joint])
	var joint_names := avatar.get_joint_names()
	var parents := avatar.get_joint_parents()
	var skeleton := Skeleton3D.new()
	skeleton.name = "Body"
	root.add_child(skeleton)
	var random := RandomNumberGenerator.new()
	random.seed = 7
	# At rest: position and rotation of each bone, arms lowered by 40 degrees about the shoulders.
	var rests: Array[Transform3D] = []
	var bones := {}
	for joint in 55:
		var parent := parents[joint]
		var at := Transform3D(Basis.IDENTITY, avatar.get_joint_offsets()[joint] * 0.5)
		if joint_names[joint] in ["left_shoulder", "right_shoulder"]:
			at.basis = Basis(Vector3.BACK, deg_to_rad(-40 if joint_names[joint] == "left_shoulder" else 40))
		if parent < 0:
			at.origin.y += 0.46
		rests.append(at if parent < 0 else rests[parent] * at)
		if joint_names[joint] not in names:
			continue
		var under := parent
		while under >= 0 and under not in bones:
			under = parents[under]
		var roll := Basis(Quaternion.from_euler(Vector3(random.randf(), random.randf(), random.randf()) * TAU))
		var rest := Transform3D(rests[joint].basis * roll, rests[joint].origin)
		var bone := skeleton.get_bone_count()
		skeleton.add_bone(names[joint_names[joint]])
		var above: int = bones.get(under, -1)
		if joint_names[joint] == "left_elbow":
			# A bone that no joint drives, half way.
			skeleton.add_bone("LeftTwist")
			skeleton.set_bone_parent(bone + 1, above)
			var twist := Transform3D(roll, (rests[under].origin + rest.origin) / 2)
			skeleton.set_bone_rest(bone + 1, skeleton.get_bone_global_rest(above).affine_inverse() * twist)
			above = bone + 1
		skeleton.set_bone_parent(bone, above)
		var parent_rest := skeleton.get_bone_global_rest(above) if above >= 0 else Transform3D.IDENTITY
		skeleton.set_bone_rest(bone, parent_rest.affine_inverse() * rest)
		bones[joint] = bone
	skeleton.reset_bone_poses()
	var samples := hello()
	avatar.push_audio(samples)
	avatar.finish()
	expect(await until(func() -> bool: return avatar.stats().frames > 60), "frames of the 2 s that are shown")
	var worst := 0.0
	for turn in 40:
		await wait(0.02)
		var time := turn / 20.0
		avatar.drive(time)
		var wanted := places(avatar, at_time(avatar.get_motion_time()))
		for joint in bones:
			# Above the missing chest, bending differs from umo's: compare directions from each bone's parent. The spine's two
			# bones share the rotations of three joints.
			var bone: int = bones[joint]
			var up := skeleton.get_bone_parent(bone)
			if up < 0 or skeleton.get_bone_name(up) == "LeftTwist" or parents[joint] not in bones or turn < 20 or joint_names[joint] == "spine2":
				continue
			var shown := skeleton.get_bone_global_pose(bone).origin - skeleton.get_bone_global_pose(up).origin
			worst = maxf(worst, (shown * 2 - (wanted[joint].origin - wanted[parents[joint]].origin)).length())
	expect(bones.size() == 30, "30 bones, got %d" % bones.size())
	expect(worst < CLOSE, "every bone along umo's within %f m, got %f" % [CLOSE, worst])
	var hips := skeleton.get_bone_global_pose(0).origin * 2
	var root_place := places(avatar, at_time(avatar.get_motion_time()))[0].origin
	expect((hips - root_place).length() < CLOSE, "hips where the frames say at half the size, got %s for %s" % [hips, root_place])


## A body whose bones have the given names and umo's axes; the avatar is assigned to it.
func named(avatar: UmoAvatar3D, name_of: Callable) -> Skeleton3D:
	var skeleton := Skeleton3D.new()
	skeleton.name = "Body"
	root.add_child(skeleton)
	for joint in 55:
		skeleton.add_bone(name_of.call(avatar.get_joint_names()[joint]))
		skeleton.set_bone_parent(joint, avatar.get_joint_parents()[joint])
		skeleton.set_bone_rest(joint, Transform3D(Basis.IDENTITY, avatar.get_joint_offsets()[joint]))
	skeleton.reset_bone_poses()
	return skeleton


## Mixamo's name of a joint; Ready Player Me uses the same without the prefix.
func mixamo(joint: String) -> String:
	var parts := {"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
		"jaw": "Jaw", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder", "shoulder": "Arm",
		"elbow": "ForeArm", "wrist": "Hand", "eye": "Eye"}
	var side := "Left" if joint.begins_with("left_") else "Right" if joint.begins_with("right_") else ""
	var part := joint.trim_prefix("left_").trim_prefix("right_")
	return side + (parts[part] if part in parts else "Hand" + part.capitalize().replace(" ", ""))


func test_bones_of_mixamo_and_ready_player_me_are_found() -> void:
	for prefix: String in ["mixamorig_", "mixamorig1_", ""]:
		var avatar := make({"skeleton": ^"/root/Body"})
		var skeleton := named(avatar, func(joint: String) -> String: return prefix + mixamo(joint))
		avatar.push_audio(hello())
		avatar.finish()
		expect(await until(func() -> bool: return avatar.stats().frames > 60), "frames")
		avatar.drive(1.5)
		var frame := avatar.sample_pose(1.5)
		var worst := 0.0
		for joint in 55:
			worst = maxf(worst, skeleton.get_bone_pose_rotation(joint).angle_to(quaternion(frame, joint).normalized()))
		expect(worst < 2e-3, "%s: every bone as its joint, got %f rad" % [mixamo("left_elbow"), worst])
		await process_frame
		expect(told.is_empty(), "no error, got %s" % [told])
		avatar.free()
		skeleton.free()


func test_too_few_bones_are_told_once() -> void:
	var avatar := make({"skeleton": ^"/root/Body"})
	named(avatar, func(joint: String) -> String: return "Head" if joint == "head" else "Thing " + joint.replace("_", "").md5_text())
	avatar.push_audio(hello())
	for turn in 20:
		avatar.drive(turn / 30.0)
		await process_frame
	expect(told.size() == 1 and told[0].contains("`Body`") and told[0].contains("left_shoulder"), "one error, got %s" % [told])
	expect(avatar.is_open(), "an avatar that keeps running")


## WAV files imported by the editor as QOA and IMA-ADPCM.
func test_compressed_wavs_are_decoded() -> void:
	var wanted := hello()
	for file: String in ["res://qoa.wav", "res://ima.wav"]:
		var stream: AudioStreamWAV = load(file)
		expect(stream != null and stream.format == (3 if file.contains("qoa") else 2), "%s as it is imported" % file)
		var avatar := make({"audio_player": ^"/root/Voice"})
		var samples := avatar.decode(stream)
		# IMA-ADPCM starts with a header of eight silent samples.
		var late := 0 if file.contains("qoa") else 8
		var signal_power := 0.0
		var noise := 0.0
		for i in mini(wanted.size(), samples.size() - late):
			signal_power += wanted[i] ** 2
			noise += (wanted[i] - samples[i + late]) ** 2
		expect(absi(samples.size() - wanted.size()) < 16, "%s: %d samples, got %d" % [file, wanted.size(), samples.size()])
		expect(signal_power > 100 * noise, "%s: 20 dB over the noise, got %f" % [file, 10 * log(signal_power / noise) / log(10)])
		var voice := player(stream)
		voice.play()
		expect(await until(func() -> bool: return avatar.stats().frames > 100), "%s: frames, got %s" % [file, avatar.stats()])
		expect(told.is_empty(), "%s: no errors, got %s" % [file, told])
		voice.free()
		avatar.free()


func test_a_damaged_wav_is_told_once() -> void:
	var stream := AudioStreamWAV.new()
	stream.format = 3
	stream.data = "no QOA at all".to_ascii_buffer()
	var avatar := make()
	expect(avatar.decode(stream).is_empty(), "no samples")
	await process_frame
	expect(told.size() == 1 and told[0].contains("QOA"), "one error, got %s" % [told])


func test_a_second_line_goes_on_where_the_first_ended() -> void:
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"audio_player": ^"/root/Voice"})
	voice.play(6.9)
	while voice.playing:
		await process_frame
	expect(await until(avatar.is_done), "the first line's frames")
	await wait(1.5)
	var rested := avatar.get_motion_time()
	voice.play(6.5)
	var first := INF
	while voice.playing:
		await process_frame
		first = minf(first, absf(avatar.get_motion_time() - rested - (voice.get_playback_position() - 6.5)))
	expect(rested < 0.73 + 1.5, "a clock that waits after the line, got %f" % rested)
	expect(first < 0.15, "the second line's motion from its start, off by %f" % first)
	expect(avatar.stats().frames >= 40, "frames of both lines, got %s" % avatar.stats())


func test_a_player_without_samples_is_captured() -> void:
	var effects := AudioServer.get_bus_effect_count(0)
	var generator := AudioStreamGenerator.new()
	generator.mix_rate = 16000
	generator.buffer_length = 5
	var voice := player(generator)
	var avatar := make({"audio_player": ^"/root/Voice"})
	voice.play()
	var playback: AudioStreamGeneratorPlayback = voice.get_stream_playback()
	for sample in hello().slice(0, 60000):
		playback.push_frame(Vector2(sample, sample))
	await wait(3)
	await until(func() -> bool: return avatar.stats().frames >= 30 and avatar.get_motion_time() > 0.5)
	expect(AudioServer.get_bus_effect_count(0) == effects + 1, "one effect more on the bus while it plays")
	var stats := avatar.stats()
	expect(stats.frames >= 30 and stats.silenced == 0, "frames from what was captured, got %s" % stats)
	expect(avatar.get_motion_time() > 0.5, "a clock that runs, got %f" % avatar.get_motion_time())
	voice.stop()
	await until(func() -> bool: return AudioServer.get_bus_effect_count(0) == effects)
	expect(AudioServer.get_bus_effect_count(0) == effects, "the bus as it was after the player stopped")


func test_a_restored_avatar_gives_the_same_bits_again() -> void:
	var avatar := make()
	var samples := hello()
	avatar.push_audio(samples.slice(0, 40000))
	# Saving and restoring are refused while a chunk of the session is computed.
	var saved := [PackedByteArray()]
	expect(await until(func() -> bool:
		saved[0] = avatar.save_state()
		return not saved[0].is_empty()), "a state that is saved")
	var state: PackedByteArray = saved[0]
	for other: UmoAvatar3D in [avatar, make()]:
		expect(await until(func() -> bool: return other.restore_state(state)), "a state that is taken")
		var frames := [PackedFloat32Array()]
		other.push_audio(samples.slice(40000))
		other.finish()
		await until(func() -> bool:
			frames[0].append_array(other.pull_frames())
			return other.is_done())
		expect(frames[0].to_byte_array() == reference.to_byte_array(), "the reference's bits, got %d floats" % frames[0].size())
		expect(other.arousal() != 0.5 and absf(other.arousal_trend()) < 1.0, "the arousal of the voice")
	state[100] ^= 1
	expect(not avatar.restore_state(state), "a damaged state refused")


func test_a_missing_model_fails_with_words() -> void:
	var avatar := make({"model": "res://none.safetensors"})
	await process_frame
	expect(told.size() == 1 and told[0].contains("none.safetensors"), "a signal with the file's name, got %s" % [told])
	expect(not avatar.is_open(), "no avatar")
	expect(avatar.push_audio(hello()) == 0 and avatar.pull_frames().is_empty() and avatar.stats().is_empty(), "calls that do nothing")
	avatar.interrupt(100)
	avatar.drive(1)
	avatar.model = "res://hello.wav"
	avatar.open()
	await process_frame
	expect(told.size() == 2 and told[1].length() > 20, "umo's message about a file that is not a model, got %s" % [told])
	avatar.model = MODEL
	expect(avatar.open(), "an avatar after all")


func test_two_avatars_share_an_engine() -> void:
	var threads := func() -> int: return DirAccess.get_directories_at("/proc/self/task").size()
	var before: int = threads.call()
	var first := make()
	var one: int = threads.call()
	var second := make()
	expect(one > before, "threads of an engine, %d after %d" % [one, before])
	expect(threads.call() == one, "no more threads for the second avatar")
	first.free()
	var frames: PackedFloat32Array = await speak(second)
	expect(frames.to_byte_array() == reference.to_byte_array(), "the reference's bits after the other avatar went")
	second.free()
	await until(func() -> bool: return threads.call() == before)
	expect(threads.call() == before, "no threads left, %d after %d" % [threads.call(), before])


func test_freed_nodes_and_changed_scenes_are_no_crash() -> void:
	var skeleton := Skeleton3D.new()
	skeleton.name = "Body"
	root.add_child(skeleton)
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"skeleton": ^"/root/Body", "audio_player": ^"/root/Voice", "meshes": [^"/root/Body/Head/Face"] as Array[NodePath]})
	Body.build(skeleton, avatar)
	voice.play()
	await wait(0.3)
	skeleton.get_node("Head/Face").free()
	await wait(0.1)
	for attachment in skeleton.get_children():
		attachment.free()
	skeleton.clear_bones()
	await wait(0.1)
	skeleton.free()
	await wait(0.1)
	root.remove_child(avatar)
	await wait(0.1)
	root.add_child(avatar)
	await wait(0.1)
	voice.free()
	await wait(0.1)
	expect(avatar.is_open(), "an avatar that lives without its player")
	avatar.interrupt(200)
	avatar.idle = 2
	avatar.gain_face = 0.5
	avatar.free()
	for turn in 3:
		change_scene_to_file("res://main.tscn")
		await wait(0.3)
	await until(func() -> bool: return current_scene.get_node("Avatar").stats().frames > 0)
	expect(current_scene.get_node("Avatar").stats().frames > 0, "an avatar that speaks in the scene that was changed to")
	unload_current_scene()


func test_it_looks_listens_and_gestures() -> void:
	var avatar := make({"mood": 1, "mood_strength": 0.5, "attention": 3, "layer_gaze": 1.0})
	expect(avatar.is_open() and not avatar.is_live(), "an avatar whose mouth moves with its body")
	expect(avatar.get_gesture_names().has("wave"), "a wave among %s" % [avatar.get_gesture_names()])
	expect(avatar.play_gesture("wave"), "a wave")
	expect(avatar.play_gesture_at("point", Vector3(1, 1, 2), -1.0, 0, 1.0, 5), "a finger that points")
	avatar.gaze_at(Vector3(1, 1.5, 2), 1.0)
	avatar.push_other_audio(PackedFloat32Array([0.1, -0.1, 0.1]))
	await process_frame
	expect(told.is_empty(), "no error, got %s" % [told])
	expect(not avatar.play_gesture("somersault"), "an unknown gesture is refused")
	expect(not avatar.play_gesture("wave", -1.0, 0, 1.0, 256), "an unknown variant is refused")
	avatar.attention = 99
	avatar.layer_feet = 2.0
	expect(avatar.attention == 3 and avatar.layer_feet == 0.0, "properties unchanged by refused values")
	await process_frame
	expect(told.size() == 4, "an error for each, got %s" % [told])


func test_the_listener_turns_to_who_speaks() -> void:
	var turns := [0.0, 0.0]
	for side in 2:
		var scene := UmoScene3D.new()
		root.add_child(scene)
		scene.set_process(false)
		var avatars: Array[UmoAvatar3D] = []
		for i in 2:
			var avatar := UmoAvatar3D.new()
			avatar.model = MODEL
			scene.add_child(avatar)
			avatars.append(avatar)
		var samples := hello().slice(0, 48000)
		expect(avatars[0].push_audio(samples) == 48000, "the speech")
		samples.fill(0.0)
		expect(avatars[1].push_audio(samples) == 48000, "silence")
		avatars[0].position = Vector3(1.5 if side == 0 else -1.5, 0, 1)
		avatars[0].rotation.y = PI
		scene.set_allowed(avatars[1], UmoScene3D.LOOK)
		await until(func() -> bool: return avatars[0].stats().frames >= 78 and avatars[1].stats().frames >= 78)
		for i in 75:
			scene.advance(1 / 30.0)
			avatars[0].sample_pose(i / 30.0)
			var frame := avatars[1].sample_pose(i / 30.0)
			if i >= 45:
				expect(scene.floor() == avatars[0], "the speaker has the floor")
				for joint in [12, 15]:
					var q := quaternion(frame, joint)
					turns[side] += 2 * atan2(q.y, q.w) / 30
		expect(scene.get_member(avatars[1]).role == 1, "a listener")
		# In any order.
		if side == 0:
			avatars[0].free()
			scene.advance(0.1)
			expect(scene.floor() == null, "nobody's floor")
		scene.free()
	expect(turns[0] - turns[1] > 0.2, "a turn to the speaker, got %s" % [turns])


func test_a_scene_goes_on_from_a_saved_state() -> void:
	var state := [PackedByteArray()]
	var runs := []
	told.clear()
	for again in 2:
		var scene := UmoScene3D.new()
		scene.failed.connect(func(message: String) -> void: told.append(message))
		root.add_child(scene)
		scene.set_process(false)
		expect(scene.save_state().is_empty() and not scene.restore_state(state[0]), "no scene yet")
		var avatars: Array[UmoAvatar3D] = []
		for i in 2:
			var avatar := UmoAvatar3D.new()
			avatar.model = MODEL
			scene.add_child(avatar)
			avatar.set_process(false)
			avatar.position.x = 1.2 * i
			avatars.append(avatar)
		scene.advance(0)
		if again == 0:
			var samples := hello().slice(0, 48000)
			avatars[0].push_audio(samples)
			samples.fill(0.0)
			avatars[1].push_audio(samples)
			await until(func() -> bool: return avatars.all(func(avatar: UmoAvatar3D) -> bool: return avatar.stats().frames >= 78))
			seconds_of_a_scene(scene, avatars, 0, 40)
			expect(await until(func() -> bool:
				state[0] = scene.save_state()
				return not state[0].is_empty()), "a state that is saved")
			runs.append(seconds_of_a_scene(scene, avatars, 40, 75))
		expect(await until(func() -> bool: return scene.restore_state(state[0])), "a state that is taken")
		runs.append(seconds_of_a_scene(scene, avatars, 40, 75))
		expect(scene.floor() == avatars[0] and scene.get_member(avatars[1]).role == 1, "who speaks and who listens")
		var damaged: PackedByteArray = state[0].slice(1)
		expect(not scene.restore_state(damaged), "a damaged state refused")
		await process_frame
		expect(told.size() == again + 1, "an error for each damaged state, got %s" % [told])
		scene.free()
	expect(runs[0].size() > 0 and runs[0] == runs[1] and runs[0] == runs[2], "the same bits after the state")


## Frames of all avatars while their scene goes on.
func seconds_of_a_scene(scene: UmoScene3D, avatars: Array[UmoAvatar3D], from: int, to: int) -> PackedByteArray:
	var bits := PackedByteArray()
	for i in range(from, to):
		scene.advance(1 / 30.0)
		for avatar in avatars:
			bits.append_array(avatar.sample_pose(i / 30.0).to_byte_array())
	return bits


func test_a_person_in_a_scene_speaks_and_is_looked_at() -> void:
	var scene := UmoScene3D.new()
	var avatar := make()
	avatar.name = "One"
	var camera := Camera3D.new()
	camera.name = "Eyes"
	root.add_child(camera)
	camera.position = Vector3(0, 1.7, 2)
	var heard := []
	scene.floor_changed.connect(func(member: Node3D) -> void: heard.append(member))
	scene.failed.connect(func(message: String) -> void: told.append(message))
	scene.members = [^"/root/One", ^"/root/Eyes"] as Array[NodePath]
	root.add_child(scene)
	scene.set_process(false)
	expect(not scene.push_audio(camera, PackedFloat32Array([0.1])), "nobody there yet")
	scene.advance(0)
	var samples := hello()
	for i in 45:
		expect(scene.push_audio(camera, samples.slice(i * 533, i * 533 + 533)), "a voice")
		scene.advance(1 / 30.0)
	expect(scene.floor() == camera and scene.get_member(camera).role == 2, "the person has the floor")
	scene.set_target(avatar, camera)
	scene.advance(0.1)
	expect(scene.get_member(avatar).attends_to == camera, "a look at the person")
	# An avatar that is opened again is another member.
	avatar.open()
	scene.advance(0.1)
	expect(scene.get_member(avatar).attends_to == camera, "a look at the person, by the new session")
	await process_frame
	camera.free()
	scene.advance(0.1)
	expect(scene.floor() == null, "nobody's floor")
	avatar.free()
	scene.advance(0.1)
	await process_frame
	expect(heard.size() == 2 and told.is_empty(), "two changes of the floor, got %s and %s" % [heard, told])


## Opening of the lips.
func opening(avatar: UmoAvatar3D, frame: PackedFloat32Array) -> float:
	var names := avatar.get_channel_names()
	var first := 3 + 4 * 55
	return frame[first + names.find("jawOpen")] - frame[first + names.find("mouthClose")]


func frame_of(frames: PackedFloat32Array, at: int) -> PackedFloat32Array:
	return frames.slice(at * width, (at + 1) * width)


func test_hints_close_the_lips() -> void:
	var avatar := make({"sample_rate": 16000})
	expect(avatar.hint_lips(0, 1.0, 0.1), "a hint before its audio")
	var hinted := await speak(avatar)
	expect(hinted.size() == reference.size(), "as many frames, got %d" % (hinted.size() / width))
	var open := 0.0
	for at in range(30, 34):
		expect(opening(avatar, frame_of(hinted, at)) < 0.01, "lips that are closed at frame %d" % at)
		open = maxf(open, opening(avatar, frame_of(reference, at)))
	expect(open > 0.05, "lips that are open without, got %f" % open)
	for at in [20, 40]:
		expect(frame_of(hinted, at) == frame_of(reference, at), "frame %d as without" % at)
	avatar = make()
	for count in 64:
		expect(avatar.hint_lips(0, 20.0 + count, 0.1), "room for 64 hints, not for %d" % count)
	expect(not avatar.hint_lips(0, 100.0, 0.1), "no room for more")
	await process_frame
	expect(told.is_empty(), "no error, got %s" % [told])
	expect(not avatar.hint_lips(3, 1.0, 0.1) and not avatar.hint_lips(0, -1.0, 0.1), "invalid hints are refused")
	await process_frame
	expect(told.size() == 2 and "expected a shape" in told[0], "an error for each, got %s" % [told])


func test_words_become_gestures_at_their_time() -> void:
	# "now" means nothing in English.
	var avatar := make({"sample_rate": 16000, "word_rules": "[class.own]\nwords = ['now']\ngestures = [{ name = 'stop' }]"})
	expect(avatar.hint_words("now", 2.0, 2.4), "a word before its audio")
	var said := await speak(avatar)
	expect(frame_of(said, 30) == frame_of(reference, 30), "frame 30 as without")
	var turned := quaternion(frame_of(said, 66), 17).angle_to(quaternion(frame_of(reference, 66), 17))
	expect(turned > 0.3, "a right arm that rises, got %f" % turned)
	avatar = make({"audio_player": ^"/root/Voice"})
	for count in 64:
		expect(avatar.hint_words("now", count, count + 0.1), "room for 64 words, not for %d" % count)
	expect(not avatar.hint_words("now", 100.0, 100.1), "no room for more")
	expect(avatar.hint_lips(0, 20.0, 0.1), "room for lips")
	expect(told.is_empty(), "no error, got %s" % [told])
	expect(not avatar.hint_words("now", 2.0, 1.0), "a word that ends before it starts is refused")
	avatar.language = "xx"
	expect(not avatar.open(), "no rules for a language")
	await process_frame
	expect(told.size() == 2 and "hint_words" in told[0] and "xx" in told[1], "an error for each, got %s" % [told])


func test_hints_are_of_the_line_that_the_player_plays() -> void:
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"audio_player": ^"/root/Voice"})
	# The frame with the widest opening, more than a second from the start.
	var widest := 45
	for at in range(45, reference.size() / width - 45):
		if opening(avatar, frame_of(reference, at)) > opening(avatar, frame_of(reference, widest)):
			widest = at
	var place := widest / 30.0
	expect(opening(avatar, frame_of(reference, widest)) > 0.2, "lips that open")
	var plain := await openings(avatar, voice, place, false)
	var first := await openings(avatar, voice, place, true)
	# The hint in the call that restarts the player belongs to the new line.
	var second := await openings(avatar, voice, place, true)
	expect(plain > 0.1, "open lips without a hint, got %f" % plain)
	expect(first < 0.01, "closed lips, got %f" % first)
	expect(second < 0.01, "closed lips again, got %f" % second)
	expect(told.is_empty(), "no error, got %s" % [told])


## Plays from one second before a position of the voice, and holds the player until its frames exist, however busy the
## machine is. Returns the widest opening of the lips within a tenth of a second of the position.
func openings(avatar: UmoAvatar3D, voice: AudioStreamPlayer, place: float, is_hinted: bool) -> float:
	var before: int = avatar.stats().frames
	voice.play(place - 1.0)
	if is_hinted:
		expect(avatar.hint_lips(0, place - 0.3, 0.6), "a hint as the player begins")
	await process_frame
	await process_frame
	voice.stream_paused = true
	var begun := avatar.get_motion_time()
	expect(await until(func() -> bool: return avatar.stats().frames >= before + 40), "frames of the line, got %s" % avatar.stats())
	var most := 0.0
	for at in 7:
		most = maxf(most, opening(avatar, avatar.sample_pose(begun + 0.9 + at / 30.0)))
	voice.stream_paused = false
	voice.stop()
	await wait(0.6)
	return most


## The least distance of the right hand from the spine while it goes to the chest, by the volume of a wide body.
func nearest(volume: float) -> float:
	var skeleton := Skeleton3D.new()
	skeleton.name = "Body"
	root.add_child(skeleton)
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"skeleton": ^"/root/Body", "audio_player": ^"/root/Voice", "volume": volume})
	Body.build(skeleton, avatar)
	var ball := SphereMesh.new()
	ball.radius = 0.34
	ball.height = 0.8
	var trunk := MeshInstance3D.new()
	trunk.mesh = ball
	var at := BoneAttachment3D.new()
	skeleton.add_child(at)
	at.bone_name = "spine2"
	at.add_child(trunk)
	expect(avatar.play_gesture("me"), "a hand that goes to the chest")
	voice.play()
	var names := avatar.get_joint_names()
	var least := 10.0
	var start := Time.get_ticks_msec()
	while voice.playing and Time.get_ticks_msec() - start < 4000:
		await process_frame
		var hand := skeleton.get_bone_global_pose(names.find("right_wrist")).origin
		var spine := skeleton.get_bone_global_pose(names.find("spine2")).origin
		if absf(hand.y - spine.y) < 0.2:
			least = minf(least, Vector2(hand.x - spine.x, hand.z - spine.z).length())
	expect(told.is_empty(), "no error, got %s" % [told])
	for node: Node in [avatar, voice, skeleton]:
		node.free()
	return least


func test_arms_keep_out_of_a_wide_body() -> void:
	var plain := await nearest(0.0)
	var kept := await nearest(1.0)
	expect(plain < 0.33 and kept > plain + 0.02, "a hand outside of the body, from %f to %f m" % [plain, kept])


func test_gestures_of_ones_own_come_out_of_files() -> void:
	var avatar := make({"smoothing": 0.0, "lookahead": 0, "target": 1})
	var rough: float = avatar.latency().seconds
	expect(avatar.add_gesture("greet", "res://salute.bytes", "", 8, -1.0), "a gesture out of a file")
	avatar.smoothing = -1.0
	expect(avatar.open(), "an avatar that knows it")
	expect(absf(avatar.latency().seconds - rough - 0.1) < 1e-6, "the low-pass filter looks three frames ahead")
	expect(avatar.get_gesture_names().has("greet") and avatar.play_gesture("greet"), "a greeting")
	await process_frame
	expect(told.is_empty(), "no error, got %s" % [told])
	expect(not avatar.add_gesture("greet", "res://salute.bytes", "wave", 8, -1.0), "an animation missing from the file is refused")
	expect(not avatar.add_gesture("greet", "res://nothing.bytes", "", 8, -1.0), "a missing file is refused")
	await process_frame
	expect(told.size() == 2 and "salute" in told[0] and "nothing.bytes" in told[1], "an error for each, got %s" % [told])


func test_what_moves_in_silence_goes_by_the_games_time() -> void:
	var avatar := make({"layer_idle": 1.0})
	avatar.set_clock(3.0)
	var poses := []
	for i in 3:
		poses.append(avatar.sample_pose(0.0))
	expect(poses[1] == poses[2], "an avatar that pauses with the game's time")
	avatar.set_clock(3.5)
	expect(avatar.sample_pose(0.0) != poses[2], "an avatar that continues with it")


func test_bad_arguments_are_errors_and_no_crash() -> void:
	var avatar := make({"target": 10000})
	await process_frame
	expect(told.size() == 1 and not avatar.is_open(), "an invalid target is refused, got %s" % [told])
	avatar.target = 0
	expect(avatar.open(), "an avatar")
	avatar.idle = 99
	avatar.gain_face = -1e9
	expect(avatar.idle == 1 and avatar.gain_face == 1, "properties unchanged by refused values")
	avatar.interrupt(-5)
	avatar.prompt = "smile"
	expect(avatar.sample_pose(NAN).is_empty(), "no pose at no time")
	expect(avatar.push_audio(PackedFloat32Array([NAN, INF, 1e30])) == 3, "samples that become silence")
	avatar.finish()
	expect(avatar.push_audio(PackedFloat32Array([0.5])) == 0, "nothing taken after the end")
	expect(avatar.is_open(), "an avatar still")
	await process_frame
	expect(told.size() == 6, "an error for each, got %s" % [told])


func test_a_take_plays_the_recorded_frames() -> void:
	var take := FileAccess.get_file_as_bytes(OS.get_cmdline_user_args()[1])
	var avatar := make()
	expect(avatar.play_take(take), "a take that is played")
	for again in 2:
		var played := PackedFloat32Array()
		while not avatar.is_done():
			played.append_array(avatar.pull_frames())
		expect(played == reference, "the recorded bits, got %d of %d frames" % [played.size() / width, reference.size() / width])
		avatar.reset()
	expect(avatar.sample_pose(1.0) == frame_of(reference, 30), "a pose by the script's clock")
	await process_frame
	expect(told.is_empty(), "no error, got %s" % [told])
	# The avatar hears nothing meanwhile, and speaks again once it is opened.
	expect(avatar.push_audio(PackedFloat32Array([0.5])) == 0, "no sample taken")
	expect(not avatar.play_take(take.slice(1)) and avatar.is_open(), "what is not a take is refused")
	await process_frame
	expect(told.size() == 2 and "not a take" in told[1], "an error for each, got %s" % [told])
	expect(avatar.open() and avatar.push_audio(PackedFloat32Array([0.5])) == 1, "an avatar that hears")
	avatar.close()
	expect(not avatar.play_take(take), "nothing is played by an avatar that is closed")


func test_a_take_goes_with_its_sound() -> void:
	var voice := player(Body.wav("res://hello.wav"))
	var avatar := make({"audio_player": ^"/root/Voice"})
	expect(avatar.play_take(FileAccess.get_file_as_bytes(OS.get_cmdline_user_args()[1])), "a take that is played")
	voice.play()
	expect(await until(func() -> bool: return avatar.get_motion_time() > 1.0), "a clock that runs")
	expect(absf(avatar.get_motion_time() - voice.get_playback_position()) < 0.3, "the time of the sound, got %f at %f"
			% [avatar.get_motion_time(), voice.get_playback_position()])
	voice.stop()
	expect(told.is_empty(), "no error, got %s" % [told])
