// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using NUnit.Framework;

namespace Umo.Unity.Tests
{
    /// <summary>Hand-computed poses in Unity's axes: right +X, up +Y, forward +Z, left-handed.</summary>
    public sealed class RetargetTests
    {
        private const float Half = 0.70710678f;
        private const int Pelvis = 0, LeftHip = 1, LeftKnee = 4, Spine3 = 9, Head = 15, LeftShoulder = 16, LeftElbow = 18, LeftWrist = 20, LeftIndex1 = 25, LeftMiddle1 = 28;

        private static readonly int[] Parents = MakeParents();

        /// The SMPL-X joint tree.
        private static int[] MakeParents()
        {
            List<int> parents = new List<int> { -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15 };
            foreach (int wrist in new[] { 20, 21 })
            {
                for (int finger = 0; finger < 5; finger++)
                {
                    parents.Add(wrist);
                    parents.Add(parents.Count - 1);
                    parents.Add(parents.Count - 1);
                }
            }
            return parents.ToArray();
        }

        /// The model stands in a T-pose: arms along X, legs down, fingers along the arms.
        private static float[] Offsets()
        {
            float[] offsets = new float[3 * 55];
            Action<int, float, float, float> set = (joint, x, y, z) =>
            {
                offsets[3 * joint] = x;
                offsets[3 * joint + 1] = y;
                offsets[3 * joint + 2] = z;
            };
            for (int joint = 1; joint < 55; joint++) set(joint, 0, 0.1f, 0);
            foreach (int side in new[] { 0, 1 })
            {
                float x = side == 0 ? -1 : 1;
                set(1 + side, 0.1f * x, -0.1f, 0);
                set(4 + side, 0, -0.4f, 0);
                set(7 + side, 0, -0.4f, 0);
                set(10 + side, 0, -0.1f, 0.1f);
                set(13 + side, 0.1f * x, 0, 0);
                set(16 + side, 0.1f * x, 0, 0);
                set(18 + side, 0.3f * x, 0, 0);
                set(20 + side, 0.3f * x, 0, 0);
                for (int finger = 25 + 15 * side; finger < 40 + 15 * side; finger++) set(finger, 0.05f * x, 0, 0);
            }
            return offsets;
        }

        private static float[] AtRest()
        {
            float[] rotations = new float[4 * 55];
            for (int joint = 0; joint < 55; joint++) rotations[4 * joint + 3] = 1;
            return rotations;
        }

        private static void Turn(float[] rotations, int joint, float x, float y, float z, float w)
        {
            rotations[4 * joint] = x;
            rotations[4 * joint + 1] = y;
            rotations[4 * joint + 2] = z;
            rotations[4 * joint + 3] = w;
        }

        private static Bone At(int joint, float x, float y, float z, Quat? rotation = null)
        {
            return new Bone { Joint = joint, Place = new Vec(x, y, z), Rotation = rotation ?? Quat.Identity };
        }

        private static void Near(Vec wanted, Vec got, string what)
        {
            Assert.AreEqual(0, (wanted - got).Length, 1e-5, what + " " + got.X + " " + got.Y + " " + got.Z);
        }

        /// Direction of a bone from start to end after rotation: its rest direction, rotated from rest to now.
        private static Vec Points(Bone bone, Vec atRest, Quat now)
        {
            Quat back = new Quat(-bone.Rotation.X, -bone.Rotation.Y, -bone.Rotation.Z, bone.Rotation.W);
            return now * (back * atRest);
        }

        private static Quat[] Solve(Bone[] bones, float[] rotations)
        {
            Quat[] found = new Quat[bones.Length];
            new Retarget(Parents, Offsets(), bones).Rotate(rotations, found);
            return found;
        }

        [Test]
        public void a_figure_that_rests_as_the_model_does_takes_its_rotations()
        {
            Bone[] bones = { At(Pelvis, 0, 1, 0), At(Head, 0, 1.6f, 0) };
            float[] pose = AtRest();
            // Head turned a quarter to its left: in a left-handed frame, -90 degrees about up.
            Turn(pose, Head, 0, -Half, 0, Half);
            Quat[] found = Solve(bones, pose);
            Near(new Vec(0, 0, 1), found[0] * new Vec(0, 0, 1), "the hips look ahead");
            Near(new Vec(-1, 0, 0), found[1] * new Vec(0, 0, 1), "the head looks left");
        }

        [Test]
        public void turns_add_up_along_the_bones_that_a_figure_lacks()
        {
            Bone[] bones = { At(Pelvis, 0, 1, 0), At(Head, 0, 1.6f, 0) };
            float[] pose = AtRest();
            // An eighth of a turn to the left in the back and in the neck each, where the figure has no bones.
            float s = (float)Math.Sin(Math.PI / 8), c = (float)Math.Cos(Math.PI / 8);
            Turn(pose, Spine3, 0, -s, 0, c);
            Turn(pose, 12, 0, -s, 0, c);
            Near(new Vec(-1, 0, 0), Solve(bones, pose)[1] * new Vec(0, 0, 1), "the head looks left");
        }

        [Test]
        public void a_turn_is_made_in_its_parents_frame()
        {
            Bone[] bones = { At(Pelvis, 0, 1, 0), At(Head, 0, 1.6f, 0) };
            float[] pose = AtRest();
            // The hips look left, and the head, relative to them, looks up: +90 degrees about the ear-to-ear axis would
            // be down.
            Turn(pose, Pelvis, 0, -Half, 0, Half);
            Turn(pose, Head, -Half, 0, 0, Half);
            Quat[] found = Solve(bones, pose);
            Near(new Vec(-1, 0, 0), found[0] * new Vec(0, 0, 1), "the hips look left");
            Near(new Vec(0, 1, 0), found[1] * new Vec(0, 0, 1), "the face looks up");
            // The crown leans back, away from where the hips look, to the right.
            Near(new Vec(1, 0, 0), found[1] * new Vec(0, 1, 0), "the crown points right");
        }

        [Test]
        public void bones_keep_the_axes_that_their_tool_gave_them()
        {
            // The bone's own X axis runs along the arm to the left: half a turn about up.
            Quat along = new Quat(0, 1, 0, 0);
            Bone[] bones = { At(LeftShoulder, -0.2f, 1.4f, 0, along), At(LeftElbow, -0.5f, 1.4f, 0, along), At(LeftWrist, -0.8f, 1.4f, 0, along) };
            float[] pose = AtRest();
            Quat[] found = Solve(bones, pose);
            Near(new Vec(-1, 0, 0), found[0] * new Vec(1, 0, 0), "the upper arm's X at rest");
            // The elbow bends the forearm forward: left (-X) becomes forward (+Z), +90 degrees about up in a
            // left-handed frame.
            Turn(pose, LeftElbow, 0, Half, 0, Half);
            found = Solve(bones, pose);
            Near(new Vec(-1, 0, 0), found[0] * new Vec(1, 0, 0), "the upper arm's X");
            Near(new Vec(0, 0, 1), found[1] * new Vec(1, 0, 0), "the forearm's X");
        }

        [Test]
        public void a_figure_that_rests_in_an_A_stands_in_a_T_when_the_model_does()
        {
            // Left arm 45 degrees down; the hand has no bones and follows it.
            float d = 0.3f * Half;
            Bone[] bones = { At(LeftShoulder, -0.2f, 1.4f, 0), At(LeftElbow, -0.2f - d, 1.4f - d, 0), At(LeftWrist, -0.2f - 2 * d, 1.4f - 2 * d, 0) };
            Vec arm = new Vec(-Half, -Half, 0);
            Quat[] found = Solve(bones, AtRest());
            for (int i = 0; i < 3; i++) Near(new Vec(-1, 0, 0), Points(bones[i], arm, found[i]), "bone " + i);
            // The model lowers its arm by a quarter turn: the figure's arm hangs down whatever its rest pose. Left (-X)
            // becomes down (-Y): +90 degrees about Z.
            float[] pose = AtRest();
            Turn(pose, LeftShoulder, 0, 0, Half, Half);
            found = Solve(bones, pose);
            for (int i = 0; i < 3; i++) Near(new Vec(0, -1, 0), Points(bones[i], arm, found[i]), "bone " + i + " down");
        }

        [Test]
        public void a_bent_elbow_at_rest_is_straightened_too()
        {
            // Upper arm in the T-pose, forearm forward.
            Bone[] bones = { At(LeftShoulder, -0.2f, 1.4f, 0), At(LeftElbow, -0.5f, 1.4f, 0), At(LeftWrist, -0.5f, 1.4f, 0.3f) };
            Quat[] found = Solve(bones, AtRest());
            Near(new Vec(-1, 0, 0), Points(bones[0], new Vec(-1, 0, 0), found[0]), "upper arm");
            Near(new Vec(-1, 0, 0), Points(bones[1], new Vec(0, 0, 1), found[1]), "forearm");
        }

        [Test]
        public void fingers_point_where_the_model_points()
        {
            // The index finger rests 45 degrees forward of a straight hand.
            Bone[] bones =
            {
                At(LeftElbow, -0.5f, 1.4f, 0), At(LeftWrist, -0.8f, 1.4f, 0), At(LeftMiddle1, -0.9f, 1.4f, 0),
                At(LeftIndex1, -0.9f, 1.4f, 0.02f), At(LeftIndex1 + 1, -0.92f, 1.4f, 0.04f), At(LeftIndex1 + 2, -0.94f, 1.4f, 0.06f),
            };
            Quat[] found = Solve(bones, AtRest());
            for (int i = 3; i < 6; i++) Near(new Vec(-1, 0, 0), Points(bones[i], new Vec(-Half, 0, Half), found[i]), "phalanx " + i);
        }

        [Test]
        public void hips_stand_as_high_as_the_figure_is()
        {
            // Legs of 1 m put the model's hips at 1 m; the figure's hips are at half of that.
            Retarget small = new Retarget(Parents, Offsets(), new[] { At(Pelvis, 0.02f, 0.5f, -0.03f) });
            Assert.AreEqual(0.5, small.Scale, 1e-6);
            Near(new Vec(0.02f, 0.5f, -0.03f), small.Hips(new float[] { 0, 1, 0 }), "at rest");
            Near(new Vec(0.52f, 0.45f, 0.97f), small.Hips(new float[] { 1, 0.9f, 2 }), "a step");
        }

        [Test]
        public void a_short_back_ends_where_the_arms_are()
        {
            Assert.AreEqual("3 6 9", string.Join(" ", Retarget.Back(3)));
            Assert.AreEqual("3 9", string.Join(" ", Retarget.Back(2)));
            Assert.AreEqual("9", string.Join(" ", Retarget.Back(1)));
        }

        [Test]
        public void the_turn_between_two_directions_is_the_shortest()
        {
            Vec[] all = { new Vec(1, 0, 0), new Vec(0, -3, 0), new Vec(0.3f, 0.4f, -0.5f), new Vec(-1, 0, 0), new Vec(-1, 1e-4f, 0) };
            foreach (Vec from in all)
            {
                foreach (Vec to in all)
                {
                    Vec turned = Quat.Between(from, to) * from;
                    Near((1 / to.Length) * to, (1 / turned.Length) * turned, "turned");
                }
            }
            Quat quarter = Quat.Between(new Vec(1, 0, 0), new Vec(0, 1, 0));
            Assert.AreEqual(Half, quarter.Z, 1e-6);
            Assert.AreEqual(Half, quarter.W, 1e-6);
        }
    }
}
