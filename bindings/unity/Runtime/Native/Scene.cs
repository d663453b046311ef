// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using System.Text;

namespace Umo
{
    /// <summary>
    /// Avatars that know each other, and people with microphones: up to <see cref="Native.SceneMemberCount"/> members,
    /// each a number from 1 on. Only the constructor throws; every other call returns a status and does not allocate,
    /// except Add and LastError. After Dispose, calls return <see cref="Status.InvalidHandle"/>.
    /// </summary>
    public sealed unsafe class Scene : IDisposable
    {
        private readonly SceneHandle handle;
        /// A session that is collected would leave the scene.
        private readonly Dictionary<uint, Session> sessions = new Dictionary<uint, Session>();

        /// <summary>An empty scene. Its random choices follow from the seed.</summary>
        public Scene(ulong seed = 0)
        {
            Native.Require();
            IntPtr raw;
            UmoException.Check(Native.umo_scene_new(seed, &raw));
            handle = new SceneHandle(raw);
        }

        /// <summary>
        /// Adds an avatar, or with a null session a person, whose voice comes by PushAudio. A session may be in one scene at
        /// a time; one that is disposed leaves it with the next Update. Allocates.
        /// </summary>
        public Status Add(Session session, Place place, out uint member)
        {
            uint added = 0;
            Status status = Native.umo_scene_add(handle.Raw, session == null ? IntPtr.Zero : session.Raw, &place, &added);
            GC.KeepAlive(session);
            GC.KeepAlive(this);
            if (status == Status.Ok && session != null) sessions[added] = session;
            member = added;
            return status;
        }

        /// <summary>Removes a member. Its session goes on alone.</summary>
        public Status Remove(uint member)
        {
            Status status = Native.umo_scene_remove(handle.Raw, member);
            GC.KeepAlive(this);
            sessions.Remove(member);
            return status;
        }

        /// <summary>Moves a member.</summary>
        public Status SetPlace(uint member, Place place)
        {
            Status status = Native.umo_scene_set_place(handle.Raw, member, &place);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Makes a member look at another, whatever is said; with 0 the scene chooses again.</summary>
        public Status SetTarget(uint member, uint other)
        {
            Status status = Native.umo_scene_set_target(handle.Raw, member, other, Axes.Gltf, null);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Makes a member look at a point of the scene, whatever is said.</summary>
        public Status SetTarget(uint member, Axes axes, float x, float y, float z)
        {
            float* point = stackalloc float[3];
            point[0] = x;
            point[1] = y;
            point[2] = z;
            Status status = Native.umo_scene_set_target(handle.Raw, member, 0, axes, point);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>All parts of a member that a scene plays.</summary>
        public const ScenePart AllParts = ScenePart.Look | ScenePart.Nod | ScenePart.Smile | ScenePart.Mirror | ScenePart.Yield;

        /// <summary>Sets the parts that the scene plays of a member; all at first.</summary>
        public Status SetAllowed(uint member, ScenePart parts)
        {
            Status status = Native.umo_scene_set_allowed(handle.Raw, member, parts);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>
        /// Feeds the voice of a member without a session: samples of any rate and number of channels, full scale 1, of which
        /// only the loudness is used. Any thread may call it.
        /// </summary>
        public Status PushAudio(uint member, float[] samples, int start, int count)
        {
            if (samples == null) return Status.NullPointer;
            if (start < 0 || count < 0 || start > samples.Length - count) return Status.InvalidArgument;
            Status status;
            float none = 0;
            fixed (float* first = samples)
            {
                status = Native.umo_scene_push_audio(handle.Raw, member, count == 0 ? &none : first + start, (UIntPtr)count);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Advances the scene: once per frame, before frames are pulled or sampled.</summary>
        public Status Update(double seconds)
        {
            Status status = Native.umo_scene_update(handle.Raw, seconds);
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>The member that has the floor; 0 for nobody.</summary>
        public Status Floor(out uint member)
        {
            uint found = 0;
            Status status = Native.umo_scene_floor(handle.Raw, &found);
            GC.KeepAlive(this);
            member = found;
            return status;
        }

        /// <summary>State of a member.</summary>
        public Status GetMember(uint member, out Member info)
        {
            Member found = new Member { StructSize = (uint)sizeof(Member) };
            Status status = Native.umo_scene_member(handle.Raw, member, &found);
            GC.KeepAlive(this);
            info = found;
            return status;
        }

        /// <summary>Maximum size in bytes of a saved state; it changes with the members.</summary>
        public Status StateSize(out int size)
        {
            UIntPtr got;
            Status status = Native.umo_scene_state_size(handle.Raw, &got);
            GC.KeepAlive(this);
            size = status == Status.Ok ? checked((int)got) : 0;
            return status;
        }

        /// <summary>Saves the scene and the sessions of its members.</summary>
        public Status Save(byte[] state, out int written)
        {
            written = 0;
            if (state == null) return Status.NullPointer;
            UIntPtr got;
            Status status;
            byte none = 0;
            fixed (byte* first = state)
            {
                status = Native.umo_scene_save(handle.Raw, state.Length == 0 ? &none : first, (UIntPtr)state.Length, &got);
            }
            GC.KeepAlive(this);
            if (status == Status.Ok) written = (int)got;
            return status;
        }

        /// <summary>Restores a state of this scene, or of one to which the same members were added in the same order.</summary>
        public Status Restore(byte[] state, int size)
        {
            if (state == null) return Status.NullPointer;
            if (size < 0 || size > state.Length) return Status.InvalidArgument;
            Status status;
            byte none = 0;
            fixed (byte* first = state)
            {
                status = Native.umo_scene_restore(handle.Raw, state.Length == 0 ? &none : first, (UIntPtr)size);
            }
            GC.KeepAlive(this);
            return status;
        }

        /// <summary>Detail of the last failed call from any thread; may be empty. Allocates.</summary>
        public string LastError()
        {
            byte* buffer = stackalloc byte[Native.ErrorSize];
            UIntPtr length;
            Status status = Native.umo_scene_last_error(handle.Raw, buffer, (UIntPtr)Native.ErrorSize, &length);
            GC.KeepAlive(this);
            return status == Status.Ok ? Encoding.UTF8.GetString(buffer, (int)length) : "";
        }

        /// <summary>Frees the scene; its sessions go on alone. Dispose them before or after.</summary>
        public void Dispose()
        {
            handle.Dispose();
            sessions.Clear();
        }
    }

    public unsafe partial struct Place
    {
        /// <summary>
        /// A place on the floor. Facing is an angle about the upward axis in radians: 0 is the axis along which an avatar
        /// looks, and positive is to its right in Unity's and Unreal's axes, to its left in glTF's.
        /// </summary>
        public Place(Axes axes, float x, float y, float z, float facing = 0, float eyeHeight = 1.6f)
        {
            StructSize = (uint)sizeof(Place);
            Axes = axes;
            Facing = facing;
            EyeHeight = eyeHeight;
            fixed (float* position = Position)
            {
                position[0] = x;
                position[1] = y;
                position[2] = z;
            }
        }
    }
}
