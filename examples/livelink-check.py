"""Runs a sender and decodes its packets with PyPI's pylivelinkface: `livelink-check.py FPS COMMAND…`, where `PORT`
anywhere in a word of the command is replaced by the port to send to."""

import socket
import subprocess
import sys

from pylivelinkface import FaceBlendShape, PyLiveLinkFace

fps, command = int(sys.argv[1]), sys.argv[2:]
listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
listener.bind(("127.0.0.1", 0))
port = str(listener.getsockname()[1])
sender = subprocess.Popen([word.replace("PORT", port) for word in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
faces = []
# The model is loaded first; then a packet arrives with every frame.
listener.settimeout(60)
while True:
    try:
        is_face, face = PyLiveLinkFace.decode(listener.recv(2048))
    except socket.timeout:
        break
    assert is_face
    faces.append(face)
    if sender.poll() is not None:
        listener.settimeout(0.2)
assert sender.wait(60) == 0, sender.stderr.read().decode()

assert len(faces) > 4 * fps, len(faces)
assert {(face.name, face.fps, face._version, face._denominator) for face in faces} == {("Ada", fps, 6, 1)}
# Its "uuid" starts with the length byte of the text.
assert all(len(face.uuid) == 37 and face.uuid == faces[0].uuid for face in faces)
numbers = [face._frames + face._sub_frame for face in faces]
assert numbers == sorted(set(numbers)), numbers
values = {shape: [face.get_blendshape(shape) for face in faces] for shape in FaceBlendShape}
for shape, weights in values.items():
    least, most = (0, 1) if shape.value < FaceBlendShape.HeadYaw.value else (-1.5, 1.5)
    assert least <= min(weights) and max(weights) <= most, (shape, weights)
# The speaker talks, blinks and moves the head.
for shape, least in ((FaceBlendShape.JawOpen, 0.2), (FaceBlendShape.EyeBlinkLeft, 0.5), (FaceBlendShape.HeadPitch, 0.01)):
    assert max(values[shape]) - min(values[shape]) > least, shape
print(f"{len(faces)} faces by {command[0].rsplit('/', 1)[-1]}")
