// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// Poses on a figure by the library's retargeter, with the volume of the figure's meshes: arms keep out of the body.
    /// </summary>
    internal sealed class BodyRetarget : IDisposable
    {
        private readonly RigRetarget rig;
        private readonly int[] parents;
        private readonly float[] turns, place = new float[3];

        /// <summary>Throws if the figure has no arms or legs. Adds what could not be measured to the notes.</summary>
        public BodyRetarget(Model model, HumanFigure figure, Quaternion[] rotations, Vector3[] places, float gain, List<string> notes)
        {
            parents = figure.Parents();
            RigAtRest rest = new RigAtRest { Parents = parents, Joints = figure.Joints(), Gain = gain };
            rest.Places = new float[3 * parents.Length];
            rest.Rotations = new float[4 * parents.Length];
            for (int i = 0; i < parents.Length; i++)
            {
                Put(places[i], rest.Places, 3 * i);
                Quaternion q = rotations[i];
                rest.Rotations[4 * i] = q.x;
                rest.Rotations[4 * i + 1] = q.y;
                rest.Rotations[4 * i + 2] = q.z;
                rest.Rotations[4 * i + 3] = q.w;
            }
            new Surface(figure, rotations, places, notes).Fill(rest);
            rig = new RigRetarget(model, rest);
            turns = new float[4 * parents.Length];
        }

        /// <summary>
        /// Rotations of the bones in the root's frame, and the place of the hips, for a pose so many seconds after the last
        /// one. Does not allocate.
        /// </summary>
        public void Apply(float seconds, float[] rotations, float[] translation, Quat[] into, ref Vec hips)
        {
            if (rig.SetStep(seconds) != Status.Ok) return;
            if (rig.Apply(rotations, translation, turns, place) != Status.Ok) return;
            for (int i = 0; i < parents.Length; i++)
            {
                Quat local = new Quat(turns[4 * i], turns[4 * i + 1], turns[4 * i + 2], turns[4 * i + 3]);
                into[i] = parents[i] < 0 ? local : into[parents[i]] * local;
            }
            hips = new Vec(place[0], place[1], place[2]);
        }

        public void Dispose()
        {
            rig.Dispose();
        }

        private static void Put(Vector3 v, float[] into, int at)
        {
            into[at] = v.x;
            into[at + 1] = v.y;
            into[at + 2] = v.z;
        }

        /// The figure's meshes at rest.
        private sealed class Surface
        {
            private readonly HumanFigure figure;
            private readonly Quaternion[] turns;
            private readonly Vector3[] places;
            private readonly List<string> notes;
            private readonly List<float> vertices = new List<float>();
            private readonly List<int> bones = new List<int>(), indices = new List<int>();

            public Surface(HumanFigure figure, Quaternion[] turns, Vector3[] places, List<string> notes)
            {
                this.figure = figure;
                this.turns = turns;
                this.places = places;
                this.notes = notes;
                foreach (SkinnedMeshRenderer skin in figure.Root.GetComponentsInChildren<SkinnedMeshRenderer>(false)) Add(skin);
                foreach (MeshFilter part in figure.Root.GetComponentsInChildren<MeshFilter>(false)) Add(part);
            }

            public void Fill(RigAtRest rest)
            {
                if (bones.Count == 0) return;
                rest.Vertices = vertices.ToArray();
                rest.VertexBones = bones.ToArray();
                rest.Indices = indices.ToArray();
            }

            private void Add(SkinnedMeshRenderer skin)
            {
                Mesh mesh = skin.sharedMesh;
                if (!IsReadable(mesh)) return;
                Transform[] rig = skin.bones;
                Matrix4x4[] binds = mesh.bindposes;
                BoneWeight[] weights = mesh.boneWeights;
                Vector3[] at = mesh.vertices;
                if (weights.Length != at.Length || binds.Length != rig.Length)
                {
                    notes.Add(mesh.name + " has no bone weights");
                    return;
                }
                Begin(mesh);
                for (int i = 0; i < at.Length; i++)
                {
                    // The first weight is the largest.
                    int bone = weights[i].boneIndex0;
                    Transform of = bone >= 0 && bone < rig.Length ? rig[bone] : null;
                    if (of == null) Put(skin.transform.TransformPoint(at[i]), -1);
                    else Put(of.TransformPoint(binds[bone].MultiplyPoint3x4(at[i])), figure.BoneOf(of), weights[i].weight0 >= 0.5f);
                }
            }

            /// A part that hangs on a bone.
            private void Add(MeshFilter part)
            {
                Mesh mesh = part.sharedMesh;
                int bone = figure.BoneOf(part.transform);
                if (bone < 0 || !IsReadable(mesh)) return;
                Begin(mesh);
                foreach (Vector3 at in mesh.vertices) Put(part.transform.TransformPoint(at), bone);
            }

            private bool IsReadable(Mesh mesh)
            {
                if (mesh == null || mesh.isReadable) return mesh != null;
                notes.Add(mesh.name + " cannot be read: turn Read/Write on in its import settings");
                return false;
            }

            private void Begin(Mesh mesh)
            {
                foreach (int index in mesh.triangles) indices.Add(bones.Count + index);
            }

            /// Adds a point of the world, as it is where its bone is at rest.
            private void Put(Vector3 world, int bone, bool counts = true)
            {
                Vector3 place = figure.Root.InverseTransformPoint(world);
                if (bone >= 0)
                {
                    Quaternion turn;
                    Vector3 now;
                    figure.Now(bone, out turn, out now);
                    place = places[bone] + turns[bone] * Quaternion.Inverse(turn) * (place - now);
                }
                vertices.Add(place.x);
                vertices.Add(place.y);
                vertices.Add(place.z);
                bones.Add(counts ? bone : -1);
            }
        }
    }
}
