extends SceneTree
## A project without umo's library still runs, and its avatar reports the missing library.

var told := ""


func _initialize() -> void:
	var avatar := UmoAvatar3D.new()
	avatar.model = "res://addons/umo/umo-people.safetensors"
	avatar.failed.connect(func(message: String) -> void: told = message)
	root.add_child(avatar)
	await process_frame
	await process_frame
	avatar.push_audio(PackedFloat32Array([0.0]))
	var right := told.contains("libumo") and not avatar.is_open()
	print("a missing library is reported ... ", "ok" if right else "FAILED: " + told)
	quit(0 if right else 1)
