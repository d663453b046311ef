// SPDX-License-Identifier: MIT OR Apache-2.0

using System;

namespace Umo
{
    /// <summary>Buffer for tightly packed frames in the requested axes. One thread at a time.</summary>
    public sealed unsafe class Frames
    {
        /// <summary>Memory of the frames, aligned for every value.</summary>
        public readonly ulong[] Words;

        public Frames(Model model, int capacity, Axes axes)
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            if (capacity < 1) throw new ArgumentOutOfRangeException(nameof(capacity));
            Layout = model.Layout(axes);
            Channels = (int)model.Info.Channels;
            Capacity = capacity;
            Words = new ulong[checked(capacity * (long)Layout.FrameStride / sizeof(ulong))];
        }

        public FrameLayout Layout { get; }
        public int Capacity { get; }
        /// <summary>Number of face channels.</summary>
        public int Channels { get; }
        /// <summary>Whether frames contain visemes. Models with ARKit channels have them.</summary>
        public bool HasVisemes { get { return Layout.Visemes != Native.Absent; } }
        /// <summary>Size in bytes.</summary>
        public long Size { get { return Words.LongLength * sizeof(ulong); } }

        /// <summary>Index of the frame since the start or the last reset.</summary>
        public ulong Index(int frame) { return Word(frame, Layout.Index); }

        /// <summary>Sample (per channel) of the pushed audio that the frame belongs to.</summary>
        public ulong Sample(int frame) { return Word(frame, Layout.Sample); }

        /// <summary>Position of the root: x y z.</summary>
        public void Translation(int frame, float[] into) { Copy(frame, Layout.Translation, 3, into); }

        /// <summary>Rotations of all joints relative to their parents, x y z w each.</summary>
        public void Rotations(int frame, float[] into) { Copy(frame, Layout.Rotations, 4 * Native.JointCount, into); }

        /// <summary>The face channels.</summary>
        public void Face(int frame, float[] into) { Copy(frame, Layout.Channels, Channels, into); }

        /// <summary>The visemes; empty if the frames have none.</summary>
        public void Visemes(int frame, float[] into)
        {
            if (HasVisemes) Copy(frame, Layout.Visemes, Native.VisemeCount, into);
        }

        /// <summary>Writes the first <paramref name="count"/> frames as a file. A failed write leaves no partial file.</summary>
        /// <param name="model">The one that made them.</param>
        /// <param name="figure">Who wears the motion in a .glb: one of <see cref="Model.FigureNames"/>; null: the bones alone.</param>
        public void WriteFile(Model model, int count, FileFormat format, string path, string figure = "alex")
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            if (path == null) throw new ArgumentNullException(nameof(path));
            if ((uint)count > (uint)Capacity) throw new ArgumentOutOfRangeException(nameof(count));
            FrameLayout layout = Layout;
            Clip clip;
            UmoException.Check(Native.umo_clip_init(&clip, (UIntPtr)sizeof(Clip), model.Raw));
            clip.FrameCount = (uint)count;
            clip.Layout = (IntPtr)(&layout);
            fixed (ulong* words = Words)
            fixed (byte* file = Native.Bytes(path), name = figure == null ? null : Native.Bytes(figure))
            {
                clip.Frames = (IntPtr)words;
                clip.Figure = (IntPtr)name;
                UmoException.Check(Native.umo_clip_write_file(&clip, format, file));
            }
            GC.KeepAlive(model);
        }

        private ulong Word(int frame, uint offset)
        {
            return Words[Start(frame) / sizeof(ulong) + offset / sizeof(ulong)];
        }

        private long Start(int frame)
        {
            if ((uint)frame >= (uint)Capacity) throw new ArgumentOutOfRangeException(nameof(frame));
            return frame * (long)Layout.FrameStride;
        }

        private void Copy(int frame, uint offset, int count, float[] into)
        {
            long start = Start(frame) + offset;
            if (into.Length < count) throw new ArgumentException("there is room for " + into.Length + " values of " + count, nameof(into));
            fixed (ulong* words = Words)
            {
                float* values = (float*)((byte*)words + start);
                for (int i = 0; i < count; i++) into[i] = values[i];
            }
        }
    }
}
