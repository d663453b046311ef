// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using System.Text;

namespace Umo
{
    /// <summary>
    /// A loaded model: immutable, shared by any number of engines. Calls throw on failure and may come from any thread
    /// except the audio thread.
    /// </summary>
    public sealed unsafe class Model : IDisposable
    {
        private readonly ModelHandle handle;

        private Model(IntPtr raw)
        {
            handle = new ModelHandle(raw);
            ModelInfo info = default(ModelInfo);
            info.StructSize = (uint)sizeof(ModelInfo);
            UmoException.Check(Native.umo_model_get_info(raw, &info));
            Info = info;
        }

        /// <summary>Default settings for loading a model.</summary>
        public static ModelConfig Defaults
        {
            get
            {
                Native.Require();
                ModelConfig config;
                UmoException.Check(Native.umo_model_config_init(&config, (UIntPtr)sizeof(ModelConfig)));
                return config;
            }
        }

        public static Model Load(string path, ModelConfig? config = null)
        {
            if (path == null) throw new ArgumentNullException(nameof(path));
            Native.Require();
            ModelConfig used = config ?? Defaults;
            IntPtr raw;
            fixed (byte* text = Native.Bytes(path))
            {
                UmoException.Check(Native.umo_model_load(Native.AbiVersion, text, &used, &raw));
            }
            return new Model(raw);
        }

        /// <summary>Loads from the bytes of a file. The bytes are not needed afterwards.</summary>
        public static Model Load(byte[] file, ModelConfig? config = null)
        {
            if (file == null) throw new ArgumentNullException(nameof(file));
            Native.Require();
            ModelConfig used = config ?? Defaults;
            IntPtr raw;
            fixed (byte* bytes = file)
            {
                UmoException.Check(Native.umo_model_load_memory(Native.AbiVersion, bytes, (UIntPtr)(ulong)file.LongLength, &used, &raw));
            }
            return new Model(raw);
        }

        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>Properties of the model.</summary>
        public ModelInfo Info { get; }

        public string Text(ModelText which)
        {
            IntPtr text;
            UmoException.Check(Native.umo_model_get_text(Raw, which, &text));
            string result = Native.Text(text);
            GC.KeepAlive(this);
            return result;
        }

        public string Name { get { return Text(ModelText.Name); } }
        public string License { get { return Text(ModelText.License); } }
        /// <summary>Notice that users of the model must be shown; may be empty.</summary>
        public string Notice { get { return Text(ModelText.Notice); } }

        /// <summary>Prompts that the model was trained with; empty if it has no list. With others its motion is chance.</summary>
        public string[] Prompts
        {
            get { return Text(ModelText.Prompts).Split(new[] { '\n' }, StringSplitOptions.RemoveEmptyEntries); }
        }

        /// <summary>Names of the face channels, such as jawOpen.</summary>
        public string[] ChannelNames()
        {
            string[] names = new string[Info.Channels];
            for (uint i = 0; i < names.Length; i++)
            {
                IntPtr name;
                UmoException.Check(Native.umo_model_get_channel_name(Raw, i, &name));
                names[i] = Native.Text(name);
            }
            GC.KeepAlive(this);
            return names;
        }

        /// <summary>Names of the joints, the same for every model, such as left_elbow.</summary>
        public static string[] JointNames()
        {
            Native.Require();
            string[] names = new string[Native.JointCount];
            for (uint i = 0; i < names.Length; i++) names[i] = Native.Text(Native.umo_joint_name(i));
            return names;
        }

        /// <summary>Names of the visemes of the Oculus set, such as PP.</summary>
        public static string[] VisemeNames()
        {
            Native.Require();
            string[] names = new string[Native.VisemeCount];
            for (uint i = 0; i < names.Length; i++) names[i] = Native.Text(Native.umo_viseme_name(i));
            return names;
        }

        /// <summary>Names of the figures for <see cref="Frames.WriteFile"/>, the default first.</summary>
        public static string[] FigureNames()
        {
            Native.Require();
            List<string> names = new List<string>();
            for (IntPtr name; (name = Native.umo_figure_name((uint)names.Count)) != IntPtr.Zero;) names.Add(Native.Text(name));
            return names.ToArray();
        }

        /// <summary>Parent of each joint (-1 for the first) and its rest position in the parent's frame, x y z.</summary>
        public void Skeleton(Axes axes, out int[] parents, out float[] offsets)
        {
            int[] p = new int[Native.JointCount];
            float[] o = new float[3 * Native.JointCount];
            fixed (int* pp = p)
            fixed (float* po = o)
            {
                UmoException.Check(Native.umo_model_get_skeleton(Raw, axes, pp, po, (UIntPtr)Native.JointCount));
            }
            GC.KeepAlive(this);
            parents = p;
            offsets = o;
        }

        /// <summary>Token ids of a prompt, for <see cref="Session.SetPromptIds"/>.</summary>
        public uint[] EncodeText(string text)
        {
            byte[] bytes = Native.Bytes(text);
            uint[] ids = new uint[Info.MaxPrompt];
            UIntPtr count;
            fixed (byte* b = bytes)
            fixed (uint* p = ids)
            {
                UmoException.Check(Native.umo_model_encode_text(Raw, b, (UIntPtr)(bytes.Length - 1), p, (UIntPtr)ids.Length, &count));
            }
            GC.KeepAlive(this);
            Array.Resize(ref ids, (int)count);
            return ids;
        }

        /// <summary>
        /// Tests this machine in at most about 10 seconds: kernels, the model's motion, its speed. Returns whether all
        /// checks passed; the report is safe to publish, as it contains no path, host or user name.
        /// </summary>
        public bool SelfTest(out string report)
        {
            byte[] text = new byte[Native.SelfTestSize];
            uint passed;
            fixed (byte* t = text)
            {
                UmoException.Check(Native.umo_self_test(Raw, &passed, t, (UIntPtr)text.Length));
                report = Native.Text((IntPtr)t);
            }
            GC.KeepAlive(this);
            return passed == 1;
        }

        /// <summary>Layout of tightly packed frames.</summary>
        public FrameLayout Layout(Axes axes)
        {
            FrameLayout layout;
            UmoException.Check(Native.umo_frame_layout_init(&layout, (UIntPtr)sizeof(FrameLayout), Raw));
            GC.KeepAlive(this);
            layout.Axes = axes;
            return layout;
        }

        /// <summary>
        /// Number of frames of a custom layout that fit into a buffer of the given size; throws if the layout is
        /// invalid.
        /// </summary>
        public int CheckLayout(FrameLayout layout, long size)
        {
            UIntPtr frames;
            UmoException.Check(Native.umo_frame_layout_check(&layout, Raw, (UIntPtr)(ulong)size, &frames));
            GC.KeepAlive(this);
            return (int)Math.Min((ulong)frames, int.MaxValue);
        }

        public void Dispose() { handle.Dispose(); }
    }
}
