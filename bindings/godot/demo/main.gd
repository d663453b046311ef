extends Node3D
## hello.wav, spoken by a capsule body built from the model's joints. Space speaks again, Escape interrupts.

@onready var avatar: UmoAvatar3D = $Avatar
@onready var voice: AudioStreamPlayer = $Voice


func _ready() -> void:
	avatar.failed.connect(func(message: String) -> void: print("failed: ", message))
	if not avatar.is_open():
		return
	print(avatar.get_notice())
	const Body := preload("res://body.gd")
	Body.build($Skeleton, avatar)
	voice.stream = Body.wav("res://hello.wav")
	voice.play()


func _unhandled_key_input(event: InputEvent) -> void:
	if event.is_pressed() and event.keycode == KEY_SPACE:
		voice.play()
	elif event.is_pressed() and event.keycode == KEY_ESCAPE:
		voice.stop()
		avatar.interrupt(300)
