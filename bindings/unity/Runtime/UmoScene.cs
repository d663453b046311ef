// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>A member of a scene: an avatar, or a person with a place and a voice.</summary>
    [Serializable]
    public sealed class UmoSceneMember
    {
        [Tooltip("The avatar. None: a person.")]
        public UmoAvatar avatar;
        [Tooltip("A person's eyes, such as the camera. An avatar has its own place.")]
        public Transform eyes;
        [Tooltip("A person's voice. Or call UmoScene.PushAudio.")]
        public AudioSource voice;
        [Tooltip("Height of an avatar's eyes above the floor in metres. 0: that of its eye or head bone.")]
        [Min(0)] public float eyeHeight = 0;
        [Tooltip("What it looks at, whatever is said. None: the scene chooses. An avatar's own Look At comes first.")]
        public Transform lookAt;
        [Tooltip("The parts that the scene plays of an avatar.")]
        public ScenePart parts = Scene.AllParts;

        internal uint Id;
        internal Session Session;
        internal bool Looks;
        internal ScenePart Sent;
        internal float Height;

        internal Transform Body { get { return avatar != null ? avatar.Body : eyes; } }
        internal bool IsThere { get { return avatar != null ? avatar.Session != null : eyes != null; } }
        internal Session Wanted { get { return avatar != null ? avatar.Session : null; } }
    }

    /// <summary>
    /// Avatars that know each other: who speaks has the floor, the others look there, nod and make room. Works once per
    /// frame before the avatars do.
    /// </summary>
    [AddComponentMenu("Audio/umo Scene")]
    [DisallowMultipleComponent]
    [DefaultExecutionOrder(900)]
    public sealed class UmoScene : MonoBehaviour
    {
        [Tooltip("Empty: the avatars on this object and its children. While it is enabled, use Add and Remove.")]
        public List<UmoSceneMember> members = new List<UmoSceneMember>();
        [Tooltip("The random choices of the scene follow from it. Applied when enabled.")]
        public int seed = 0;

        private const float HeightOfEyes = 1.6f;
        private Scene scene;
        private readonly float[] heard = new float[4096];

        /// <summary>Reason why the scene does nothing; else empty.</summary>
        public string Error { get; private set; } = "";

        /// <summary>The member that has the floor; null for nobody.</summary>
        public UmoSceneMember Floor { get; private set; }

        /// <summary>Another member has the floor, or nobody (null).</summary>
        public event Action<UmoSceneMember> FloorChanged;

        /// <summary>The scene, for anything this component does not offer; null before an avatar has a session.</summary>
        public Scene Scene { get { return scene; } }

        private void OnEnable()
        {
            Error = "";
            if (members.Count > 0) return;
            foreach (UmoAvatar avatar in GetComponentsInChildren<UmoAvatar>(false)) members.Add(new UmoSceneMember { avatar = avatar });
        }

        private void OnDisable() { End(); }

        /// <summary>Adds a member while the scene runs.</summary>
        public void Add(UmoSceneMember member) { members.Add(member); }

        /// <summary>Removes a member while the scene runs. Its avatar goes on alone.</summary>
        public void Remove(UmoSceneMember member)
        {
            members.Remove(member);
            Leave(member);
        }

        /// <summary>State of a member: its role, its nods, whom it attends to. False if it is not in the scene.</summary>
        public bool GetInfo(UmoSceneMember member, out Member info)
        {
            info = default(Member);
            return scene != null && member.Id != 0 && scene.GetMember(member.Id, out info) == Status.Ok;
        }

        /// <summary>
        /// A person's voice, as from a microphone or the network: any rate and number of channels, full scale 1. Any thread
        /// may call it.
        /// </summary>
        public void PushAudio(UmoSceneMember person, float[] samples, int start, int count)
        {
            Scene now = scene;
            if (now != null) now.PushAudio(person.Id, samples, start, count);
        }

        private void LateUpdate()
        {
            if (Error.Length > 0 || (scene == null && !Begin())) return;
            foreach (UmoSceneMember member in members)
            {
                if (!Follow(member)) return;
            }
            foreach (UmoSceneMember member in members)
            {
                if (member.Id != 0 && !(Look(member) && Listen(member))) return;
            }
            uint floor;
            if (!Works(scene.Update(UmoAvatar.FrameSeconds)) || !Works(scene.Floor(out floor))) return;
            UmoSceneMember speaks = Find(floor);
            if (speaks == Floor) return;
            Floor = speaks;
            if (FloorChanged != null) FloorChanged(speaks);
        }

        /// In WebGL players the library is there with the first session.
        private bool Begin()
        {
            bool hasSession = false;
            foreach (UmoSceneMember member in members) hasSession |= member.Wanted != null;
            if (!hasSession) return false;
            try
            {
                scene = new Scene((ulong)seed);
            }
            catch (UmoException error)
            {
                Fail(error.Message);
            }
            catch (EntryPointNotFoundException error)
            {
                Fail("the native library is of another version: " + error.Message);
            }
            return scene != null;
        }

        private void End()
        {
            foreach (UmoSceneMember member in members)
            {
                member.Id = 0;
                member.Session = null;
            }
            if (scene != null) scene.Dispose();
            scene = null;
            Floor = null;
        }

        /// Adds, moves or removes a member. An avatar makes a new session when the mixer's format changes.
        private bool Follow(UmoSceneMember member)
        {
            Session session = member.Wanted;
            if (member.Id != 0 && (!member.IsThere || session != member.Session)) Leave(member);
            if (!member.IsThere) return true;
            if (member.Id != 0) return Works(scene.SetPlace(member.Id, PlaceOf(member)));
            member.Height = member.eyeHeight > 0 ? member.eyeHeight : member.avatar != null ? member.avatar.EyeHeight : HeightOfEyes;
            member.Session = session;
            member.Looks = false;
            member.Sent = Scene.AllParts;
            return Works(scene.Add(session, PlaceOf(member), out member.Id));
        }

        private void Leave(UmoSceneMember member)
        {
            // A disposed session has left by itself.
            if (scene != null && member.Id != 0) scene.Remove(member.Id);
            member.Id = 0;
            member.Session = null;
        }

        /// On the floor: a person's transform is at its eyes.
        private static Place PlaceOf(UmoSceneMember member)
        {
            Transform body = member.Body;
            Vector3 at = body.position, ahead = body.forward;
            float floor = member.avatar != null ? at.y : at.y - member.Height;
            return new Place(Axes.Unity, at.x, floor, at.z, (float)Math.Atan2(ahead.x, ahead.z), member.Height);
        }

        private bool Look(UmoSceneMember member)
        {
            if (member.parts != member.Sent)
            {
                member.Sent = member.parts;
                if (!Works(scene.SetAllowed(member.Id, member.parts & Scene.AllParts))) return false;
            }
            if (member.lookAt == null)
            {
                bool looked = member.Looks;
                member.Looks = false;
                return !looked || Works(scene.SetTarget(member.Id, 0));
            }
            member.Looks = true;
            foreach (UmoSceneMember other in members)
            {
                bool isOther = other != member && other.Id != 0 && (other.Body == member.lookAt || (other.avatar != null && other.avatar.transform == member.lookAt));
                if (isOther) return Works(scene.SetTarget(member.Id, other.Id));
            }
            Vector3 at = member.lookAt.position;
            return Works(scene.SetTarget(member.Id, Axes.Unity, at.x, at.y, at.z));
        }

        /// Sends a person's voice since the last frame.
        private bool Listen(UmoSceneMember member)
        {
            if (member.Session != null || member.voice == null || !member.voice.isPlaying) return true;
            int count = Math.Min(Mathf.RoundToInt((float)(UmoAvatar.FrameSeconds * AudioSettings.outputSampleRate)), heard.Length);
            member.voice.GetOutputData(heard, 0);
            return Works(scene.PushAudio(member.Id, heard, heard.Length - count, count));
        }

        private UmoSceneMember Find(uint id)
        {
            foreach (UmoSceneMember member in members)
            {
                if (id != 0 && member.Id == id) return member;
            }
            return null;
        }

        private bool Works(Status status)
        {
            if (status == Status.Ok || status == Status.Busy) return true;
            Fail(UmoException.Describe(status) + ": " + scene.LastError());
            return false;
        }

        private void Fail(string message)
        {
            Error = message;
            Debug.LogError("umo: " + message, this);
            End();
        }
    }
}
