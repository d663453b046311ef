// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;

namespace Umo
{
    /// <summary>Computes the sessions of one model, on its own threads or in <see cref="Poll"/>.</summary>
    public sealed unsafe class Engine : IDisposable
    {
        private readonly EngineHandle handle;

        public Engine(Model model, EngineConfig? config = null, uint[] cores = null)
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            Model = model;
            EngineConfig used = config ?? Defaults;
            IntPtr raw;
            fixed (uint* numbers = cores)
            {
                if (cores != null)
                {
                    used.Cores = (IntPtr)numbers;
                    used.CoreCount = (uint)cores.Length;
                }
                UmoException.Check(Native.umo_engine_new(model.Raw, &used, &raw));
            }
            GC.KeepAlive(model);
            handle = new EngineHandle(raw);
        }

        /// <summary>Default settings for a new engine.</summary>
        public static EngineConfig Defaults
        {
            get
            {
                EngineConfig config;
                UmoException.Check(Native.umo_engine_config_init(&config, (UIntPtr)sizeof(EngineConfig)));
                return config;
            }
        }

        /// <summary>The model it was created with. Disposing either does not affect the other.</summary>
        public Model Model { get; }

        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>
        /// Holds bodies still, in turn, while chunks start more than this many seconds late; a negative number turns
        /// this off, which is the default.
        /// </summary>
        public Status SetLateLimit(double seconds)
        {
            Status status = Native.umo_engine_set_late_limit(Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Computes on this thread for at most this many microseconds, if the engine is polled. Does not allocate.</summary>
        public Status Poll(uint budget, out bool more)
        {
            uint value = 0;
            Status status = Native.umo_engine_poll(Raw, budget, &value);
            GC.KeepAlive(this);
            more = value != 0;
            return status;
        }

        /// <summary>Names of the gestures available to sessions created now: the built-in ones, then the added ones.</summary>
        public string[] GestureNames()
        {
            List<string> names = new List<string>();
            IntPtr name;
            Status status;
            while ((status = Native.umo_engine_get_gesture_name(Raw, (uint)names.Count, &name)) == Status.Ok) names.Add(Native.Text(name));
            if (status != Status.InvalidArgument) UmoException.Check(status);
            GC.KeepAlive(this);
            return names.ToArray();
        }

        /// <summary>Adds a gesture for sessions created from now on, replacing any gesture of the same name.</summary>
        /// <param name="rotations">Rotation of every joint in every frame: x y z w, relative to the parent; the rest pose is a T-pose.</param>
        /// <param name="rate">Frames a second.</param>
        /// <param name="stroke">Seconds from the first frame to the stroke.</param>
        /// <param name="parts">Parts that it moves.</param>
        public void AddGesture(string name, float[] rotations, float rate, float stroke, Gesture parts, Axes axes)
        {
            if (name == null) throw new ArgumentNullException(nameof(name));
            if (rotations == null) throw new ArgumentNullException(nameof(rotations));
            int width = 4 * Native.JointCount;
            if (rotations.Length % width != 0) throw new ArgumentException("rotations must be whole frames of " + width + " numbers", nameof(rotations));
            GestureClip clip;
            UmoException.Check(Native.umo_gesture_clip_init(&clip, (UIntPtr)sizeof(GestureClip)));
            clip.Axes = axes;
            clip.Parts = parts;
            clip.FrameCount = (uint)(rotations.Length / width);
            clip.Rate = rate;
            clip.Stroke = stroke;
            fixed (byte* text = Native.Bytes(name))
            fixed (float* first = rotations)
            {
                clip.Rotations = (IntPtr)first;
                UmoException.Check(Native.umo_engine_add_gesture(Raw, text, &clip));
            }
            GC.KeepAlive(this);
        }

        /// <summary>All parts that a gesture can move.</summary>
        public const Gesture AllParts = Gesture.Head | Gesture.Trunk | Gesture.LeftArm | Gesture.RightArm;

        /// <summary>As AddGesture, from the animation in a .glb or .vrm file of any humanoid character.</summary>
        /// <param name="animation">Its name in the file; null for the first.</param>
        /// <param name="stroke">Seconds from its start to the stroke; negative: its middle.</param>
        public void AddGestureFile(string name, string path, string animation = null, Gesture parts = AllParts, float stroke = -1)
        {
            if (name == null) throw new ArgumentNullException(nameof(name));
            if (path == null) throw new ArgumentNullException(nameof(path));
            fixed (byte* text = Native.Bytes(name), file = Native.Bytes(path), clip = animation == null ? null : Native.Bytes(animation))
            {
                UmoException.Check(Native.umo_engine_add_gesture_file(Raw, text, file, clip, parts, stroke));
            }
            GC.KeepAlive(this);
        }

        /// <summary>As AddGestureFile, from the bytes of a file.</summary>
        public void AddGestureFile(string name, byte[] data, string animation = null, Gesture parts = AllParts, float stroke = -1)
        {
            if (name == null) throw new ArgumentNullException(nameof(name));
            if (data == null) throw new ArgumentNullException(nameof(data));
            fixed (byte* text = Native.Bytes(name), first = data, clip = animation == null ? null : Native.Bytes(animation))
            {
                UmoException.Check(Native.umo_engine_add_gesture_memory(Raw, text, first, (UIntPtr)data.Length, clip, parts, stroke));
            }
            GC.KeepAlive(this);
        }

        /// <summary>
        /// Sets the rules by which words become gestures, for sessions created later: of a language ("en", "de"; null keeps the
        /// present ones), and the text of a file of rules to add to them, if any.
        /// </summary>
        public void SetWordRules(string language, string toml = null)
        {
            fixed (byte* code = language == null ? null : Native.Bytes(language), rules = toml == null ? null : Native.Bytes(toml))
            {
                UmoException.Check(Native.umo_engine_set_word_rules(Raw, code, rules));
            }
            GC.KeepAlive(this);
        }

        public void Dispose() { handle.Dispose(); }
    }
}
