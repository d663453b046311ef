// SPDX-License-Identifier: MIT OR Apache-2.0

using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>Blend shapes of a set of meshes whose names match face channels.</summary>
    internal sealed class FaceShapes
    {
        private struct Shape
        {
            public SkinnedMeshRenderer Mesh;
            public int Index, Channel;
            /// Weight of the fully applied shape: usually 100.
            public float Full;
        }

        private readonly Shape[] shapes;
        private readonly bool[] moved;

        public FaceShapes(SkinnedMeshRenderer[] meshes, string[] channels)
        {
            FaceMap map = new FaceMap(channels);
            List<Shape> found = new List<Shape>();
            moved = new bool[channels.Length];
            foreach (SkinnedMeshRenderer renderer in meshes)
            {
                Mesh mesh = renderer == null ? null : renderer.sharedMesh;
                if (mesh == null) continue;
                for (int i = 0; i < mesh.blendShapeCount; i++)
                {
                    int channel = map.Find(mesh.GetBlendShapeName(i));
                    if (channel < 0) continue;
                    float full = mesh.GetBlendShapeFrameWeight(i, mesh.GetBlendShapeFrameCount(i) - 1);
                    found.Add(new Shape { Mesh = renderer, Index = i, Channel = channel, Full = full });
                    moved[channel] = true;
                }
            }
            shapes = found.ToArray();
        }

        public int Count { get { return shapes.Length; } }

        /// <summary>Number of channels that move at least one shape.</summary>
        public int Channels
        {
            get
            {
                int count = 0;
                foreach (bool one in moved) count += one ? 1 : 0;
                return count;
            }
        }

        public void Show(float[] face)
        {
            for (int i = 0; i < shapes.Length; i++)
            {
                Shape shape = shapes[i];
                if (shape.Mesh != null) shape.Mesh.SetBlendShapeWeight(shape.Index, shape.Full * face[shape.Channel]);
            }
        }
    }
}
