// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;

namespace Umo
{
    /// <summary>Computes sessions of one model, on threads of its own or in <see cref="Poll"/>.</summary>
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

        /// <summary>How engines are made if nothing else is said.</summary>
        public static EngineConfig Defaults
        {
            get
            {
                EngineConfig config;
                UmoException.Check(Native.umo_engine_config_init(&config, (UIntPtr)sizeof(EngineConfig)));
                return config;
            }
        }

        /// <summary>What it was made with: disposing one leaves the other alone.</summary>
        public Model Model { get; }

        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>Holds bodies, in turn, while chunks begin so many seconds late; a negative number holds none, as an engine begins.</summary>
        public Status SetLateLimit(double seconds)
        {
            Status status = Native.umo_engine_set_late_limit(Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Computes on this thread for so many microseconds, where the engine is polled. Allocates nothing.</summary>
        public Status Poll(uint budget, out bool more)
        {
            uint value = 0;
            Status status = Native.umo_engine_poll(Raw, budget, &value);
            GC.KeepAlive(this);
            more = value != 0;
            return status;
        }

        /// <summary>Names of the gestures that sessions know which are made now: the built-in ones, then those that were added.</summary>
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

        /// <summary>Adds a gesture for sessions that are made from now on; one of the same name is replaced.</summary>
        /// <param name="rotations">Of every joint in every frame, x y z w, relative to parents; at rest the arms are held out.</param>
        /// <param name="rate">Frames a second.</param>
        /// <param name="stroke">Seconds from the first frame to the stroke.</param>
        /// <param name="parts">What it moves.</param>
        public void AddGesture(string name, float[] rotations, float rate, float stroke, Gesture parts, Axes axes)
        {
            if (name == null) throw new ArgumentNullException(nameof(name));
            if (rotations == null) throw new ArgumentNullException(nameof(rotations));
            int width = 4 * Native.JointCount;
            if (rotations.Length % width != 0) throw new ArgumentException("rotations are no whole frames of " + width + " numbers", nameof(rotations));
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

        /// <summary>Every part that a gesture can move.</summary>
        public const Gesture AllParts = Gesture.Head | Gesture.Trunk | Gesture.LeftArm | Gesture.RightArm;

        /// <summary>The same of the animation in a .glb or .vrm file of any character with a human's bones.</summary>
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

        /// <summary>The same of a file's bytes.</summary>
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

        public void Dispose() { handle.Dispose(); }
    }
}
