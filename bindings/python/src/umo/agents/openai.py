"""Feeds an `Avatar` with audio of OpenAI's Realtime API and compatible servers.

    async with umo.agents.Avatar(rate=24000) as avatar:
        speech = umo.agents.openai.RealtimeAudio(avatar)

        async def listen():
            async for event in connection:              # from the package `openai`, or dicts from a WebSocket
                for answer in speech.take(event):
                    await connection.send(answer)

        asyncio.create_task(listen())
        async for pose in avatar: ...

No package is required: an event is a dict, JSON text, or an object of the package `openai`.
"""

from __future__ import annotations

import base64
import json
from typing import Any, Optional, Union

from ._avatar import Avatar, Interrupted

# Event names of the beta API, and of the released one.
_DELTA = ("response.audio.delta", "response.output_audio.delta")
_DONE = ("response.audio.done", "response.output_audio.done")

MOST = 64
"""Number of speeches remembered until they are heard."""


class RealtimeAudio:
    """Follows a connection's events: audio deltas are pushed, their end ends the speech, and a user who starts to speak
    interrupts it.

    The audio must be `pcm16` (`audio/pcm`, 24,000 samples a second). With `cuts` False, only `interrupt` and cancelled
    responses interrupt it.
    """

    def __init__(self, avatar: Avatar, *, cuts: bool = True) -> None:
        self._avatar = avatar
        self._cuts = cuts
        # Item and part on the server of each of the avatar's speeches. Interrupted ones still receive audio for a
        # while.
        self._speeches: dict[int, tuple[str, int]] = {}
        self._dropped: set[tuple[str, int]] = set()
        self._current: Optional[tuple[str, int]] = None
        self._responses: dict[str, set[tuple[str, int]]] = {}

    def take(self, event: Any) -> list[dict[str, Any]]:
        """Handles an event of the server, of any type. Returns events to send to the server: truncations of what was
        interrupted.
        """
        fields = _fields(event)
        kind = fields.get("type")
        if kind in _DELTA:
            self._push(fields)
        elif kind in _DONE:
            if self._place(fields) == self._current:
                self._end()
        elif kind == "response.done":
            self._response_done(fields.get("response") or {})
        elif kind == "input_audio_buffer.speech_started" and self._cuts:
            return self.interrupt()
        elif kind == "output_audio_buffer.cleared":
            # The server has truncated it already.
            self.interrupt()
        return []

    def interrupt(self) -> list[dict[str, Any]]:
        """Interrupts the speech: drops everything not spoken yet. Returns a `conversation.item.truncate` event for the
        server, which otherwise assumes that everything was heard, or nothing if nothing was interrupted."""
        cut = self._avatar.interrupt()
        place = None
        if cut is not None:
            place = self._speeches.get(cut.speech)
            # Queued audio must not be heard, nor audio of these items that still arrives.
            self._dropped.update(each for number, each in self._speeches.items() if number >= cut.speech)
        self._speeches.clear()
        self._current = None
        return [] if cut is None or place is None else [_truncate(place, cut)]

    def _push(self, fields: dict[str, Any]) -> None:
        place = self._place(fields)
        self._responses.setdefault(str(fields.get("response_id")), set()).add(place)
        if place in self._dropped:
            return
        try:
            data = base64.b64decode(fields["delta"], validate=True)
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{fields['type']}: expected PCM16 as base64 in `delta`") from None
        if place != self._current:
            self._end()
            self._current = place
        self._avatar.push(data)
        self._speeches[self._avatar.speeches - 1] = place
        while len(self._speeches) > MOST:
            del self._speeches[next(iter(self._speeches))]

    def _end(self) -> None:
        if self._current is not None:
            self._avatar.end()
            self._current = None

    def _response_done(self, response: dict[str, Any]) -> None:
        places = self._responses.pop(str(response.get("id")), set())
        if response.get("status") in ("cancelled", "failed", "incomplete") and self._current in places:
            # The `done` event of its audio may be missing. Received audio is spoken unless the user interrupted it.
            self._end()
        self._dropped -= places

    @staticmethod
    def _place(fields: dict[str, Any]) -> tuple[str, int]:
        if not isinstance(fields.get("item_id"), str):
            raise ValueError(f"{fields['type']}: expected an `item_id`")
        return fields["item_id"], int(fields.get("content_index") or 0)


def _truncate(place: tuple[str, int], cut: Interrupted) -> dict[str, Any]:
    item, part = place
    return {
        "type": "conversation.item.truncate",
        "item_id": item,
        "content_index": part,
        "audio_end_ms": int(cut.seconds * 1000),
    }


def _fields(event: Any) -> dict[str, Any]:
    if isinstance(event, (str, bytes)):
        event = json.loads(event)
    elif hasattr(event, "model_dump"):
        event = event.model_dump()
    if not isinstance(event, dict):
        raise TypeError(f"an event of {type(event).__name__}: expected a dict, JSON text or an object of the package openai")
    return event
