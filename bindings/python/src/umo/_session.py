"""Sessions: one avatar each, audio in and frames out."""

from __future__ import annotations

import ctypes
import warnings
from ctypes import byref
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Optional, TypeVar, Union, overload

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._generated import Attention, Idle, Latency, Received, Stats
from ._library import lib
from ._model import Model, default_model
from ._motion import Frame, Layout, Motion
from ._take import Take

if TYPE_CHECKING:
    from ._engine import Engine

Number = TypeVar("Number", int, float)


class Sampled(NamedTuple):
    """A pose at a time chosen by the host, and the range of available times."""

    frame: Frame
    is_ahead: bool
    """Whether the requested time was later than the newest frame."""
    oldest: float
    """Time of the oldest kept frame, seconds."""
    newest: float
    """Time of the newest ready frame, seconds."""


class Parameter(Generic[Number]):
    """A setting that can change while a session runs: `session.gain_face = 0.5`, `Session.gain_face.maximum`."""

    def __init__(self, name: str, doc: str) -> None:
        self.name, self.__doc__ = name, doc
        self.id = _generated.PARAMETERS[name]
        info = next(info for info in _parameters() if info.id == self.id)
        self.minimum: float = info.minimum
        """Minimum value."""
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
    """The library's description of every parameter."""
    found: list[Any] = []
    while True:
        info = _generated.ParameterInfo(struct_size=ctypes.sizeof(_generated.ParameterInfo))
        status = lib.umo_parameter_get_info(len(found), info)
        if status == _generated.Status.INVALID_ARGUMENT:
            return found
        _library.check(status)
        found.append(info)


class Session(_library.Handle):
    """One avatar. One thread may push, one pull or sample, and any set parameters, all concurrently.

    `rate` and `channels` describe the audio, `axes` the frames: `"gltf"` (and Godot), `"unreal"` or
    `"unity"`. `target` is the number of keyframes per chunk, `lookahead` the number of frames held back for smoother
    seams; `idle_after` and `ease` are seconds; `queue` is the maximum number of frames waiting to be pulled. `template`
    is one of the model's templates: `"text_to_motion"` needs no audio. With the `voice` `"live"` the mouth moves as
    the sound is heard and the body follows, for models with a mouth network (`Model.has_mouth`); with `"mouth"` it
    moves over a body at rest, for which nothing is computed; `"delayed"` keeps them in sync. `smoothing` is the
    low-pass filter of the body's motion, standard deviation in frames, 0 to 1.5; `guidance` the strength of the
    prompt, 1 to 3, and `horizon` the number of keyframes of future speech, for models that support them. With
    `packets` (`"beside_frames"` or `"only"`) chunks are output to `pull_packets` for remote `Decoder`s; each packet
    repeats `packet_history` keyframes. `take_bytes` is the memory of a take that is recorded (`take`), some 700
    bytes a second. None stands for the model's default.
    """

    temperature = Parameter[float]("temperature", "Sampling temperature: 0 always takes the most probable code.")
    top_k = Parameter[int]("top_k", "Number of most probable codes to sample from; 0 is all.")
    top_p = Parameter[float]("top_p", "Cumulative probability of the most probable codes to sample from.")
    idle = Parameter[int]("idle", "Behaviour while no audio arrives: one of `Idle`.")
    attention = Parameter[int]("attention", "Focus of attention: one of `Attention`.")
    output_delay = Parameter[float](
        "output_delay", "Latency of the output device in seconds, which `sample` compensates. About 0.2 for Bluetooth."
    )
    activity = Parameter[float]("activity", "How often hands leave rest, 0 to 1; 0.5 is as people do.")
    expression = Parameter[float](
        "expression", "How far body and face follow the arousal of the voice, 0 to 1; 0 ignores the voice."
    )
    gain_face = Parameter[float]("gain_face", "Amount of face motion: 0 at rest, 1 as computed, 2 exaggerated.")
    gain_hands = Parameter[float]("gain_hands", "Amount of finger motion.")
    gain_upper = Parameter[float]("gain_upper", "Amount of motion of spine, neck, head and arms.")
    gain_lower = Parameter[float]("gain_lower", "Amount of motion of pelvis and legs, and of the body through the world.")
    layer_gaze = Parameter[float]("layer_gaze", "Strength of blinks, gaze and lids over the model's motion, 0 to 1.")
    layer_idle = Parameter[float]("layer_idle", "Strength of breath, sway, weight shifts and fingers, and of hands at rest.")
    layer_asymmetry = Parameter[float]("layer_asymmetry", "Strength of the differences between the face's left and right.")
    layer_nods = Parameter[float]("layer_nods", "Strength of nods on accents, and while listening.")
    layer_mood = Parameter[float]("layer_mood", "Strength of the mood's face and posture.")
    layer_feet = Parameter[float]("layer_feet", "Strength of planted feet, steps, and the root's return.")
    layer_body = Parameter[float]("layer_body", "Strength of trunk, shoulders and legs that go with the hands.")

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
        take_bytes: Optional[int] = None,
    ) -> None:
        self._engine = engine
        config, handle = _generated.SessionConfig(), ctypes.c_void_p()
        _library.check(lib.umo_session_config_init(config, ctypes.sizeof(config), engine.model._handle))
        _library.set_values(config, sample_rate=rate, channels=channels, target=target, lookahead=lookahead, seed=seed)
        _library.set_values(config, packets=packets, packet_history=packet_history, take_bytes=take_bytes, voice=voice)
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
        """All parameters by name, with their ranges."""
        return {name: value for name, value in vars(Session).items() if isinstance(value, Parameter)}

    @property
    def engine(self) -> Engine:
        """The engine that computes it."""
        return self._engine

    @property
    def rate(self) -> int:
        """Sample rate of the pushed audio."""
        return self._rate

    @property
    def channels(self) -> int:
        """Channels of the pushed audio."""
        return self._channels

    def push(self, samples: npt.ArrayLike) -> int:
        """Pushes audio to speak: [samples] interleaved or [samples, channels]; floats of full scale 1, or int16.

        Returns the number of rows of `samples` taken: push `samples[taken:]` again later.
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
        """Pushes the interlocutor's audio, at the session's rate and channels, so that the avatar listens.

        [samples] interleaved or [samples, channels]; floats of full scale 1, or int16.
        """
        array = audio(samples)
        if array.dtype == np.int16:
            array = array.astype(np.float32) / 32768
        self._check(lib.umo_session_push_other_audio(self._handle, array.ctypes.data, array.size))

    def finish(self) -> None:
        """Ends the audio: the rest is computed, and floor(seconds * 30) frames result in all."""
        self._check(lib.umo_session_finish(self._handle))

    def interrupt(self, ease: float = 0.2) -> None:
        """Drops everything not shown yet and eases to rest within `ease` seconds. Audio pushed afterwards follows."""
        ms = _library.fitting("ease", round(ease * 1e3), ctypes.c_uint32)
        self._check(lib.umo_session_interrupt(self._handle, ms))

    def reset(self) -> None:
        """Returns to the initial state, as a new session."""
        self._check(lib.umo_session_reset(self._handle))

    @property
    def ready(self) -> int:
        """Number of frames that `pull` would return."""
        count = ctypes.c_size_t()
        self._check(lib.umo_session_ready_frames(self._handle, byref(count)))
        return count.value

    @property
    def arousal(self) -> float:
        """Arousal of the voice at the newest frame pulled or sampled, 0 to 1; 0.5 for an ordinary voice, and for none."""
        arousal = ctypes.c_float()
        self._check(lib.umo_session_arousal(self._handle, byref(arousal), None))
        return arousal.value

    @property
    def arousal_trend(self) -> float:
        """Change of the arousal per second, over the last seconds."""
        arousal, trend = ctypes.c_float(), ctypes.c_float()
        self._check(lib.umo_session_arousal(self._handle, byref(arousal), byref(trend)))
        return trend.value

    @property
    def is_done(self) -> bool:
        """Whether `finish` was called and all frames were pulled."""
        done = ctypes.c_uint32()
        self._check(lib.umo_session_is_done(self._handle, byref(done)))
        return done.value != 0

    def save(self) -> bytes:
        """The complete state, to be restored in this or another process; raises `umo.Error` while another thread is in
        a call.
        """
        size = ctypes.c_size_t()
        self._check(lib.umo_session_state_size(self._handle, byref(size)))
        state = ctypes.create_string_buffer(size.value)
        self._check(lib.umo_session_save(self._handle, state, size, byref(size)))
        return state.raw[: size.value]

    def restore(self, state: bytes) -> None:
        """Restores a state saved by this session or by one of the same model and configuration."""
        self._check(lib.umo_session_restore(self._handle, bytes(state), len(state)))

    def pull(self, most: Optional[int] = None) -> Motion:
        """Pulls up to `most` ready frames, in order, each once. Does not wait: the result may be empty."""
        # Space for at least one frame: the call then reports why none will arrive.
        frames = self._layout.empty(max(self.ready, 1) if most is None else most)
        count = ctypes.c_size_t()
        layout, data = byref(self._layout.raw), frames.ctypes.data
        self._check(lib.umo_session_pull_frames(self._handle, layout, data, frames.nbytes, byref(count)))
        return self._layout.motion(frames[: count.value])

    def pull_packets(self) -> list[bytes]:
        """Pulls the ready packets of a session created with `packets`, in order, each once, to be sent to `Decoder`s
        unchanged.
        """
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

    def take(self) -> Take:
        """The take of the frames shown so far, of a session created with `take_bytes`. It begins at the session's start
        or its last reset, and ends at an interrupt or where its memory ends.
        """
        size, written = ctypes.c_size_t(), ctypes.c_size_t()
        self._check(lib.umo_session_take_size(self._handle, byref(size)))
        room = ctypes.create_string_buffer(size.value)
        self._check(lib.umo_session_take(self._handle, room, len(room), byref(written)))
        return Take(room.raw[: written.value])

    def set_clock(self, seconds: float) -> None:
        """Sets the host's time, from any origin: layers and easing follow it while no frames arrive."""
        self._check(lib.umo_session_set_clock(self._handle, seconds))

    def sample(self, seconds: float) -> Sampled:
        """The pose at `seconds` of the motion, for a renderer at a rate of its own. Frames before that time are taken."""
        frames, sampled = self._layout.empty(1), _generated.Sampled(struct_size=ctypes.sizeof(_generated.Sampled))
        layout, data = byref(self._layout.raw), frames.ctypes.data
        self._check(lib.umo_session_sample_pose(self._handle, seconds, layout, data, frames.nbytes, sampled))
        return Sampled(self._layout.motion(frames)[0], bool(sampled.is_ahead), sampled.oldest, sampled.newest)

    def set_prompt(self, prompt: Union[str, npt.ArrayLike]) -> None:
        """Sets the prompt from the next chunk on: a text, or ids of `Model.encode_text`. An empty prompt removes it.

        A text that `Model.prompts` lacks brings a warning: its motion is chance.
        """
        if isinstance(prompt, str):
            text = prompt.encode()
            self._check(lib.umo_session_set_prompt(self._handle, text, len(text)))
            known = self._engine.model.prompts
            if prompt and known and prompt.strip().lower() not in map(str.lower, known):
                told = f"the model was not trained with the prompt {prompt!r}: its prompts are {', '.join(known)}"
                warnings.warn(told, stacklevel=2)
        else:
            ids = np.ascontiguousarray(prompt, np.uint32)
            pointer = ids.ctypes.data_as(ctypes.POINTER(ctypes.c_uint32))
            self._check(lib.umo_session_set_prompt_ids(self._handle, pointer, ids.size))

    def set_seed(self, seed: int) -> None:
        """Sets the random seed from the next chunk on."""
        self._check(lib.umo_session_set_seed(self._handle, _library.fitting("seed", seed, ctypes.c_uint64)))

    def look_at(self, point: npt.ArrayLike, strength: float = 1.0) -> None:
        """Looks at a point in the avatar's space, in the session's axes and units; a strength of 0 stops it."""
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
        """Schedules a visible lip shape for a sound: `closed` for p, b and m, `teeth` for f and v, `round` for w.

        `start` and `duration` are seconds of the audio pushed since the session was created or reset. `umo.lips`
        derives hints from the timings of synthesisers.
        """
        number = _library.chosen("shape", _generated.LIPS, shape)
        self._check(lib.umo_session_hint_lips(self._handle, number, start, duration))

    def hint_words(self, text: str, start: float, end: float) -> None:
        """Gives a word and its time, in seconds of the audio pushed since the session was created or reset.

        Several words share the time by their syllables; punctuation belongs to its word. By the engine's rules
        (`Engine.set_word_rules`) some become gestures, whose stroke falls on the stressed vowel.
        """
        if "\0" in text:
            raise ValueError("a word has no zero bytes")
        self._check(lib.umo_session_hint_words(self._handle, text.encode(), start, end))

    def play_gesture(
        self,
        name: str,
        *,
        at: Optional[float] = None,
        speed: float = 1.0,
        strength: float = 1.0,
        side: str = "auto",
        target: Optional[npt.ArrayLike] = None,
        variant: int = 0,
    ) -> None:
        """Plays a gesture over the model's motion: one of `Engine.gestures`.

        `at` is the motion time of its stroke in seconds; None is as soon as possible. `side` is `"auto"`, `"left"`,
        `"right"` or `"both"`; `target` is the point to point at, in the session's axes and units. `variant` 0 is the gesture
        as drawn; others, up to 255, differ a little.
        """
        options = _generated.GestureOptions()
        _library.check(lib.umo_gesture_options_init(options, ctypes.sizeof(options)))
        options.side = _library.chosen("side", _generated.SIDES, side)
        options.at = -1.0 if at is None else at
        options.speed, options.strength, options.axes = speed, strength, self._axes
        options.variant = _library.fitting("variant", variant, ctypes.c_uint32)
        if target is not None:
            place = np.asarray(target, np.float32)
            if place.shape != (3,):
                raise ValueError(f"a target of shape {place.shape}: expected 3 coordinates")
            options.has_target, options.target = 1, tuple(float(value) for value in place)
        if "\0" in name:
            raise ValueError("a gesture's name must not contain zero bytes")
        self._check(lib.umo_session_play_gesture(self._handle, name.encode(), options))

    def latency(self) -> Latency:
        """Delay of motion behind speech."""
        raw = _generated.RawLatency(struct_size=ctypes.sizeof(_generated.RawLatency))
        self._check(lib.umo_session_latency(self._handle, raw))
        return Latency(*(getattr(raw, name) for name in Latency._fields))

    def stats(self) -> Stats:
        """Counts of the session so far."""
        raw = _generated.RawStats(struct_size=ctypes.sizeof(_generated.RawStats))
        self._check(lib.umo_session_stats(self._handle, raw))
        return Stats(*(getattr(raw, name) for name in Stats._fields))


def audio(samples: npt.ArrayLike) -> npt.NDArray[Any]:
    """Converts samples for the library: contiguous float32 or int16."""
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
    """Advice for audio of shape [channels, samples]."""
    # The mean of int16 samples would be floats not of full scale 1.
    mono = "audio.mean(axis=0).astype(np.int16)" if array.dtype == np.int16 else "audio.mean(axis=0)"
    return f"If channels come first in it, pass audio.T for all of them or {mono} for mono"


class Decoder(Session):
    """An avatar that is animated by received packets: `push_packet` replaces `push`; everything else is as in a
    session.

    It needs no engine. The model must be the sender's file at the same precision; `target`, `lookahead` and `smoothing`
    must match the sender's. `reorder_window` is the number of later packets that may arrive before a missing one counts
    as lost, 0 to 4. With a `take`, the packets and these settings are the take's: call `push_take` in place of
    `push_packet`.
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
        reorder_window: Optional[int] = None,
        idle: Optional[Idle] = None,
        idle_after: Optional[float] = None,
        ease: Optional[float] = None,
        queue: Optional[int] = None,
        take: Optional[Take] = None,
    ) -> None:
        self._model = model or default_model()
        config, handle = _generated.SessionConfig(), ctypes.c_void_p()
        _library.check(lib.umo_session_config_init(config, ctypes.sizeof(config), self._model._handle))
        _library.set_values(config, target=target, lookahead=lookahead, seed=seed, smoothing=smoothing, reorder_window=reorder_window)
        _library.set_values(config, idle=idle, queue_frames=queue, idle_after_ms=idle_after, ease_ms=ease)
        self._layout = Layout(self._model, axes)
        if take is None:
            _library.check(lib.umo_decoder_new(self._model._handle, config, byref(handle)))
        else:
            _library.check(lib.umo_decoder_new_of_take(self._model._handle, take._handle, config, byref(handle)))
            config.sample_rate = take.info.sample_rate
        _library.Handle.__init__(self, handle.value or 0, lib.umo_session_free)
        self._rate, self._channels, self._axes = int(config.sample_rate), 1, _generated.AXES[axes]

    @property
    def model(self) -> Model:
        """The model that it decodes with."""
        return self._model

    @property
    def engine(self) -> Engine:
        """Raises: a decoder has no engine."""
        raise AttributeError("a decoder has no engine: it computes where packets are pushed")

    def push_packet(self, packet: bytes) -> None:
        """Pushes a packet of `Session.pull_packets`. Packets may arrive reordered or duplicated.

        An invalid packet raises `umo.Error` with `Status.PACKET` and changes nothing; with `Status.BUSY` the queue is
        full: pull or sample, then push it again.
        """
        self._check(lib.umo_decoder_push_packet(self._handle, bytes(packet), len(packet)))

    def push_take(self) -> bool:
        """Computes the frames of the take's next chunk, if the queue has room; returns whether there may be more. Call
        it before each pull or sample.
        """
        more = ctypes.c_uint32()
        self._check(lib.umo_decoder_push_take(self._handle, byref(more)))
        return bool(more.value)

    @property
    def received(self) -> Received:
        """Statistics of the packets so far."""
        stats = _generated.RawReceived(struct_size=ctypes.sizeof(_generated.RawReceived))
        self._check(lib.umo_decoder_stats(self._handle, stats))
        return Received(*(int(getattr(stats, name)) for name in Received._fields))
