"""Datagrams of `umo live --vmc` decoded by python-osc and by vmcp, and compared with the .vrma file of the same take.

vmc.py DATAGRAMS.hex TAKE.vrma TAKE.npz
"""

import socket
import sys
import time
from importlib.metadata import version

import motion
import numpy as np
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_packet import OscPacket
from report import Report
from vmcp import events
from vmcp.facades import on_receive
from vmcp.osc import OSC
from vmcp.osc.backend.osc4py3 import as_eventloop
from vmcp.typing import Bone

VRM0 = {"A": "aa", "I": "ih", "U": "ou", "E": "ee", "O": "oh", "Blink_L": "blinkLeft", "Blink_R": "blinkRight"}
TYPES = {
    "/VMC/Ext/OK": (int,) * 4,
    "/VMC/Ext/T": (float,),
    "/VMC/Ext/Root/Pos": (str,) + (float,) * 7,
    "/VMC/Ext/Bone/Pos": (str,) + (float,) * 7,
    "/VMC/Ext/Blend/Val": (str, float),
    "/VMC/Ext/Blend/Apply": (),
}
# The protocol asks for less, so that no network splits a datagram.
MOST_BYTES = 1500
# Datagrams that vmcp gets before it is asked to process them: fewer than fill a socket's buffer.
AT_ONCE = 20

# Seconds after which a stream has eased from the rest pose to the motion.
EASED = 0.5
# Seconds from a frame of a file within which its values are the frame's.
NEAR = 0.002

Message = tuple[str, tuple]
Pose = dict[str, dict[str, np.ndarray]]


def messages(datagram: bytes) -> list[Message]:
    return [(timed.message.address, tuple(timed.message.params)) for timed in OscPacket(datagram).messages]


def poses(said: list[Message]) -> list[Pose]:
    """Numbers by address and name, for each pose."""
    found: list[Pose] = []
    for address, arguments in said:
        if address == "/VMC/Ext/OK":
            found.append({})
        names = [argument for argument in arguments if isinstance(argument, str)]
        numbers = np.array([argument for argument in arguments if not isinstance(argument, str)], float)
        found[-1].setdefault(address, {})[names[0] if names else ""] = numbers
    return found


def column(found: list[Pose], address: str, name: str = "") -> np.ndarray:
    return np.array([pose[address][name] for pose in found])


def unity(rotation: np.ndarray) -> np.ndarray:
    """A rotation of glTF's axes in Unity's, which mirror X."""
    return rotation * [1, -1, -1, 1]


def vrm_bone(name: str) -> str:
    """VRM 1.0's name of a bone of Unity's: the thumb begins at the metacarpal."""
    name = name.replace("ThumbProximal", "ThumbMetacarpal").replace("ThumbIntermediate", "ThumbProximal")
    return name[0].lower() + name[1:]


class Take:
    """What an avatar shows that plays the .vrma file."""

    def __init__(self, vrma: str, npz: str) -> None:
        self.file = motion.read(vrma)
        extension = self.file.extensions["VRMC_vrm_animation"]
        self.bones = {name: entry["node"] for name, entry in extension["humanoid"]["humanBones"].items()}
        self.presets = {name: entry["node"] for name, entry in extension["expressions"]["preset"].items()}
        with np.load(npz) as arrays:
            self.face, self.face_names = arrays["arkit"].astype(float), [str(name) for name in arrays["arkit_names"]]
            self.times = np.arange(len(self.face)) / float(arrays["mocap_frame_rate"])

    def rotation(self, bone: str, times: np.ndarray) -> np.ndarray:
        """Rotation from the T-pose, as VRM's specification derives it from a file."""
        node = self.bones[bone]
        parent = self.file.parents.get(node)
        above = self.file.rest(parent) if parent is not None else np.array([0.0, 0, 0, 1])
        own = self.file.values(node, "rotation", times)
        return motion.product(motion.product(above, own), motion.inverse(self.file.rest(node)))

    def shape(self, name: str, times: np.ndarray) -> np.ndarray:
        if name in VRM0:
            return self.file.values(self.presets[VRM0[name]], "translation", times)[:, 0]
        return np.interp(times, self.times, self.face[:, self.face_names.index(name)])


def delay(found: list[Pose], seconds: np.ndarray, take: Take) -> float:
    """Seconds from a pose's time in the motion to its time in the messages, where the opening of the jaw fits best."""
    sent = column(found, "/VMC/Ext/Blend/Val", "jawOpen")[:, 0]

    def error(late: float) -> float:
        return float(np.sum((take.shape("jawOpen", seconds - late) - sent) ** 2))

    best = min(np.arange(0, 3, 0.01), key=error)
    return float(min(best + np.arange(-0.01, 0.01, 0.0001), key=error))


def judge_osc(datagrams: list[bytes], take: Take) -> list[Message]:
    report = Report("VMC 2.7", f"python-osc {version('python-osc')}")
    report.check("every datagram is a bundle", all(OscBundle.dgram_is_bundle(datagram) for datagram in datagrams))
    longest = max(map(len, datagrams))
    report.within("length of a datagram", longest, MOST_BYTES, " bytes")
    said = [message for datagram in datagrams for message in messages(datagram)]
    known = all(tuple(map(type, arguments)) == TYPES.get(address) for address, arguments in said)
    report.check("addresses and types of the protocol", known, f"{len(said)} messages")
    found = poses(said)
    parts = [len(pose["/VMC/Ext/Bone/Pos"]) for pose in found], [len(pose["/VMC/Ext/Blend/Val"]) for pose in found]
    report.check("55 bones and 59 shapes in each pose", set(parts[0]) == {55} and set(parts[1]) == {59}, len(found))
    each = sum(parts[0]) + sum(parts[1]) + 4 * len(found)
    report.check("nothing twice or missing in a pose", each == len(said), f"{each} of {len(said)}")
    firsts = [address for address, _ in said if address in ("/VMC/Ext/OK", "/VMC/Ext/Blend/Apply")]
    is_closed = firsts == ["/VMC/Ext/OK", "/VMC/Ext/Blend/Apply"] * len(found)
    report.check("a pose ends with Apply", is_closed and said[-1][0] == "/VMC/Ext/Blend/Apply")
    states = column(found, "/VMC/Ext/OK")
    report.check("loaded, calibrated, normal, tracking", bool((states == [1, 3, 0, 1]).all()))
    seconds = column(found, "/VMC/Ext/T")[:, 0]
    steps = np.diff(seconds)
    report.check("time grows", bool((steps > 0).all()), f"by {steps.min():.4f} to {steps.max():.4f} s")
    root = column(found, "/VMC/Ext/Root/Pos", "root")
    report.check("the root is the origin", bool((root == [0, 0, 0, 0, 0, 0, 1]).all()))

    names = sorted(found[0]["/VMC/Ext/Bone/Pos"])
    bones = {name: column(found, "/VMC/Ext/Bone/Pos", name) for name in names}
    lengths = np.array([np.linalg.norm(numbers[:, 3:], axis=1) for numbers in bones.values()])
    report.within("rotations are unit quaternions: error of the length", np.abs(lengths - 1).max(), 1e-5)
    shapes = {name: column(found, "/VMC/Ext/Blend/Val", name)[:, 0] for name in found[0]["/VMC/Ext/Blend/Val"]}
    weights = np.array(list(shapes.values()))
    report.check("weights are 0 to 1", bool((weights >= 0).all() and (weights <= 1).all()))
    expected = set(take.face_names) | set(VRM0)
    report.check("names of the shapes: ARKit's and VRM 0's", set(shapes) == expected, len(shapes))
    report.check("the face moves", shapes["jawOpen"].max() > 0.2 and shapes["Blink_L"].max() > 0.5)

    late = delay(found, seconds, take)
    spoken = (seconds - late >= EASED) & (seconds - late <= take.times[-1])
    times = seconds[spoken] - late
    wrong = {name: np.abs(values[spoken] - take.shape(name, times)) for name, values in shapes.items()}
    worst = max(take.face_names, key=lambda name: wrong[name].max())
    report.within(f"ARKit's shapes as in .npz, {late:.3f} s later: {worst}", wrong[worst].max(), 0.001)
    # Vowels do not depend linearly on the shapes, and a file has them only at its frames.
    is_near = np.abs(times[:, None] - take.times).min(axis=1) < NEAR
    worst = max(VRM0, key=lambda name: wrong[name][is_near].max())
    report.within(f"vowels and blinks as in .vrma: {worst}", wrong[worst][is_near].max(), 0.02)
    common = [name for name in names if vrm_bone(name) in take.bones]
    report.check("bones of the .vrma file among them", len(common) == len(take.bones), len(common))
    off = {
        name: motion.angles(bones[name][spoken, 3:], unity(take.rotation(vrm_bone(name), times))).max()
        for name in common
    }
    worst = max(off, key=off.__getitem__)
    report.within(f"rotations from the T-pose as in .vrma: {worst}", off[worst], 0.1, "°")
    hips = take.file.values(take.bones["hips"], "translation", times) * [-1, 1, 1]
    far = np.linalg.norm(bones["Hips"][spoken, :3] - hips, axis=1).max() * 1000
    report.within("position of the hips as in .vrma", far, 1, " mm")
    return said


def judge_vmcp(datagrams: list[bytes], said: list[Message]) -> None:
    """Sends the datagrams to vmcp's receiver and compares the events that it makes of them."""
    report = Report("VMC 2.7", f"vmcp {version('vmcp')}")
    kinds = (
        events.StateEvent,
        events.RelativeTimeEvent,
        events.RootTransformEvent,
        events.BoneTransformEvent,
        events.BlendShapeEvent,
        events.BlendShapeApplyEvent,
    )
    heard: list[events.Event] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    osc = OSC(as_eventloop)
    with osc.open():
        receiver = osc.create_receiver("127.0.0.1", port, "umo").open()
        for kind in kinds:
            on_receive(receiver, kind, heard.append)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            sent = 0
            for start in range(0, len(datagrams), AT_ONCE):
                for datagram in datagrams[start : start + AT_ONCE]:
                    out.sendto(datagram, ("127.0.0.1", port))
                    sent += len(messages(datagram))
                until = time.monotonic() + 5
                while len(heard) < sent and time.monotonic() < until:
                    osc.run()
    for kind in kinds:
        count = sum(isinstance(event, kind) for event in heard)
        expected = sum(address == kind.ADDRESS_PATTERN for address, _ in said)
        report.check(f"{kind.__name__} of each such message", count == expected > 0, f"{count} of {expected}")
    bones = [event for event in heard if isinstance(event, events.BoneTransformEvent)]
    report.check("all 55 bones of Unity", {event.joint for event in bones} == set(Bone), len({e.joint for e in bones}))
    numbers = [
        (e.joint.value, e.position.x, e.position.y, e.position.z, *(getattr(e.rotation, axis) for axis in "xyzw"))
        for e in bones
    ]
    same = numbers == [arguments for address, arguments in said if address == "/VMC/Ext/Bone/Pos"]
    report.check("bones as python-osc reads them", same)
    shapes = [(event.key, event.value) for event in heard if isinstance(event, events.BlendShapeEvent)]
    same = shapes == [arguments for address, arguments in said if address == "/VMC/Ext/Blend/Val"]
    report.check("shapes as python-osc reads them", same)


def main(hex_file: str, vrma: str, npz: str) -> None:
    with open(hex_file) as file:
        datagrams = [bytes.fromhex(line) for line in file]
    said = judge_osc(datagrams, Take(vrma, npz))
    judge_vmcp(datagrams, said)


if __name__ == "__main__":
    main(*sys.argv[1:])
