extends SceneTree
## Renders the demo at a time of its speech: godot -s picture.gd -- SECONDS FILE


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	change_scene_to_file("res://main.tscn")
	await process_frame
	await process_frame
	var avatar: UmoAvatar3D = current_scene.get_node("Avatar")
	while avatar.get_motion_time() < float(arguments[0]):
		await process_frame
	await RenderingServer.frame_post_draw
	var image := root.get_texture().get_image()
	quit(0 if image.save_png(arguments[1]) == OK else 1)
