// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Text;

namespace Umo
{
    /// <summary>
    /// One avatar. Only the constructor throws; every other call returns a status and, but for SetPrompt, PlayGesture and LastError,
    /// allocates nothing. Calls on a session that was disposed, on whatever thread, return <see cref="Status.InvalidHandle"/>.
    /// </summary>
    public sealed unsafe class Session : IDisposable
    {
        private readonly SessionHandle handle;

        public Session(Engine engine, SessionConfig? config = null, string template = null)
        {
            if (engine == null) throw new ArgumentNullException(nameof(engine));
            SessionConfig used = config ?? Defaults(engine.Model);
            IntPtr raw;
            fixed (byte* name = template == null ? null : Native.Bytes(template))
            {
                if (template != null) used.TemplateName = (IntPtr)name;
                UmoException.Check(Native.umo_session_new(engine.Raw, &used, &raw));
            }
            // An engine that the collector frees would end its sessions.
            Engine = engine;
            handle = new SessionHandle(raw);
        }

        private Session(IntPtr raw)
        {
            handle = new SessionHandle(raw);
        }

        /// <summary>
        /// An avatar whose frames come of packets, where it is seen: PushPacket takes the place of PushAudio, all else is a session's. It
        /// needs no engine. Model, Target, Lookahead and Smoothing are the sender's.
        /// </summary>
        public static Session Decoder(Model model, SessionConfig? config = null)
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            SessionConfig used = config ?? Defaults(model);
            IntPtr raw;
            UmoException.Check(Native.umo_decoder_new(model.Raw, &used, &raw));
            GC.KeepAlive(model);
            return new Session(raw);
        }

        /// <summary>What computes it; null for a decoder.</summary>
        public Engine Engine { get; }

        /// <summary>Bytes of the longest packet of a session that was made with Packets; else 0.</summary>
        public int PacketSize
        {
            get
            {
                UIntPtr size;
                Status status = Native.umo_session_packet_size(handle.Raw, &size);
                GC.KeepAlive(this);
                return status == Status.Ok ? (int)size : 0;
            }
        }

        /// <summary>Takes the next packet into bytes, of PacketSize at least, to be sent to decoders as it is; its length, or 0 where none is ready.</summary>
        public Status PullPacket(byte[] bytes, out int length)
        {
            length = 0;
            if (bytes == null) return Status.NullPointer;
            UIntPtr got = UIntPtr.Zero, count;
            Status status;
            byte none = 0;
            fixed (byte* first = bytes)
            {
                byte* room = bytes.Length == 0 ? &none : first;
                status = Native.umo_session_pull_packets(handle.Raw, room, (UIntPtr)bytes.Length, &got, (UIntPtr)1, &count);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok && count != UIntPtr.Zero) length = (int)got;
            return status;
        }

        /// <summary>Takes a packet, in any order and any number of times, of a decoder's sender.</summary>
        public Status PushPacket(byte[] packet, int length)
        {
            if (packet == null) return Status.NullPointer;
            if (length < 0 || length > packet.Length) return Status.InvalidArgument;
            Status status;
            byte none = 0;
            fixed (byte* first = packet)
            {
                status = Native.umo_decoder_push_packet(handle.Raw, packet.Length == 0 ? &none : first, (UIntPtr)length);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>What came of a decoder's packets.</summary>
        public Status GetReceived(out Received stats)
        {
            Received found = new Received { StructSize = (uint)sizeof(Received) };
            Status status = Native.umo_decoder_stats(handle.Raw, &found);
            GC.KeepAlive(this);
            stats = found;
            return status;
        }

        /// <summary>The model's own defaults: mono audio at the model's rate.</summary>
        public static SessionConfig Defaults(Model model)
        {
            SessionConfig config;
            UmoException.Check(Native.umo_session_config_init(&config, (UIntPtr)sizeof(SessionConfig), model.Raw));
            GC.KeepAlive(model);
            return config;
        }

        /// <summary>Takes interleaved samples, full scale 1: a whole number of channels. What was not taken is to be pushed again.</summary>
        public Status PushAudio(float[] samples, int start, int count, out int taken)
        {
            taken = 0;
            if (samples == null) return Status.NullPointer;
            if (start < 0 || count < 0 || start > samples.Length - count) return Status.InvalidArgument;
            UIntPtr got;
            Status status;
            // An array without elements has no address.
            float none = 0;
            fixed (float* first = samples)
            {
                status = Native.umo_session_push_audio(handle.Raw, count == 0 ? &none : first + start, (UIntPtr)count, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) taken = (int)got;
            return status;
        }

        /// <summary>The same for 16-bit samples.</summary>
        public Status PushAudio(short[] samples, int start, int count, out int taken)
        {
            taken = 0;
            if (samples == null) return Status.NullPointer;
            if (start < 0 || count < 0 || start > samples.Length - count) return Status.InvalidArgument;
            UIntPtr got;
            Status status;
            short none = 0;
            fixed (short* first = samples)
            {
                status = Native.umo_session_push_audio_i16(handle.Raw, count == 0 ? &none : first + start, (UIntPtr)count, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) taken = (int)got;
            return status;
        }

        /// <summary>Takes interleaved samples, full scale 1, of who speaks to the avatar, so that it listens.</summary>
        public Status PushOtherAudio(float[] samples, int start, int count)
        {
            if (samples == null) return Status.NullPointer;
            if (start < 0 || count < 0 || start > samples.Length - count) return Status.InvalidArgument;
            Status status;
            float none = 0;
            fixed (float* first = samples)
            {
                status = Native.umo_session_push_other_audio(handle.Raw, count == 0 ? &none : first + start, (UIntPtr)count);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>No more audio: the tail is completed.</summary>
        public Status Finish()
        {
            Status status = Native.umo_session_finish(handle.Raw);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Drops what is not shown yet and eases to rest.</summary>
        public Status Interrupt(uint easeMs)
        {
            Status status = Native.umo_session_interrupt(handle.Raw, easeMs);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Back to the start.</summary>
        public Status Reset()
        {
            Status status = Native.umo_session_reset(handle.Raw);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Takes frames that are ready, each once, as many as there is room for.</summary>
        public Status PullFrames(Frames frames, out int count)
        {
            count = 0;
            if (frames == null) return Status.NullPointer;
            FrameLayout layout = frames.Layout;
            UIntPtr got;
            Status status;
            fixed (ulong* first = frames.Words)
            {
                status = Native.umo_session_pull_frames(handle.Raw, &layout, first, (UIntPtr)(ulong)frames.Size, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) count = (int)got;
            return status;
        }

        /// <summary>How many frames PullFrames would give.</summary>
        public Status ReadyFrames(out int count)
        {
            UIntPtr got;
            Status status = Native.umo_session_ready_frames(handle.Raw, &got);
            GC.KeepAlive(this);
            count = status == Status.Ok ? (int)got : 0;
            return status;
        }

        /// <summary>Whether <see cref="Finish"/> was called and every frame was handed out; Failed or Closed where the rest will never come.</summary>
        public Status IsDone(out bool done)
        {
            uint got;
            Status status = Native.umo_session_is_done(handle.Raw, &got);
            GC.KeepAlive(this);
            done = status == Status.Ok && got != 0;
            return status;
        }

        /// <summary>What time it is for the host, in seconds: what moves while no frames come goes by it from then on.</summary>
        public Status SetClock(double seconds)
        {
            Status status = Native.umo_session_set_clock(handle.Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The pose at a time of the motion, into the first of <paramref name="frame"/>.</summary>
        public Status SamplePose(double seconds, Frames frame, out Sampled sampled)
        {
            sampled = default(Sampled);
            if (frame == null) return Status.NullPointer;
            FrameLayout layout = frame.Layout;
            Sampled found = default(Sampled);
            found.StructSize = (uint)sizeof(Sampled);
            Status status;
            fixed (ulong* first = frame.Words)
            {
                status = Native.umo_session_sample_pose(handle.Raw, seconds, &layout, first, (UIntPtr)(ulong)frame.Size, &found);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) sampled = found;
            return status;
        }

        /// <summary>What the avatar is told, from the next chunk on; an empty text ends it. Allocates.</summary>
        public Status SetPrompt(string text)
        {
            if (text == null) return Status.NullPointer;
            byte[] bytes = Native.Bytes(text);
            Status status;
            fixed (byte* first = bytes)
            {
                status = Native.umo_session_set_prompt(handle.Raw, first, (UIntPtr)(bytes.Length - 1));
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The same as ids, as <see cref="Model.EncodeText"/> gives them.</summary>
        public Status SetPromptIds(uint[] ids)
        {
            if (ids == null) return Status.NullPointer;
            Status status;
            uint none = 0;
            fixed (uint* first = ids)
            {
                status = Native.umo_session_set_prompt_ids(handle.Raw, ids.Length == 0 ? &none : first, (UIntPtr)ids.Length);
            }
            GC.KeepAlive(this);
            return status;
        }

        public Status SetSeed(ulong seed)
        {
            Status status = Native.umo_session_set_seed(handle.Raw, seed);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Looks at a point in the avatar's space from the next frame on; a strength of 0 ends it.</summary>
        public Status LookAt(Axes axes, float x, float y, float z, float strength)
        {
            float* point = stackalloc float[3];
            point[0] = x;
            point[1] = y;
            point[2] = z;
            Status status = Native.umo_session_look_at(handle.Raw, axes, point, strength);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The mood of face and posture from the next frame on; a strength of 0 to 1.</summary>
        public Status SetMood(Mood mood, float strength)
        {
            Status status = Native.umo_session_set_mood(handle.Raw, mood, strength);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>
        /// The lips have a sound's shape while it is heard, where a synthesiser says when that is: seconds of the audio that was
        /// pushed. Busy while 64 wait.
        /// </summary>
        public Status HintLips(LipShape shape, double start, double duration)
        {
            Status status = Native.umo_session_hint_lips(handle.Raw, shape, start, duration);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>How a gesture is played if nothing else is said: as soon as possible, at its own speed, whole.</summary>
        public static GestureOptions GestureDefaults
        {
            get
            {
                GestureOptions options;
                UmoException.Check(Native.umo_gesture_options_init(&options, (UIntPtr)sizeof(GestureOptions)));
                return options;
            }
        }

        /// <summary>Plays a gesture over what the model does: one of <see cref="Engine.GestureNames"/>. Allocates a name.</summary>
        public Status PlayGesture(string name, GestureOptions? options = null)
        {
            if (name == null) return Status.NullPointer;
            GestureOptions used = options ?? GestureDefaults;
            Status status;
            fixed (byte* text = Native.Bytes(name))
            {
                status = Native.umo_session_play_gesture(handle.Raw, text, &used);
            }
            GC.KeepAlive(this);
            return status;
        }

        public Status Set(Parameter parameter, double value)
        {
            Status status = Native.umo_session_set_parameter(handle.Raw, parameter, value);
            GC.KeepAlive(this);
            return status;
        }

        public Status Get(Parameter parameter, out double value)
        {
            double found = 0;
            Status status = Native.umo_session_get_parameter(handle.Raw, parameter, &found);
            GC.KeepAlive(this);
            value = found;
            return status;
        }

        /// <summary>How far motion is behind speech.</summary>
        public Status GetLatency(out Latency latency)
        {
            Latency found = default(Latency);
            found.StructSize = (uint)sizeof(Latency);
            Status status = Native.umo_session_latency(handle.Raw, &found);
            GC.KeepAlive(this);
            latency = found;
            return status;
        }

        /// <summary>What the session went through so far.</summary>
        public Status GetStats(out Stats stats)
        {
            Stats found = default(Stats);
            found.StructSize = (uint)sizeof(Stats);
            Status status = Native.umo_session_stats(handle.Raw, &found);
            GC.KeepAlive(this);
            stats = found;
            return status;
        }

        /// <summary>Most bytes that a state of the session can have.</summary>
        public Status StateSize(out int size)
        {
            UIntPtr got;
            Status status = Native.umo_session_state_size(handle.Raw, &got);
            GC.KeepAlive(this);
            size = status == Status.Ok ? checked((int)got) : 0;
            return status;
        }

        /// <summary>Everything that the session is, as bytes that another session, elsewhere, can be restored from.</summary>
        public Status Save(byte[] state, out int written)
        {
            written = 0;
            if (state == null) return Status.NullPointer;
            UIntPtr got;
            Status status;
            byte none = 0;
            fixed (byte* first = state)
            {
                status = Native.umo_session_save(handle.Raw, state.Length == 0 ? &none : first, (UIntPtr)state.Length, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) written = (int)got;
            return status;
        }

        /// <summary>Becomes what the session was that was saved: the same calls then give the same frames, bit for bit.</summary>
        public Status Restore(byte[] state, int size)
        {
            if (state == null) return Status.NullPointer;
            if (size < 0 || size > state.Length) return Status.InvalidArgument;
            Status status;
            byte none = 0;
            fixed (byte* first = state)
            {
                status = Native.umo_session_restore(handle.Raw, state.Length == 0 ? &none : first, (UIntPtr)size);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The detail of the last call that failed, from whatever thread; empty where there is none. Allocates.</summary>
        public string LastError()
        {
            byte* buffer = stackalloc byte[Native.ErrorSize];
            UIntPtr length;
            Status status = Native.umo_session_last_error(handle.Raw, buffer, (UIntPtr)Native.ErrorSize, &length);
            GC.KeepAlive(this);
            return status == Status.Ok ? Encoding.UTF8.GetString(buffer, (int)length) : "";
        }

        /// <summary>Frees it, when the calls of other threads that are in it have returned.</summary>
        public void Dispose() { handle.Dispose(); }
    }

    public unsafe partial struct GestureOptions
    {
        /// <summary>Gives the gesture a place to point at.</summary>
        public void PointAt(Axes axes, float x, float y, float z)
        {
            Axes = axes;
            HasTarget = 1;
            fixed (float* target = Target)
            {
                target[0] = x;
                target[1] = y;
                target[2] = z;
            }
        }
    }
}
