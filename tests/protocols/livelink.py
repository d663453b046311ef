"""Datagrams of `umo live --livelink` decoded by pylivelinkface and compared with the .csv file of the same take.

livelink.py DATAGRAMS.hex TAKE.csv SUBJECT FPS
"""

import csv
import sys
import uuid
from importlib.metadata import version

import numpy as np
from pylivelinkface import FaceBlendShape, PyLiveLinkFace
from report import Report

ANGLES = FaceBlendShape.HeadYaw.value
# Seconds after which a stream has eased from the rest pose to the motion.
EASED = 0.5
# Bytes of the number of values and of the values.
VALUES = 1 + 4 * len(FaceBlendShape)


def main(hex_file: str, csv_file: str, subject: str, fps: int) -> None:
    report = Report("Live Link Face 6", f"pylivelinkface {version('pylivelinkface')}")
    with open(hex_file) as file:
        datagrams = [bytes.fromhex(line) for line in file]
    decoded = [PyLiveLinkFace.decode(datagram) for datagram in datagrams]
    faces = [face for is_face, face in decoded if is_face]
    report.check("every datagram is a face with 61 values", len(faces) == len(decoded) > 0, f"{len(faces)} faces")
    heads = {(face._version, face.name, face.fps, face._denominator) for face in faces}
    report.check("version, name, rate", heads == {(6, subject, fps, 1)}, heads)
    # pylivelinkface counts the byte of the text's length, `$`, to the id.
    ids = {face.uuid for face in faces}
    text = next(iter(ids))
    is_uuid = text[0] == "$" and str(uuid.UUID(text[1:])).upper() == text[1:]
    report.check("one id, a UUID", len(ids) == 1 and is_uuid, text)
    frames = np.array([face._frames + face._sub_frame for face in faces])
    report.check("frame numbers grow", bool((np.diff(frames) > 0).all()), f"{frames[0]:.2f} to {frames[-1]:.2f}")
    report.check("fractions of a frame are 0 to 1", all(0 <= face._sub_frame < 1 for face in faces))
    # pylivelinkface writes the same layout, but with the time of its own clock: what follows the time is compared.
    written = []
    for face, datagram in zip(faces, datagrams, strict=True):
        # It writes no fractions of a frame.
        sub_frame, face._sub_frame = face._sub_frame, 0
        written.append(face.encode()[-VALUES:] == datagram[-VALUES:])
        face._sub_frame = sub_frame
    report.check("values as pylivelinkface writes them", all(written))

    with open(csv_file, newline="") as file:
        rows = list(csv.DictReader(file))
    # By name: the app's files have JawRight and MouthRight before the left ones, its packets after them.
    spelled = {name.lower(): name for name in rows[0]}
    columns = [spelled[shape.name.lower()] for shape in FaceBlendShape]
    report.check("the names of .csv", len(rows[0]) == len(columns) + 2, len(columns))
    take = np.array([[float(row[name]) for name in columns] for row in rows])
    sent = np.array([[face.get_blendshape(shape) for shape in FaceBlendShape] for face in faces])
    weights = sent[:, :ANGLES]
    report.check("weights are 0 to 1", bool((weights >= 0).all() and (weights <= 1).all()))
    report.within("angles of head and eyes", float(np.abs(sent[:, ANGLES:]).max()), np.pi / 2, " rad")

    rate, seconds = 30, frames / fps
    times = np.arange(len(take)) / rate

    def shown(late: float, column: int, chosen: slice | np.ndarray = slice(None)) -> np.ndarray:
        return np.interp(seconds[chosen] - late, times, take[:, column])

    jaw = FaceBlendShape.JawOpen.value

    def error(late: float) -> float:
        return float(np.sum((shown(late, jaw) - sent[:, jaw]) ** 2))

    late = min(np.arange(0, 3, 0.01), key=error)
    late = min(late + np.arange(-0.01, 0.01, 0.0001), key=error)
    spoken = (seconds - late >= EASED) & (seconds - late <= times[-1])
    wrong = [np.abs(shown(late, column, spoken) - sent[spoken, column]).max() for column in range(len(columns))]
    shape = int(np.argmax(wrong[:ANGLES]))
    report.within(f"weights as in .csv, {late:.3f} s later: {columns[shape]}", wrong[shape], 0.01)
    angle = ANGLES + int(np.argmax(wrong[ANGLES:]))
    report.within(f"angles as in .csv: {columns[angle]}", wrong[angle], 0.002, " rad")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
