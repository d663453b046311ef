"""A client of `umo serve`: sends speech to a server and receives frames or packets. Needs the extra `umo-avatar[serve]`.

    async with umo.serve.connect("ws://127.0.0.1:8765/v1/session", rate=16000) as avatar:
        await avatar.push(samples)
        await avatar.finish()
        async for frame in avatar:
            frame.index, frame.rotations, frame.face
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt
from websockets.asyncio.client import ClientConnection, connect as _connect
from websockets.exceptions import ConnectionClosed

from ._motion import Frame

PIECE = 32768
"""Maximum size in bytes of a message with audio or a state."""
MOST = 65536
"""Maximum size in bytes of a server message."""


class ServeError(Exception):
    """The server refused a session or ended it."""

    code: str
    """Error code: `"full"`, `"unauthorized"`, `"bad_request"` …; `"closed"` if the connection broke."""

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Saved(NamedTuple):
    """A session's state."""

    state: bytes
    """For `connect(…, state=…)`, on this server or another with the same model."""
    samples: int
    """Samples of this connection that the state includes: push the samples after them to the restored session."""


class Moved(ServeError):
    """The server is stopping and hands the session over."""

    saved: Saved
    """The session, to be continued elsewhere."""

    def __init__(self, saved: Saved) -> None:
        super().__init__("draining", "the server stops: restore the state elsewhere")
        self.saved = saved


class Avatar:
    """A session on a server. Iterating yields its frames, or its packets as bytes, until the speech is done."""

    ready: dict[str, Any]
    """The server's description of the session: model, face, latency_samples …"""
    done: Optional[dict[str, Any]]
    """The server's message at the end of the last speech."""
    saved: Optional[Saved]
    """The last state received, from `save`."""

    def __init__(self, socket: ClientConnection, ready: dict[str, Any]) -> None:
        self._socket = socket
        self.ready = ready
        self.done = None
        self.saved = None

    async def push(self, samples: npt.ArrayLike) -> None:
        """Sends mono samples: 16-bit integers, or floats of full scale 1."""
        array = np.asarray(samples)
        if array.ndim != 1:
            raise ValueError(f"samples must be one-dimensional, got the shape {array.shape}")
        if array.dtype != np.int16:
            if not np.issubdtype(array.dtype, np.floating):
                raise ValueError(f"samples must be floats or 16-bit integers, got {array.dtype}")
            array = np.clip(np.rint(array * 32768.0), -32768, 32767)
        data = array.astype("<i2").tobytes()
        for start in range(0, len(data), PIECE):
            await self._socket.send(data[start : start + PIECE])

    async def push_opus(self, packet: bytes) -> None:
        """Sends one Opus packet, as carried by RTP. The hello must have `audio="opus"`."""
        await self._socket.send(bytes(packet))

    async def lost(self, packets: int = 1) -> None:
        """Reports that packets before the next one were lost: the server conceals them."""
        await self._say(type="lost", packets=packets)

    async def finish(self) -> None:
        """Ends the speech: its last frames arrive, and iteration ends."""
        await self._say(type="finish")

    async def interrupt(self, ease: float = 0.2) -> None:
        """Drops unsent frames and eases to rest over `ease` seconds; audio pushed afterwards starts a new speech."""
        await self._say(type="interrupt", ease=ease)

    async def set_mood(self, mood: str, strength: float = 1.0) -> None:
        """Sets the mood: `"joy"`, `"sad"`, `"angry"`, `"surprised"`, `"disgusted"`, `"afraid"` or `"neutral"`."""
        await self._say(type="mood", mood=mood, strength=strength)

    async def set_place(self, x: float, z: float, degrees: float) -> None:
        """Moves in the room: x and z in metres, and degrees to the left of +Z."""
        await self._say(type="place", place=[x, z, degrees])

    async def play_gesture(self, name: str, **options: Any) -> None:
        """Plays a gesture over the motion; options are `at`, `speed`, `strength`, `side`, `target` and `variant`."""
        await self._say(type="gesture", name=name, **options)

    async def hint_words(self, text: str, start: float, end: float) -> None:
        """Gives a word and its time, in seconds of the audio sent since the session began: some become gestures."""
        await self._say(type="words", text=text, start=start, end=end)

    async def look_at(self, point: npt.ArrayLike, strength: float = 1.0) -> None:
        """Turns eyes, head and trunk to a point, in metres."""
        await self._say(type="look_at", point=np.asarray(point, float).tolist(), strength=strength)

    async def save(self) -> None:
        """Requests the session's state, which is stored in `saved` when iteration reaches it."""
        await self._say(type="save")

    async def _say(self, **message: Any) -> None:
        await self._socket.send(json.dumps(message))

    async def __aiter__(self) -> AsyncIterator[Union[Frame, bytes]]:
        try:
            while True:
                message = await self._socket.recv()
                if isinstance(message, str):
                    text = json.loads(message)
                    if text["type"] == "done":
                        self.done = text
                        return
                    await self._told(text)
                elif message[0] == 1:
                    for frame in self._frames(message):
                        yield frame
                elif message[0] == 2:
                    yield message[1:]
        except ConnectionClosed as error:
            raise ServeError("closed", str(error)) from None

    async def _told(self, text: dict[str, Any]) -> None:
        if text["type"] == "error":
            raise ServeError(text["code"], text["reason"])
        if text["type"] == "state":
            state = b""
            while len(state) < text["bytes"]:
                piece = await self._socket.recv()
                assert isinstance(piece, bytes)
                state += piece[1:]
            self.saved = Saved(state, text["samples"])
            if text["is_handover"]:
                raise Moved(self.saved)

    def _frames(self, message: bytes) -> list[Frame]:
        floats = int.from_bytes(message[4:8], "little")
        layout = np.dtype([("index", "<u8"), ("sample", "<u8"), ("floats", "<f4", (floats,))])
        bones = 4 * int(self.ready["joints"])
        return [
            Frame(
                index=int(frame["index"]),
                sample=int(frame["sample"]),
                time=int(frame["index"]) / float(self.ready["frame_rate"]),
                rotations=frame["floats"][:bones].reshape(-1, 4),
                translation=frame["floats"][bones : bones + 3],
                face=frame["floats"][bones + 3 :],
                visemes=None,
            )
            for frame in np.frombuffer(message, layout, offset=8)
        ]


class connect:
    """Opens a session: `async with connect(url, rate=…) as avatar`. Further arguments are fields of the server's hello."""

    def __init__(
        self, url: str, *, rate: int = 16000, token: Optional[str] = None, state: bytes = b"", **hello: Any
    ) -> None:
        self._url = url
        self._state = state
        self._hello = {"type": "hello", "rate": rate, **hello}
        if token is not None:
            self._hello["token"] = token
        if state:
            self._hello["restore"] = len(state)

    async def __aenter__(self) -> Avatar:
        # The server pings.
        self._socket = await _connect(self._url, max_size=MOST, ping_interval=None, compression=None)
        try:
            await self._socket.send(json.dumps(self._hello))
            for start in range(0, len(self._state), PIECE):
                await self._socket.send(self._state[start : start + PIECE])
            ready = json.loads(await self._socket.recv())
            if ready["type"] != "ready":
                raise ServeError(ready["code"], ready["reason"])
        except BaseException:
            await self._socket.close()
            raise
        return Avatar(self._socket, ready)

    async def __aexit__(
        self, kind: Optional[type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        await self._socket.close()
