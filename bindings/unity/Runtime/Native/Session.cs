// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Text;

namespace Umo
{
    /// <summary>
    /// One avatar. Only the constructor throws; every other call returns a status and does not allocate, except
    /// SetPrompt, PlayGesture and LastError. After Dispose, calls from any thread return
    /// <see cref="Status.InvalidHandle"/>.
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
            // Keep the engine alive: collecting it would end its sessions.
            Engine = engine;
            handle = new SessionHandle(raw);
        }

        private Session(IntPtr raw)
        {
            handle = new SessionHandle(raw);
        }

        /// <summary>
        /// An avatar that is animated by received packets: call PushPacket instead of PushAudio; everything else is as
        /// in a session. It needs no engine. Model, Target, Lookahead and Smoothing must match the sender's.
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

        /// <summary>
        /// An avatar that plays a take: call PushTake before each pull or sample. It needs no engine. The model must be the
        /// one that the take was made with.
        /// </summary>
        public static Session Player(Model model, Take take, SessionConfig? config = null)
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            if (take == null) throw new ArgumentNullException(nameof(take));
            SessionConfig used = config ?? Defaults(model);
            IntPtr raw;
            UmoException.Check(Native.umo_decoder_new_of_take(model.Raw, take.Raw, &used, &raw));
            GC.KeepAlive(model);
            GC.KeepAlive(take);
            return new Session(raw);
        }

        /// <summary>The handle, freed or not.</summary>
        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>The engine that computes it; null for a decoder.</summary>
        public Engine Engine { get; }

        /// <summary>Maximum packet size in bytes if the session was created with Packets; else 0.</summary>
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

        /// <summary>Pulls the next packet into bytes (at least PacketSize), to be sent to decoders unchanged. The length is 0 if no packet is ready.</summary>
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

        /// <summary>Takes a packet from the decoder's sender. Packets may arrive reordered or duplicated.</summary>
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

        /// <summary>Computes the frames of the take's next chunk, if the queue has room. `more`: whether there may be more.</summary>
        public Status PushTake(out bool more)
        {
            uint left = 0;
            Status status = Native.umo_decoder_push_take(handle.Raw, &left);
            GC.KeepAlive(this);
            more = left != 0;
            return status;
        }

        /// <summary>The take that the session, made with TakeBytes, has recorded so far. Allocates.</summary>
        public Status GetTake(out byte[] bytes)
        {
            UIntPtr size;
            bytes = null;
            Status status = Native.umo_session_take_size(handle.Raw, &size);
            if (status == Status.Ok)
            {
                byte[] found = new byte[(int)size];
                fixed (byte* first = found) status = Native.umo_session_take(handle.Raw, first, size, &size);
                if (status == Status.Ok) bytes = found;
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Statistics of a decoder's packets.</summary>
        public Status GetReceived(out Received stats)
        {
            Received found = new Received { StructSize = (uint)sizeof(Received) };
            Status status = Native.umo_decoder_stats(handle.Raw, &found);
            GC.KeepAlive(this);
            stats = found;
            return status;
        }

        /// <summary>Default settings of the model: mono audio at the model's rate.</summary>
        public static SessionConfig Defaults(Model model)
        {
            SessionConfig config;
            UmoException.Check(Native.umo_session_config_init(&config, (UIntPtr)sizeof(SessionConfig), model.Raw));
            GC.KeepAlive(model);
            return config;
        }

        /// <summary>
        /// Takes interleaved samples, full scale 1, in a whole number of sample frames. Push the samples that were not
        /// taken again later.
        /// </summary>
        public Status PushAudio(float[] samples, int start, int count, out int taken)
        {
            taken = 0;
            if (samples == null) return Status.NullPointer;
            if (start < 0 || count < 0 || start > samples.Length - count) return Status.InvalidArgument;
            UIntPtr got;
            Status status;
            // An empty array has no address.
            float none = 0;
            fixed (float* first = samples)
            {
                status = Native.umo_session_push_audio(handle.Raw, count == 0 ? &none : first + start, (UIntPtr)count, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) taken = (int)got;
            return status;
        }

        /// <summary>As above, for 16-bit samples.</summary>
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

        /// <summary>Feeds the audio of the person who speaks to the avatar, so that it listens: interleaved samples, full scale 1.</summary>
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

        /// <summary>Ends the audio: the remaining frames are computed.</summary>
        public Status Finish()
        {
            Status status = Native.umo_session_finish(handle.Raw);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Drops frames that were not shown yet and eases to rest.</summary>
        public Status Interrupt(uint easeMs)
        {
            Status status = Native.umo_session_interrupt(handle.Raw, easeMs);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Returns to the initial state.</summary>
        public Status Reset()
        {
            Status status = Native.umo_session_reset(handle.Raw);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Pulls ready frames, each once, up to the capacity of the buffer.</summary>
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

        /// <summary>Number of frames that PullFrames would return.</summary>
        public Status ReadyFrames(out int count)
        {
            UIntPtr got;
            Status status = Native.umo_session_ready_frames(handle.Raw, &got);
            GC.KeepAlive(this);
            count = status == Status.Ok ? (int)got : 0;
            return status;
        }

        /// <summary>Arousal of the voice at the newest frame pulled or sampled, 0 to 1, 0.5 for an ordinary voice and for none; and its change per second.</summary>
        public Status Arousal(out float arousal, out float trend)
        {
            float got, change;
            Status status = Native.umo_session_arousal(handle.Raw, &got, &change);
            GC.KeepAlive(this);
            arousal = status == Status.Ok ? got : 0.5f;
            trend = status == Status.Ok ? change : 0;
            return status;
        }

        /// <summary>Whether <see cref="Finish"/> was called and all frames were pulled; Failed or Closed if the rest will never arrive.</summary>
        public Status IsDone(out bool done)
        {
            uint got;
            Status status = Native.umo_session_is_done(handle.Raw, &got);
            GC.KeepAlive(this);
            done = status == Status.Ok && got != 0;
            return status;
        }

        /// <summary>Sets the host's time in seconds. Layers and easing then follow it while no frames arrive.</summary>
        public Status SetClock(double seconds)
        {
            Status status = Native.umo_session_set_clock(handle.Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The pose at a motion time, written to the first frame of <paramref name="frame"/>.</summary>
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

        /// <summary>Sets the prompt from the next chunk on; an empty text removes it. Allocates.</summary>
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

        /// <summary>As SetPrompt, with token ids from <see cref="Model.EncodeText"/>.</summary>
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

        /// <summary>Looks at a point in the avatar's space from the next frame on; a strength of 0 stops it.</summary>
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

        /// <summary>Sets the mood of face and posture from the next frame on, with a strength of 0 to 1.</summary>
        public Status SetMood(Mood mood, float strength)
        {
            Status status = Native.umo_session_set_mood(handle.Raw, mood, strength);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>
        /// Schedules a lip shape for a sound, as timed by a speech synthesiser, in seconds of the pushed audio. Returns
        /// Busy if 64 hints are queued.
        /// </summary>
        public Status HintLips(LipShape shape, double start, double duration)
        {
            Status status = Native.umo_session_hint_lips(handle.Raw, shape, start, duration);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>
        /// Gives a word and its time, in seconds of the pushed audio; several words share the time by their syllables. By the
        /// engine's rules some become gestures. Returns Busy if 64 words are queued.
        /// </summary>
        public Status HintWords(string text, double start, double end)
        {
            Status status;
            fixed (byte* bytes = text == null ? null : Native.Bytes(text))
            {
                status = Native.umo_session_hint_words(handle.Raw, bytes, start, end);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Default gesture options: as soon as possible, normal speed, full strength.</summary>
        public static GestureOptions GestureDefaults
        {
            get
            {
                GestureOptions options;
                UmoException.Check(Native.umo_gesture_options_init(&options, (UIntPtr)sizeof(GestureOptions)));
                return options;
            }
        }

        /// <summary>Plays a gesture over the model's motion: one of <see cref="Engine.GestureNames"/>. Allocates for the name.</summary>
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

        /// <summary>Latency of the motion behind the speech.</summary>
        public Status GetLatency(out Latency latency)
        {
            Latency found = default(Latency);
            found.StructSize = (uint)sizeof(Latency);
            Status status = Native.umo_session_latency(handle.Raw, &found);
            GC.KeepAlive(this);
            latency = found;
            return status;
        }

        /// <summary>Statistics since the session was created.</summary>
        public Status GetStats(out Stats stats)
        {
            Stats found = default(Stats);
            found.StructSize = (uint)sizeof(Stats);
            Status status = Native.umo_session_stats(handle.Raw, &found);
            GC.KeepAlive(this);
            stats = found;
            return status;
        }

        /// <summary>Maximum size of a saved state in bytes.</summary>
        public Status StateSize(out int size)
        {
            UIntPtr got;
            Status status = Native.umo_session_state_size(handle.Raw, &got);
            GC.KeepAlive(this);
            size = status == Status.Ok ? checked((int)got) : 0;
            return status;
        }

        /// <summary>Saves the complete state of the session, which another session, even on another machine, can restore.</summary>
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

        /// <summary>Restores a saved state: the same calls then give bit-identical frames.</summary>
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

        /// <summary>Detail of the last failed call from any thread; may be empty. Allocates.</summary>
        public string LastError()
        {
            byte* buffer = stackalloc byte[Native.ErrorSize];
            UIntPtr length;
            Status status = Native.umo_session_last_error(handle.Raw, buffer, (UIntPtr)Native.ErrorSize, &length);
            GC.KeepAlive(this);
            return status == Status.Ok ? Encoding.UTF8.GetString(buffer, (int)length) : "";
        }

        /// <summary>Frees the session after calls of other threads have returned.</summary>
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
