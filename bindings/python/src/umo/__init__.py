"""A living avatar from speech: samples in; face, hands, upper and lower body out, 30 frames a second, on the CPU.

| | |
|---|---|
| `animate(samples, rate)` | a whole recording to a `Motion` of numpy arrays |
| `stream(chunks, rate)` | frames as they are computed from arriving audio |
| `Model`, `Engine`, `Session` | a live avatar: one thread pushes audio, another pulls frames or samples poses |
| `Retarget` | poses on other characters, whose arms keep out of their bodies |
| `Scene` | avatars and people that know each other: who speaks, and who looks at whom |
| `Session.pull_packets`, `Decoder` | an avatar computed in one place and shown in others |
| `Take`, `Session.take` | a motion as a file, played again by a `Decoder` |
| `self_test()` | checks this machine's results and speed: a report to publish |
| `umo.serve`, `umo.agents`, `umo.ray` | a client of `umo serve`; avatars of voice agents; recordings on a Ray cluster |
| `Error`, `Status` | errors, with umo's messages |
"""

# Set first: `_library` needs it.
_DISTRIBUTION = "umo-avatar"

from ._animate import animate, stream
from ._engine import Engine
from ._generated import Attention, Idle, Latency, Received, Role, Stats, Status, TakeInfo
from ._gltf import FIGURES
from ._library import Error, lib as _lib
from ._model import Model, SelfTest, self_test
from ._motion import Frame, Motion
from ._names import JOINTS, VISEMES
from ._retarget import Retarget
from ._scene import Member, Scene
from ._session import Decoder, Parameter, Sampled, Session
from ._take import Take

__version__: str = _lib.umo_version().decode()

__all__ = [
    "FIGURES",
    "JOINTS",
    "VISEMES",
    "Attention",
    "Decoder",
    "Engine",
    "Error",
    "Frame",
    "Idle",
    "Latency",
    "Member",
    "Model",
    "Motion",
    "Parameter",
    "Received",
    "Retarget",
    "Role",
    "Sampled",
    "Scene",
    "SelfTest",
    "Session",
    "Stats",
    "Status",
    "Take",
    "TakeInfo",
    "__version__",
    "animate",
    "self_test",
    "stream",
]
