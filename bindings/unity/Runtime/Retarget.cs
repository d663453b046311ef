// SPDX-License-Identifier: MIT OR Apache-2.0
// Does not use engine types, so that it can be tested without Unity.

using System;

namespace Umo.Unity
{
    public struct Vec
    {
        public float X, Y, Z;

        public Vec(float x, float y, float z)
        {
            X = x;
            Y = y;
            Z = z;
        }

        public static Vec operator +(Vec a, Vec b) { return new Vec(a.X + b.X, a.Y + b.Y, a.Z + b.Z); }
        public static Vec operator -(Vec a, Vec b) { return new Vec(a.X - b.X, a.Y - b.Y, a.Z - b.Z); }
        public static Vec operator *(float k, Vec a) { return new Vec(k * a.X, k * a.Y, k * a.Z); }
        public static float Dot(Vec a, Vec b) { return a.X * b.X + a.Y * b.Y + a.Z * b.Z; }
        public static Vec Cross(Vec a, Vec b) { return new Vec(a.Y * b.Z - a.Z * b.Y, a.Z * b.X - a.X * b.Z, a.X * b.Y - a.Y * b.X); }
        public float Length { get { return (float)Math.Sqrt(Dot(this, this)); } }
    }

    /// <summary>A unit quaternion.</summary>
    public struct Quat
    {
        public float X, Y, Z, W;

        public Quat(float x, float y, float z, float w)
        {
            X = x;
            Y = y;
            Z = z;
            W = w;
        }

        public static readonly Quat Identity = new Quat(0, 0, 0, 1);

        /// <summary>Applies b first, then a.</summary>
        public static Quat operator *(Quat a, Quat b)
        {
            return new Quat(
                a.W * b.X + a.X * b.W + a.Y * b.Z - a.Z * b.Y,
                a.W * b.Y - a.X * b.Z + a.Y * b.W + a.Z * b.X,
                a.W * b.Z + a.X * b.Y - a.Y * b.X + a.Z * b.W,
                a.W * b.W - a.X * b.X - a.Y * b.Y - a.Z * b.Z);
        }

        public static Vec operator *(Quat q, Vec v)
        {
            Vec axis = new Vec(q.X, q.Y, q.Z);
            Vec turned = 2 * Vec.Cross(axis, v);
            return v + q.W * turned + Vec.Cross(axis, turned);
        }

        /// <summary>Shortest rotation from one direction to another.</summary>
        public static Quat Between(Vec from, Vec to)
        {
            Vec axis = Vec.Cross(from, to);
            float sine = axis.Length, cosine = Vec.Dot(from, to);
            if (sine <= 1e-6f * from.Length * to.Length)
            {
                if (cosine >= 0) return Identity;
                // Opposite directions: half a turn about any perpendicular axis.
                axis = Vec.Cross(from, Math.Abs(from.X) < 0.7f * from.Length ? new Vec(1, 0, 0) : new Vec(0, 1, 0));
            }
            double half = Math.Atan2(sine, cosine) / 2;
            Vec part = (float)(Math.Sin(half) / axis.Length) * axis;
            return new Quat(part.X, part.Y, part.Z, (float)Math.Cos(half));
        }
    }

    /// <summary>A bone of the figure to drive, in the frame of the figure's root.</summary>
    public struct Bone
    {
        /// <summary>Model joint that drives it.</summary>
        public int Joint;
        /// <summary>Rotation and position in the figure's rest pose.</summary>
        public Quat Rotation;
        public Vec Place;
    }

    /// <summary>
    /// Transfers the model's rotations to a figure with its own skeleton: any bind axes, missing bones, and a rest pose
    /// that need not be a T-pose. Arms, legs and fingers are rotated as if the figure's rest pose were the model's;
    /// back, head and feet keep their own rest shape.
    /// </summary>
    public sealed class Retarget
    {
        private const int Joints = Native.JointCount;
        private const int Pelvis = 0, Spine1 = 3, Spine2 = 6, Spine3 = 9;

        /// Joint that a limb's joint points to; 0 keeps the figure's own shape, -1 uses the parent's correction.
        private static readonly int[] Towards = MakeTowards();

        private readonly int[] parents;
        private readonly Bone[] bones;
        /// Rotation from the bone's rest to the model's rest pose.
        private readonly Quat[] rest;
        private readonly Quat[] global = new Quat[Joints];
        private readonly Vec pelvis;
        private readonly float scale;
        private readonly Vec stand;

        /// <param name="parents">Parents of the model's joints, parents first.</param>
        /// <param name="offsets">Offsets of the model's joints in the engine's axes, three values each.</param>
        /// <param name="bones">At most one per joint.</param>
        public Retarget(int[] parents, float[] offsets, Bone[] bones)
        {
            this.parents = parents;
            this.bones = bones;
            rest = new Quat[bones.Length];
            pelvis = Offset(offsets, Pelvis);

            int[] boneOf = new int[Joints];
            for (int j = 0; j < Joints; j++) boneOf[j] = -1;
            for (int b = 0; b < bones.Length; b++) boneOf[bones[b].Joint] = b;

            Quat[] corrections = new Quat[Joints];
            for (int j = 0; j < Joints; j++)
            {
                Quat inherited = parents[j] < 0 ? Quat.Identity : corrections[parents[j]];
                int child = Towards[j];
                if (child == 0)
                {
                    corrections[j] = Quat.Identity;
                }
                else if (child < 0 || boneOf[j] < 0 || boneOf[child] < 0)
                {
                    corrections[j] = inherited;
                }
                else
                {
                    Vec has = inherited * (bones[boneOf[child]].Place - bones[boneOf[j]].Place);
                    corrections[j] = Quat.Between(has, Between(offsets, j, child)) * inherited;
                }
                if (boneOf[j] >= 0) rest[boneOf[j]] = corrections[j] * bones[boneOf[j]].Rotation;
            }

            scale = 1;
            if (boneOf[Pelvis] >= 0)
            {
                Vec hips = bones[boneOf[Pelvis]].Place;
                // Leg length from the hips to the sole: hip, knee, ankle, ball of the foot.
                float leg = -(offsets[3 * 1 + 1] + offsets[3 * 4 + 1] + offsets[3 * 7 + 1] + offsets[3 * 10 + 1]);
                if (leg > 0 && hips.Y > 0) scale = hips.Y / leg;
                stand = new Vec(hips.X, 0, hips.Z);
            }
        }

        /// <summary>Size of the figure relative to the model's.</summary>
        public float Scale { get { return scale; } }

        /// <summary>Rotations of the figure's bones in its root's frame. Does not allocate.</summary>
        /// <param name="rotations">Rotations of the model's joints, relative to their parents, four values each.</param>
        public void Rotate(float[] rotations, Quat[] into)
        {
            for (int j = 0; j < Joints; j++)
            {
                Quat local = new Quat(rotations[4 * j], rotations[4 * j + 1], rotations[4 * j + 2], rotations[4 * j + 3]);
                global[j] = parents[j] < 0 ? local : global[parents[j]] * local;
            }
            for (int b = 0; b < bones.Length; b++) into[b] = global[bones[b].Joint] * rest[b];
        }

        /// <summary>Position of the figure's hips in its root's frame.</summary>
        /// <param name="translation">The model's.</param>
        public Vec Hips(float[] translation)
        {
            return stand + scale * (pelvis + new Vec(translation[0], translation[1], translation[2]));
        }

        /// <summary>Converts a point in the figure's root frame to the model's space.</summary>
        public Vec Place(Vec figure)
        {
            return 1 / scale * (figure - stand);
        }

        /// <summary>
        /// Joints that drive a spine of the given number of bones, from the lowest up: the highest bone carries neck
        /// and arms, and follows the joint that they hang on.
        /// </summary>
        public static int[] Back(int count)
        {
            switch (count)
            {
                case 0: return new int[0];
                case 1: return new[] { Spine3 };
                case 2: return new[] { Spine1, Spine3 };
                default: return new[] { Spine1, Spine2, Spine3 };
            }
        }

        private Vec Between(float[] offsets, int joint, int child)
        {
            Vec sum = new Vec(0, 0, 0);
            for (int j = child; j != joint; j = parents[j]) sum += Offset(offsets, j);
            return sum;
        }

        private static Vec Offset(float[] offsets, int joint)
        {
            return new Vec(offsets[3 * joint], offsets[3 * joint + 1], offsets[3 * joint + 2]);
        }

        private static int[] MakeTowards()
        {
            int[] towards = new int[Joints];
            foreach (int side in new[] { 0, 1 })
            {
                towards[1 + side] = 4 + side;     // hip, knee
                towards[4 + side] = 7 + side;     // knee, ankle
                towards[16 + side] = 18 + side;   // shoulder, elbow
                towards[18 + side] = 20 + side;   // elbow, wrist
                int fingers = 25 + 15 * side;
                towards[20 + side] = fingers + 3; // wrist, first joint of the middle finger
                for (int finger = fingers; finger < fingers + 15; finger += 3)
                {
                    towards[finger] = finger + 1;
                    towards[finger + 1] = finger + 2;
                    towards[finger + 2] = -1;
                }
            }
            return towards;
        }
    }
}
