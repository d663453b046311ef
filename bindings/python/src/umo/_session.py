"""Sessions: one avatar each, audio in and frames out."""

from __future__ import annotations

import ctypes
from ctypes import byref
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Optional, TypeVar, Union, overload

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._generated import Attention, Idle, Latency, Received, Stats
from ._library import lib
from ._model import Model, default_model
from ._motion import Frame, Layout, Motion

if TYPE_CHECKING:
    from ._engine import Engine

Number = TypeVar("Number", int, float)


class Sampled(NamedTuple):
    """A pose at a time of the host's own, and which times there were to choose from."""

    frame: Frame
    is_ahead: bool
    """Whether the time asked for was later than the newest frame."""
    oldest: float
    """Seconds of the oldest frame that is still there."""
    newest: float
    """Seconds of the newest frame that is ready."""


class Parameter(Generic[Number]):
    """A setting that may change while a session runs: `session.gain_face = 0.5`, `Session.gain_face.maximum`."""

    def __init__(self, name: str, doc: str) -> None:
        self.name, self.__doc__ = name, doc
        self.id = _generated.PARAMETERS[name]
        info = next(info for info in _parameters() if info.id == self.id)
        self.minimum: float = info.minimum
        """Least value."""
        self.maximum: float = info.maximum
        """Largest value."""
        self.is_whole: bool = bool(info.flags & _generated.PARAMETER_WHOLE)
        """Whether only whole numbers are allowed."""

    @overload
    def __get__(self, session: None, owner: Any) -> Parameter[Number]: ...
    @overload
    def __get__(self, session: Session, owner: Any) -> Number: ...
    def __get__(self, session: Optional[Session], owner: Any) -> Any:
        if session is None:
            return self
        value = ctypes.c_double()
        session._check(lib.umo_session_get_parameter(session._handle, self.id, byref(value)))
        return int(value.value) if self.is_whole else value.value

    def __set__(self, session: Session, value: Number) -> None:
        session._check(lib.umo_session_set_parameter(session._handle, self.id, value))


def _parameters() -> list[Any]:
    """What the library says of every parameter."""
    found: list[Any] = []
    while True:
        info = _generated.ParameterInfo(struct_size=ctypes.sizeof(_generated.ParameterInfo))
        status = lib.umo_parameter_get_info(len(found), info)
        if status == _generated.Status.INVALID_ARGUMENT:
            return found
        _library.check(status)
        found.append(info)


class Session(_library.Handle):
    """One avatar. One thread pushes, one pulls or samples, any sets: all at once, if you like.

    `rate` and `channels` are those of the audio; `axes` of the frames: `"gltf"` (and Godot), `"unreal"` or `"unity"`. `target`
    is how many keyframes are predicted per chunk, `lookahead` how many frames are held back for smoother seams; `idle_after`
    and `ease` are seconds; `queue` is how many frames may wait to be pulled. `template` is one of the model's templates:
    `"text_to_motion"` needs no audio. With the `voice` `"live"` the mouth moves as the sound is heard and the body follows, for models
    that have a mouth network (`Model.has_mouth`); `"delayed"` keeps them in step. `smoothing` is the low-pass of the body's motion,
    standard deviation in frames, 0 to 1.5; `guidance` how strongly the prompt steers, 1 to 3, and `horizon` how many keyframes of
    speech it hears ahead, with models that can. With `packets` chunks are given to `pull_packets` for `Decoder`s elsewhere,
    `"beside_frames"` or `"only"`; each says `packet_history` keyframes again. What is None is the model's default.
    """

    temperature = Parameter[float]("temperature", "How freely codes are drawn: 0 takes the likeliest always.")
    top_k = Parameter[int]("top_k", "Only this many of the likeliest codes are drawn from; 0 is all.")
    top_p = Parameter[float]("top_p", "Only the likeliest codes that together reach this probability are drawn from.")
    idle = Parameter[int]("idle", "What is shown while no audio comes: one of `Idle`.")
    attention = Parameter[int]("attention", "What the avatar attends to: one of `Attention`.")
    output_delay = Parameter[float](
        "output_delay", "The output device's own delay, seconds: `sample` shows the pose of so much earlier. Some 0.2 by Bluetooth."
    )
    gain_face = Parameter[float]("gain_face", "How much the face moves: 0 at rest, 1 as computed, 2 exaggerated.")
    gain_hands = Parameter[float]("gain_hands", "How much the fingers move.")
    gain_upper = Parameter[float]("gain_upper", "How much spine, neck, head and arms move.")
    gain_lower = Parameter[float]("gain_lower", "How much pelvis and legs move, and the body through the world.")
    layer_gaze = Parameter[float]("layer_gaze", "Strength of blinks, gaze and lids over the model's motion, 0 to 1.")
    layer_idle = Parameter[float]("layer_idle", "Strength of breath, sway, weight shifts and fingers.")
    layer_asymmetry = Parameter[float]("layer_asymmetry", "Strength of the differences between the face's left and right.")
    layer_nods = Parameter[float]("layer_nods", "Strength of nods on accents, and while listening.")
    layer_mood = Parameter[float]("layer_mood", "Strength of the mood's face and posture.")
    layer_feet = Parameter[float]("layer_feet", "Strength of planted feet, steps, and the root's way back.")

    def __init__(
        self,
        engine: Engine,
        rate: Optional[int] = None,
        channels: int = 1,
        *,
        axes: str = "gltf",
        seed: Optional[int] = None,
        target: Optional[int] = None,
        lookahead: Optional[int] = None,
        idle: Optional[Idle] = None,
        idle_after: Optional[float] = None,
        ease: Optional[float] = None,
        queue: Optional[int] = None,
        template: Optional[str] = None,
        voice: Optional[str] = None,
        smoothing: Optional[float] = None,
        guidance: Optional[float] = None,
        horizon: Optional[int] = None,
        packets: Optional[str] = None,
        packet_history: Optional[int] = None,
    ) -> None:
        self._engine = engine
        config, handle = _generated.SessionConfig(), ctypes.c_void_p()
        _library.check(lib.umo_session_config_init(config, ctypes.sizeof(config), engine.model._handle))
        _library.set_values(config, sample_rate=rate, channels=channels, target=target, lookahead=lookahead, seed=seed)
        _library.set_values(config, packets=packets, packet_history=packet_history, voice=voice)
        _library.set_values(config, idle=idle, queue_frames=queue, idle_after_ms=idle_after, ease_ms=ease)
        _library.set_values(config, smoothing=smoothing, guidance=guidance, horizon=horizon)
        _library.set_fields(config, template_name=None if template is None else template.encode())
        self._layout = Layout(engine.model, axes)
        _library.check(lib.umo_session_new(engine._handle, config, byref(handle)))
        super().__init__(handle.value or 0, lib.umo_session_free)
        self._rate, self._channels, self._axes = int(config.sample_rate), channels, _generated.AXES[axes]

    def _check(self, status: int) -> None:
        _library.check_session(self._handle, status)

    @classmethod
    def parameters(cls) -> dict[str, Parameter[Any]]:
        """Every parameter by its name, with its range."""
        return {name: value for name, value in vars(Session).items() if isinstance(value, Parameter)}

    @property
    def engine(self) -> Engine:
        """Who computes it."""
        return self._engine

    @property
    def rate(self) -> int:
        """Samples per second of the audio that is pushed."""
        return self._rate

    @property
    def channels(self) -> int:
        """Channels of the audio that is pushed."""
        return self._channels

    def push(self, samples: npt.ArrayLike) -> int:
        """Takes audio to speak: [samples] interleaved or [samples, channels]; floats of full scale 1, or int16.

        How many rows of `samples` there was room for: push `samples[taken:]` again later.
        """
        array = audio(samples)
        if array.ndim == 2 and array.shape[1] != self._channels:
            what = f"audio of shape {array.shape}: expected [samples, {self._channels}], the session's channels"
            raise ValueError(f"{what}. {channels_first(array)}" if array.shape[0] == self._channels else what)
        taken = ctypes.c_size_t()
        push = lib.umo_session_push_audio_i16 if array.dtype == np.int16 else lib.umo_session_push_audio
        self._check(push(self._handle, array.ctypes.data, array.size, byref(taken)))
        return taken.value // array.shape[1] if array.ndim == 2 else taken.value

    def push_other(self, samples: npt.ArrayLike) -> None:
        """Takes audio of who speaks to the avatar, in the session's rate and channels, so that it listens.

        [samples] interleaved or [samples, channels]; floats of full scale 1, or int16.
        """
        array = audio(samples)
        if array.dtype == np.int16:
            array = array.astype(np.float32) / 32768
        self._check(lib.umo_session_push_other_audio(self._handle, array.ctypes.data, array.size))

    def finish(self) -> None:
        """No more audio: the tail is completed, and floor(seconds * 30) frames come out in all."""
        self._check(lib.umo_session_finish(self._handle))

    def interrupt(self, ease: float = 0.2) -> None:
        """Drops everything that is not shown yet and eases to rest within `ease` seconds. What is pushed then follows."""
        ms = _library.fitting("ease", round(ease * 1e3), ctypes.c_uint32)
        self._check(lib.umo_session_interrupt(self._handle, ms))

    def reset(self) -> None:
        """Back to the start: what follows is what a new session gives."""
        self._check(lib.umo_session_reset(self._handle))

    @property
    def ready(self) -> int:
        """How many frames `pull` would give."""
        count = ctypes.c_size_t()
        self._check(lib.umo_session_ready_frames(self._handle, byref(count)))
        return count.value

    @property
    def is_done(self) -> bool:
        """Whether `finish` was called and every frame was handed out."""
        done = ctypes.c_uint32()
        self._check(lib.umo_session_is_done(self._handle, byref(done)))
        return done.value != 0

    def save(self) -> bytes:
        """Everything that the session is, to be restored in this or another process; `umo.Error` while another thread is in a call."""
        size = ctypes.c_size_t()
        self._check(lib.umo_session_state_size(self._handle, byref(size)))
        state = ctypes.create_string_buffer(size.value)
        self._check(lib.umo_session_save(self._handle, state, size, byref(size)))
        return state.raw[: size.value]

    def restore(self, state: bytes) -> None:
        """Makes the session what it was when `state` was saved, by it or by one of the same model and configuration."""
        self._check(lib.umo_session_restore(self._handle, bytes(state), len(state)))

    def pull(self, most: Optional[int] = None) -> Motion:
        """The frames that are ready, in order, each once, `most` of them at most. Does not wait: there may be none."""
        # Room for one where none is ready: the call then says why none will come.
        frames = self._layout.empty(max(self.ready, 1) if most is None else most)
        count = ctypes.c_size_t()
        layout, data = byref(self._layout.raw), frames.ctypes.data
        self._check(lib.umo_session_pull_frames(self._handle, layout, data, frames.nbytes, byref(count)))
        return self._layout.motion(frames[: count.value])

    def pull_packets(self) -> list[bytes]:
        """The packets that are ready, in order, each once, of a session made with `packets`: to be sent to `Decoder`s as they are."""
        size, count, lengths = ctypes.c_size_t(), ctypes.c_size_t(), (ctypes.c_size_t * 16)()
        self._check(lib.umo_session_packet_size(self._handle, byref(size)))
        room = ctypes.create_string_buffer(max(len(lengths) * size.value, 1))
        packets: list[bytes] = []
        while True:
            self._check(lib.umo_session_pull_packets(self._handle, room, len(room), lengths, len(lengths), byref(count)))
            at = 0
            for length in lengths[: count.value]:
                packets.append(room.raw[at : at + length])
                at += length
            if count.value < len(lengths):
                return packets

    def set_clock(self, seconds: float) -> None:
        """What time it is for the host, from any moment on: what moves while no frames come goes by it from then on."""
        self._check(lib.umo_session_set_clock(self._handle, seconds))

    def sample(self, seconds: float) -> Sampled:
        """The pose at `seconds` of the motion, for a renderer at a rate of its own. Frames before that time are taken."""
        frames, sampled = self._layout.empty(1), _generated.Sampled(struct_size=ctypes.sizeof(_generated.Sampled))
        layout, data = byref(self._layout.raw), frames.ctypes.data
        self._check(lib.umo_session_sample_pose(self._handle, seconds, layout, data, frames.nbytes, sampled))
        return Sampled(self._layout.motion(frames)[0], bool(sampled.is_ahead), sampled.oldest, sampled.newest)

    def set_prompt(self, prompt: Union[str, npt.ArrayLike]) -> None:
        """What the avatar is told, from the next chunk on: a text, or ids of `Model.encode_text`. Nothing ends it."""
        if isinstance(prompt, str):
            text = prompt.encode()
            self._check(lib.umo_session_set_prompt(self._handle, text, len(text)))
        else:
            ids = np.ascontiguousarray(prompt, np.uint32)
            pointer = ids.ctypes.data_as(ctypes.POINTER(ctypes.c_uint32))
            self._check(lib.umo_session_set_prompt_ids(self._handle, pointer, ids.size))

    def set_seed(self, seed: int) -> None:
        """The seed of draws from the next chunk on."""
        self._check(lib.umo_session_set_seed(self._handle, _library.fitting("seed", seed, ctypes.c_uint64)))

    def look_at(self, point: npt.ArrayLike, strength: float = 1.0) -> None:
        """Looks at a point in the avatar's space, in the session's axes and units; a strength of 0 ends it."""
        place = np.ascontiguousarray(point, np.float32)
        if place.shape != (3,):
            raise ValueError(f"a point of shape {place.shape}: expected 3 coordinates")
        pointer = place.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        self._check(lib.umo_session_look_at(self._handle, self._axes, pointer, strength))

    def set_mood(self, mood: str, strength: float = 1.0) -> None:
        """The mood of face and posture: `neutral`, `joy`, `sad`, `angry`, `surprised`, `disgusted` or `afraid`."""
        number = _library.chosen("mood", _generated.MOODS, mood)
        self._check(lib.umo_session_set_mood(self._handle, number, strength))

    def hint_lips(self, shape: str, start: float, duration: float) -> None:
        """Says that a sound is heard that one sees on the lips: `closed` for p, b and m, `teeth` for f and v, `round` for w.

        `start` and `duration` are seconds of the audio that was pushed since the session began or was reset. `umo.lips` makes hints
        of the times that synthesisers give.
        """
        number = _library.chosen("shape", _generated.LIPS, shape)
        self._check(lib.umo_session_hint_lips(self._handle, number, start, duration))

    def play_gesture(
        self,
        name: str,
        *,
        at: Optional[float] = None,
        speed: float = 1.0,
        strength: float = 1.0,
        side: str = "auto",
        target: Optional[npt.ArrayLike] = None,
    ) -> None:
        """Plays a gesture over what the model does: one of `Engine.gestures`.

        `at` is the time of the motion at which its stroke falls, seconds; None is as soon as possible. `side` is `"auto"`, `"left"`,
        `"right"` or `"both"`; `target` is the place to point at, in the session's axes and units.
        """
        options = _generated.GestureOptions()
        _library.check(lib.umo_gesture_options_init(options, ctypes.sizeof(options)))
        options.side = _library.chosen("side", _generated.SIDES, side)
        options.at = -1.0 if at is None else at
        options.speed, options.strength, options.axes = speed, strength, self._axes
        if target is not None:
            place = np.asarray(target, np.float32)
            if place.shape != (3,):
                raise ValueError(f"a target of shape {place.shape}: expected 3 coordinates")
            options.has_target, options.target = 1, tuple(float(value) for value in place)
        if "\0" in name:
            raise ValueError("a gesture's name has no zero bytes")
        self._check(lib.umo_session_play_gesture(self._handle, name.encode(), options))

    def latency(self) -> Latency:
        """How far motion is behind speech."""
        raw = _generated.RawLatency(struct_size=ctypes.sizeof(_generated.RawLatency))
        self._check(lib.umo_session_latency(self._handle, raw))
        return Latency(*(getattr(raw, name) for name in Latency._fields))

    def stats(self) -> Stats:
        """What the session went through so far."""
        raw = _generated.RawStats(struct_size=ctypes.sizeof(_generated.RawStats))
        self._check(lib.umo_session_stats(self._handle, raw))
        return Stats(*(getattr(raw, name) for name in Stats._fields))


def audio(samples: npt.ArrayLike) -> npt.NDArray[Any]:
    """Samples as the library takes them: float32 or int16, without gaps."""
    array = np.asarray(samples)
    if array.dtype != np.int16:
        if array.dtype.kind != "f":
            raise TypeError(f"audio of {array.dtype}: expected floats of full scale 1, or int16")
        array = array.astype(np.float32, copy=False)
    if array.ndim not in (1, 2):
        raise ValueError(f"audio of shape {array.shape}: expected [samples] or [samples, channels]")
    if array.ndim == 2 and not 1 <= array.shape[1] <= _library.MAX_CHANNELS:
        expected = f"[samples] or [samples, channels] with 1 to {_library.MAX_CHANNELS} channels"
        what = f"audio of shape {array.shape}: expected {expected}"
        raise ValueError(f"{what}. {channels_first(array)}" if 1 <= array.shape[0] <= _library.MAX_CHANNELS else what)
    return np.ascontiguousarray(array)


def channels_first(array: npt.NDArray[Any]) -> str:
    """What to do with audio of shape [channels, samples]."""
    # The mean of int16 samples would be floats that are not of full scale 1.
    mono = "audio.mean(axis=0).astype(np.int16)" if array.dtype == np.int16 else "audio.mean(axis=0)"
    return f"If channels come first in it, pass audio.T for all of them or {mono} for mono"


class Decoder(Session):
    """An avatar whose frames come of packets, where it is seen: `push_packet` takes the place of `push`, all else is a session's.

    It needs no engine. The model is the sender's file at the same precision; `target`, `lookahead` and `smoothing` are the sender's.
    `patience` is how many packets may come before one that is missing counts as lost, 0 to 4.
    """

    def __init__(
        self,
        model: Optional[Model] = None,
        *,
        axes: str = "gltf",
        seed: Optional[int] = None,
        target: Optional[int] = None,
        lookahead: Optional[int] = None,
        smoothing: Optional[float] = None,
        patience: Optional[int] = None,
        idle: Optional[Idle] = None,
        idle_after: Optional[float] = None,
        ease: Optional[float] = None,
        queue: Optional[int] = None,
    ) -> None:
        self._model = model or default_model()
        config, handle = _generated.SessionConfig(), ctypes.c_void_p()
        _library.check(lib.umo_session_config_init(config, ctypes.sizeof(config), self._model._handle))
        _library.set_values(config, target=target, lookahead=lookahead, seed=seed, smoothing=smoothing, patience=patience)
        _library.set_values(config, idle=idle, queue_frames=queue, idle_after_ms=idle_after, ease_ms=ease)
        self._layout = Layout(self._model, axes)
        _library.check(lib.umo_decoder_new(self._model._handle, config, byref(handle)))
        _library.Handle.__init__(self, handle.value or 0, lib.umo_session_free)
        self._rate, self._channels, self._axes = int(config.sample_rate), 1, _generated.AXES[axes]

    @property
    def model(self) -> Model:
        """What it decodes with."""
        return self._model

    @property
    def engine(self) -> Engine:
        """A decoder has none: this raises."""
        raise AttributeError("a decoder has no engine: it computes where packets are pushed")

    def push_packet(self, packet: bytes) -> None:
        """Takes a packet of `Session.pull_packets`, in any order and any number of times.

        What is no packet for this decoder is `umo.Error` with `Status.PACKET` and changes nothing; with `Status.BUSY` the queue is
        full: pull or sample, then push it again.
        """
        self._check(lib.umo_decoder_push_packet(self._handle, bytes(packet), len(packet)))

    @property
    def received(self) -> Received:
        """What came of the packets so far."""
        stats = _generated.RawReceived(struct_size=ctypes.sizeof(_generated.RawReceived))
        self._check(lib.umo_decoder_stats(self._handle, stats))
        return Received(*(int(getattr(stats, name)) for name in Received._fields))
