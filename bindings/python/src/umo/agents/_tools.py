"""Gestures, moods and looks as tools for a language model."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from typing import Any, Optional, Union

import numpy.typing as npt

from .._generated import MOODS, SIDES, Attention
from .._library import Error, chosen
from .._session import Session
from ._avatar import Avatar

MOST_SECONDS = 600.0
"""Maximum duration of a mood with a time limit."""

_LOOKS = {attention.name.lower(): attention for attention in Attention}
_STYLES: dict[str, Callable[[str, str, dict[str, Any]], dict[str, Any]]] = {
    "openai": lambda name, text, parameters: {
        "type": "function",
        "function": {"name": name, "description": text, "parameters": parameters},
    },
    "responses": lambda name, text, parameters: {
        "type": "function",
        "name": name,
        "description": text,
        "parameters": parameters,
    },
    "anthropic": lambda name, text, parameters: {"name": name, "description": text, "input_schema": parameters},
}


class Tools:
    """Lets a language model move an avatar: `definitions` go into the model's request, `call` executes the model's tool
    calls.

    The names of gestures, moods and looks are the library's at the time of the call, including gestures added to the
    engine. `places` are points to look and point at, by name, in the session's axes and units.
    """

    def __init__(self, avatar: Union[Avatar, Session], places: Mapping[str, npt.ArrayLike] = {}) -> None:
        for name in places:
            if name in _LOOKS:
                raise ValueError(f"place {name!r}: a look has this name; choose another one")
        self._avatar, self._places = avatar, dict(places)
        self._end_of_mood: Optional[threading.Timer] = None
        self._calls: dict[str, Callable[..., None]] = {
            "avatar_gesture": self._gesture,
            "avatar_mood": self._mood,
            "avatar_look": self._look,
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the tools, for hosts with additional tools."""
        return tuple(self._calls)

    def definitions(self, style: str = "openai") -> list[dict[str, Any]]:
        """The tools as JSON: `"openai"` for Chat Completions and compatible servers, `"responses"` for OpenAI's
        Responses and Realtime, `"anthropic"` for Anthropic's Messages. For other protocols, take the JSON Schemas
        out of these.
        """
        if style not in _STYLES:
            raise ValueError(f"style {style!r}: expected one of {', '.join(_STYLES)}")
        strength = {"type": "number", "minimum": 0, "maximum": 1, "description": "How strong; 1 where not given."}
        gesture: dict[str, Any] = {
            "gesture": {"type": "string", "enum": list(self._session.engine.gestures)},
            "side": {"type": "string", "enum": list(SIDES), "description": "The hand; auto where not given."},
            "strength": strength,
        }
        if self._places:
            gesture["place"] = {"type": "string", "enum": list(self._places), "description": "Where to point, for gestures that point."}
        mood = {
            "mood": {"type": "string", "enum": list(MOODS)},
            "strength": strength,
            "seconds": {
                "type": "number",
                "exclusiveMinimum": 0,
                "maximum": MOST_SECONDS,
                "description": "How long, until it is neutral again; until the next call where not given.",
            },
        }
        look = {"look": {"type": "string", "enum": [*_LOOKS, *self._places]}}
        texts = {
            "avatar_gesture": ("Plays a gesture of your body once, while you speak or not.", gesture, "gesture"),
            "avatar_mood": ("Sets the mood of your face and posture.", mood, "mood"),
            "avatar_look": (
                "Where you look: at a place, or as somebody who listens, thinks or speaks. auto follows the talk.",
                look,
                "look",
            ),
        }
        made = _STYLES[style]
        return [
            made(
                name,
                text,
                {"type": "object", "properties": properties, "required": [needed], "additionalProperties": False},
            )
            for name, (text, properties, needed) in texts.items()
        ]

    def call(self, name: str, arguments: Union[str, Mapping[str, Any]]) -> str:
        """Executes a call: `arguments` are a mapping, or JSON text as some services send. Returns the result for the
        model: `done`, or what was wrong with the call, so that the model can correct it.

        Raises `LookupError` for a tool that is not among `names`. Never waits.
        """
        if name not in self._calls:
            raise LookupError(f"tool {name!r}: expected one of {', '.join(self._calls)}")
        try:
            given = json.loads(arguments or "{}") if isinstance(arguments, str) else dict(arguments)
            if not isinstance(given, dict):
                raise ValueError("expected an object of arguments")
            self._calls[name](**self._checked(name, given))
        except (ValueError, Error) as error:
            return f"error: {error}"
        return "done"

    @property
    def _session(self) -> Session:
        return self._avatar if isinstance(self._avatar, Session) else self._avatar.session

    def _checked(self, name: str, given: dict[str, Any]) -> dict[str, Any]:
        """The arguments, checked against the types and ranges of the tool's definition."""
        definition = next(found for found in self.definitions("anthropic") if found["name"] == name)["input_schema"]
        for argument in definition["required"]:
            if argument not in given:
                raise ValueError(f"{argument} is missing")
        for argument, value in given.items():
            schema = definition["properties"].get(argument)
            if schema is None:
                raise ValueError(f"unknown argument {argument!r}: expected {', '.join(definition['properties'])}")
            if schema["type"] == "string":
                if not isinstance(value, str):
                    raise ValueError(f"{argument}: expected a text")
                chosen(argument, dict.fromkeys(schema["enum"], 0), value)
                continue
            least = schema.get("minimum", schema.get("exclusiveMinimum"))
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not least <= value <= schema["maximum"] or value == schema.get("exclusiveMinimum"):
                raise ValueError(f"{argument} {value!r}: expected a number from {least} to {schema['maximum']}")
        return given

    def _gesture(self, gesture: str, side: str = "auto", strength: float = 1.0, place: Optional[str] = None) -> None:
        target = None if place is None else self._places[place]
        self._session.play_gesture(gesture, side=side, strength=strength, target=target)

    def _mood(self, mood: str, strength: float = 1.0, seconds: Optional[float] = None) -> None:
        self._session.set_mood(mood, strength)
        if self._end_of_mood is not None:
            self._end_of_mood.cancel()
            self._end_of_mood = None
        if seconds is not None:
            self._end_of_mood = threading.Timer(seconds, self._end_mood)
            self._end_of_mood.daemon = True
            self._end_of_mood.start()

    def _end_mood(self) -> None:
        try:
            self._session.set_mood("neutral")
        except (Error, ValueError):
            # The session was closed in the meantime.
            pass

    def _look(self, look: str) -> None:
        if look in self._places:
            self._session.look_at(self._places[look])
            return
        self._session.look_at((0, 0, 0), 0)
        self._session.attention = _LOOKS[look]
