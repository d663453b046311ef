// SPDX-License-Identifier: MIT OR Apache-2.0
// Does not use engine types, so that it can be tested without Unity.

using System;
using System.Collections.Generic;
using System.Text;

namespace Umo.Unity
{
    /// <summary>
    /// Finds a face channel by the blend shape names that art tools use: jawOpen, JawOpen, jaw_open,
    /// blendShape1.jawOpen, Face.eyeBlink_L, ARKit_mouthSmileLeft.
    /// </summary>
    public sealed class FaceMap
    {
        private readonly Dictionary<string, int> channels = new Dictionary<string, int>(StringComparer.Ordinal);

        public FaceMap(string[] names)
        {
            for (int i = 0; i < names.Length; i++) channels[Plain(names[i])] = i;
        }

        /// <summary>The channel of a shape, or -1.</summary>
        public int Find(string shape)
        {
            string name = shape.Substring(shape.LastIndexOfAny(new[] { '.', ':', '|' }) + 1);
            while (true)
            {
                int channel;
                if (channels.TryGetValue(Plain(Sided(name)), out channel)) return channel;
                // The first word may be a prefix from the mesh or the tool.
                int cut = name.IndexOf('_');
                if (cut < 0) return -1;
                name = name.Substring(cut + 1);
            }
        }

        private static string Sided(string name)
        {
            if (name.EndsWith("_L", StringComparison.OrdinalIgnoreCase)) return name.Substring(0, name.Length - 2) + "Left";
            if (name.EndsWith("_R", StringComparison.OrdinalIgnoreCase)) return name.Substring(0, name.Length - 2) + "Right";
            return name;
        }

        /// Letters and digits only, in lower case.
        private static string Plain(string name)
        {
            StringBuilder plain = new StringBuilder(name.Length);
            foreach (char c in name)
            {
                if (char.IsLetterOrDigit(c)) plain.Append(char.ToLowerInvariant(c));
            }
            return plain.ToString();
        }
    }
}
