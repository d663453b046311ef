// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;

namespace Umo
{
    /// <summary>
    /// A character at rest, for <see cref="RigRetarget"/>: its bones and, for its girth, its mesh. Places and rotations
    /// are in the character's space, not relative to parents. Arrays of three or four values for each bone or point.
    /// </summary>
    public sealed class RigAtRest
    {
        /// <summary>Axes of the character, and of the poses.</summary>
        public Axes Axes = Axes.Unity;
        /// <summary>Index of each bone's parent, -1 for none.</summary>
        public int[] Parents;
        /// <summary>Joint that each bone follows, -1 for none; spine and neck may have any number of bones. Null: found by Names.</summary>
        public int[] Joints;
        /// <summary>Names of the bones, if there are no Joints.</summary>
        public string[] Names;
        public float[] Places;
        public float[] Rotations;
        /// <summary>Strength of the body's volume, 0 to 1: at 0 arms go through the body.</summary>
        public float Gain = 1;
        /// <summary>Factors of the girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands and thighs; null: 1.</summary>
        public float[] Girths;
        /// <summary>Points of the mesh; null: the body has a person's proportions.</summary>
        public float[] Vertices;
        /// <summary>Bone that has at least half of each point's weight, -1 for none.</summary>
        public int[] VertexBones;
        /// <summary>Points of the triangles; null: the points are spread over the surface.</summary>
        public int[] Indices;
    }

    /// <summary>
    /// Puts poses on a character's bones: see umo_retarget. Only the constructor throws; Apply returns a status and does
    /// not allocate. After Dispose, calls return <see cref="Status.InvalidHandle"/>.
    /// </summary>
    public sealed unsafe class RigRetarget : IDisposable
    {
        private readonly RetargetHandle handle;
        private readonly int[] joints;

        public RigRetarget(Model model, RigAtRest rig)
        {
            if (model == null) throw new ArgumentNullException("model");
            if (rig == null) throw new ArgumentNullException("rig");
            if (rig.Parents == null) throw new ArgumentException("Parents is null");
            int bones = rig.Parents.Length, points = rig.Vertices == null ? 0 : rig.Vertices.Length / 3;
            Check("Places", rig.Places, 3 * bones);
            Check("Rotations", rig.Rotations, 4 * bones);
            if (rig.Joints != null) Check("Joints", rig.Joints, bones);
            else Check("Names", rig.Names, bones);
            if (rig.Girths != null) Check("Girths", rig.Girths, 9);
            if (rig.Vertices != null) Check("VertexBones", rig.VertexBones, points);
            Rig raw;
            UmoException.Check(Native.umo_rig_init(&raw, (UIntPtr)sizeof(Rig)));
            raw.Axes = rig.Axes;
            raw.BoneCount = (uint)bones;
            raw.VertexCount = (uint)points;
            raw.IndexCount = rig.Indices == null ? 0 : (uint)rig.Indices.Length;
            raw.Gain = rig.Gain;
            for (int part = 0; rig.Girths != null && part < 9; part++) raw.Girths[part] = rig.Girths[part];
            List<byte> texts = new List<byte>();
            IntPtr[] names = new IntPtr[rig.Joints == null ? bones : 0];
            int[] starts = new int[names.Length];
            for (int bone = 0; bone < names.Length; bone++)
            {
                starts[bone] = texts.Count;
                texts.AddRange(Native.Bytes(rig.Names[bone] ?? ""));
            }
            IntPtr made;
            fixed (int* parents = rig.Parents, given = rig.Joints, vertexBones = rig.VertexBones, indices = rig.Indices)
            fixed (float* places = rig.Places, rotations = rig.Rotations, vertices = rig.Vertices)
            fixed (byte* text = texts.ToArray())
            fixed (IntPtr* name = names)
            {
                for (int bone = 0; bone < names.Length; bone++) names[bone] = (IntPtr)(text + starts[bone]);
                raw.Names = (IntPtr)name;
                raw.Parents = (IntPtr)parents;
                raw.Joints = (IntPtr)given;
                raw.Places = (IntPtr)places;
                raw.Rotations = (IntPtr)rotations;
                raw.Vertices = (IntPtr)vertices;
                raw.VertexBones = (IntPtr)vertexBones;
                raw.Indices = (IntPtr)indices;
                UmoException.Check(Native.umo_retarget_new(model.Raw, &raw, &made));
            }
            GC.KeepAlive(model);
            handle = new RetargetHandle(made);
            joints = new int[bones];
            fixed (int* first = joints) UmoException.Check(Native.umo_retarget_get_joints(made, (uint)bones, first));
        }

        /// <summary>Joint that each bone follows, -1 for a bone that keeps its rest rotation. Allocates.</summary>
        public int[] Joints { get { return (int[])joints.Clone(); } }

        /// <summary>Sets the seconds from the last pose to the next; 1/30 at first. One thread at a time.</summary>
        public Status SetStep(float seconds)
        {
            Status status = Native.umo_retarget_set_step(handle.Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>
        /// Writes the rotation of each bone relative to its parent, and the place of the bone of joint 0 in the character's
        /// space (null: not wanted). One thread at a time.
        /// </summary>
        /// <param name="poseRotations">Rotations of the 55 joints, four values each.</param>
        /// <param name="poseTranslation">Three values.</param>
        public Status Apply(float[] poseRotations, float[] poseTranslation, float[] rotations, float[] place)
        {
            if (poseRotations == null || poseTranslation == null || rotations == null) return Status.NullPointer;
            bool isWrong = poseRotations.Length < 4 * Native.JointCount || poseTranslation.Length < 3 || rotations.Length < 4 * joints.Length;
            if (isWrong || place != null && place.Length < 3) return Status.InvalidArgument;
            Status status;
            fixed (float* turns = poseRotations, at = poseTranslation, into = rotations, to = place)
            {
                status = Native.umo_retarget_apply(handle.Raw, turns, at, (uint)joints.Length, into, to);
            }
            GC.KeepAlive(this);
            return status;
        }

        public void Dispose()
        {
            handle.Dispose();
        }

        private static void Check(string what, Array values, int count)
        {
            if (values != null && values.Length == count) return;
            string got = values == null ? "null" : values.Length.ToString();
            throw new ArgumentException(what + ": expected " + count + " values, got " + got);
        }
    }
}
