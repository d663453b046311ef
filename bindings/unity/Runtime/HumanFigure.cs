// SPDX-License-Identifier: MIT OR Apache-2.0

using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>Bones of a humanoid, and the model joints that drive them.</summary>
    internal sealed class HumanFigure
    {
        private static readonly HumanBodyBones[] Back = { HumanBodyBones.Spine, HumanBodyBones.Chest, HumanBodyBones.UpperChest };

        /// Without the spine, whose bones depend on how many there are.
        private static readonly Dictionary<int, HumanBodyBones> Bones = new Dictionary<int, HumanBodyBones>
        {
            { 0, HumanBodyBones.Hips }, { 12, HumanBodyBones.Neck }, { 15, HumanBodyBones.Head },
            { 1, HumanBodyBones.LeftUpperLeg }, { 4, HumanBodyBones.LeftLowerLeg }, { 7, HumanBodyBones.LeftFoot }, { 10, HumanBodyBones.LeftToes },
            { 2, HumanBodyBones.RightUpperLeg }, { 5, HumanBodyBones.RightLowerLeg }, { 8, HumanBodyBones.RightFoot }, { 11, HumanBodyBones.RightToes },
            { 13, HumanBodyBones.LeftShoulder }, { 16, HumanBodyBones.LeftUpperArm }, { 18, HumanBodyBones.LeftLowerArm }, { 20, HumanBodyBones.LeftHand },
            { 14, HumanBodyBones.RightShoulder }, { 17, HumanBodyBones.RightUpperArm }, { 19, HumanBodyBones.RightLowerArm }, { 21, HumanBodyBones.RightHand },
            { 22, HumanBodyBones.Jaw }, { 23, HumanBodyBones.LeftEye }, { 24, HumanBodyBones.RightEye },
            { 25, HumanBodyBones.LeftIndexProximal }, { 26, HumanBodyBones.LeftIndexIntermediate }, { 27, HumanBodyBones.LeftIndexDistal },
            { 28, HumanBodyBones.LeftMiddleProximal }, { 29, HumanBodyBones.LeftMiddleIntermediate }, { 30, HumanBodyBones.LeftMiddleDistal },
            { 31, HumanBodyBones.LeftLittleProximal }, { 32, HumanBodyBones.LeftLittleIntermediate }, { 33, HumanBodyBones.LeftLittleDistal },
            { 34, HumanBodyBones.LeftRingProximal }, { 35, HumanBodyBones.LeftRingIntermediate }, { 36, HumanBodyBones.LeftRingDistal },
            { 37, HumanBodyBones.LeftThumbProximal }, { 38, HumanBodyBones.LeftThumbIntermediate }, { 39, HumanBodyBones.LeftThumbDistal },
            { 40, HumanBodyBones.RightIndexProximal }, { 41, HumanBodyBones.RightIndexIntermediate }, { 42, HumanBodyBones.RightIndexDistal },
            { 43, HumanBodyBones.RightMiddleProximal }, { 44, HumanBodyBones.RightMiddleIntermediate }, { 45, HumanBodyBones.RightMiddleDistal },
            { 46, HumanBodyBones.RightLittleProximal }, { 47, HumanBodyBones.RightLittleIntermediate }, { 48, HumanBodyBones.RightLittleDistal },
            { 49, HumanBodyBones.RightRingProximal }, { 50, HumanBodyBones.RightRingIntermediate }, { 51, HumanBodyBones.RightRingDistal },
            { 52, HumanBodyBones.RightThumbProximal }, { 53, HumanBodyBones.RightThumbIntermediate }, { 54, HumanBodyBones.RightThumbDistal },
        };

        /// Height of eyes above the head bone, as a share of that bone's height: an adult's are 8 cm above it.
        private const float EyesAboveHead = 0.05f;

        private readonly Transform root;
        private readonly List<Transform> transforms = new List<Transform>();
        private readonly List<int> joints = new List<int>();

        /// <summary>Parents come before their children. A jaw or eye that is driven by blend shapes is not rotated as well.</summary>
        public HumanFigure(Animator animator, bool withFace)
        {
            root = animator.transform;
            EyeHeight = HeightOfEyes(animator);
            List<Transform> back = new List<Transform>();
            foreach (HumanBodyBones bone in Back)
            {
                Transform found = animator.GetBoneTransform(bone);
                if (found != null) back.Add(found);
            }
            int[] backJoints = Retarget.Back(back.Count);
            for (int joint = 0; joint < Native.JointCount; joint++)
            {
                Transform found = null;
                HumanBodyBones bone;
                int inBack = System.Array.IndexOf(backJoints, joint);
                if (inBack >= 0) found = back[inBack];
                else if (Bones.TryGetValue(joint, out bone) && (withFace || joint < 22 || joint > 24)) found = animator.GetBoneTransform(bone);
                if (found == null) continue;
                transforms.Add(found);
                joints.Add(joint);
            }
        }

        public int Count { get { return transforms.Count; } }

        public Transform Root { get { return root; } }

        /// <summary>Height of the eyes above the root when it was made.</summary>
        public float EyeHeight { get; private set; }

        private static float HeightOfEyes(Animator animator)
        {
            Transform eye = animator.GetBoneTransform(HumanBodyBones.LeftEye);
            float floor = animator.transform.position.y;
            if (eye != null) return eye.position.y - floor;
            Transform head = animator.GetBoneTransform(HumanBodyBones.Head);
            return head == null ? 1.6f : (1 + EyesAboveHead) * (head.position.y - floor);
        }

        /// <summary>Current rotations and positions, in the root's frame.</summary>
        public void Capture(out Quaternion[] rotations, out Vector3[] places)
        {
            rotations = new Quaternion[Count];
            places = new Vector3[Count];
            for (int i = 0; i < Count; i++) Now(i, out rotations[i], out places[i]);
        }

        /// <summary>Current rotation and position of a bone, in the root's frame.</summary>
        public void Now(int bone, out Quaternion rotation, out Vector3 place)
        {
            rotation = Quaternion.Inverse(root.rotation) * transforms[bone].rotation;
            place = root.InverseTransformPoint(transforms[bone].position);
        }

        /// <summary>Joint of each bone.</summary>
        public int[] Joints()
        {
            return joints.ToArray();
        }

        /// <summary>For each bone the nearest one above it, or -1.</summary>
        public int[] Parents()
        {
            int[] parents = new int[Count];
            for (int i = 0; i < Count; i++) parents[i] = BoneOf(transforms[i].parent);
            return parents;
        }

        /// <summary>The bone that a transform is or hangs on, or -1.</summary>
        public int BoneOf(Transform at)
        {
            for (; at != null && at != root; at = at.parent)
            {
                int bone = transforms.IndexOf(at);
                if (bone >= 0) return bone;
            }
            return -1;
        }

        public Bone[] Rest(Quaternion[] rotations, Vector3[] places)
        {
            Bone[] bones = new Bone[Count];
            for (int i = 0; i < Count; i++)
            {
                Quaternion q = rotations[i];
                bones[i].Joint = joints[i];
                bones[i].Rotation = new Quat(q.x, q.y, q.z, q.w);
                bones[i].Place = new Vec(places[i].x, places[i].y, places[i].z);
            }
            return bones;
        }

        public void Show(Quat[] rotations, Vec hips, bool moves)
        {
            if (Count == 0) return;
            if (moves && joints[0] == 0) transforms[0].position = root.TransformPoint(new Vector3(hips.X, hips.Y, hips.Z));
            Quaternion turn = root.rotation;
            for (int i = 0; i < Count; i++)
            {
                Quat q = rotations[i];
                transforms[i].rotation = turn * new Quaternion(q.X, q.Y, q.Z, q.W);
            }
        }
    }
}
