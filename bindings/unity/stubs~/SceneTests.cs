// SPDX-License-Identifier: MIT OR Apache-2.0
// The scene component in a stand-in for Unity with the real library: two avatars, of which one speaks.

using System;
using System.IO;
using System.Reflection;
using System.Threading;
using NUnit.Framework;
using UnityEngine;

namespace Umo.Unity.Tests
{
    public sealed class SceneTests
    {
        private const int Rate = 16000;
        private const double Frame = 1 / 60.0;

        private readonly GameObject room = new GameObject("room");
        private readonly UmoScene scene;
        private readonly UmoAvatar[] avatars = new UmoAvatar[2];
        private readonly float[] speech;
        private int said, begun;
        private double time;

        public SceneTests()
        {
            Debug.Said.Clear();
            AudioSettings.outputSampleRate = Rate;
            AudioSettings.speakerMode = AudioSpeakerMode.Mono;
            Application.platform = RuntimePlatform.LinuxPlayer;
            Application.streamingAssetsPath = Path.GetDirectoryName(Runner.Arguments[0]);
            byte[] wav = File.ReadAllBytes(Runner.Arguments[1]);
            speech = new float[(wav.Length - 44) / 2];
            for (int i = 0; i < speech.Length; i++) speech[i] = BitConverter.ToInt16(wav, 44 + 2 * i) / 32768f;
            for (int i = 0; i < 2; i++)
            {
                GameObject made = new GameObject("avatar", room);
                made.AddComponent<AudioSource>().Play();
                avatars[i] = made.AddComponent<UmoAvatar>();
                avatars[i].model = Path.GetFileName(Runner.Arguments[0]);
                avatars[i].delayVoice = false;
            }
            scene = room.AddComponent<UmoScene>();
        }

        private UmoAvatar Speaker { get { return avatars[0]; } }
        private UmoAvatar Listener { get { return avatars[1]; } }

        private void Enable()
        {
            begun = said;
            foreach (UmoAvatar avatar in avatars) GameObject.Send(avatar, "OnEnable");
            GameObject.Send(scene, "OnEnable");
        }

        private void Disable()
        {
            GameObject.Send(scene, "OnDisable");
            foreach (UmoAvatar avatar in avatars) GameObject.Send(avatar, "OnDisable");
            Assert.AreEqual("", string.Join("; ", Debug.Said));
        }

        /// Runs sound and frames for the given time. The engine is waited for, so that a slow machine changes nothing.
        private void Run(double seconds, Action each = null)
        {
            float[] block = new float[Rate / 50];
            Time.unscaledDeltaTime = (float)Frame;
            for (double end = time + seconds; time < end; time += Frame)
            {
                for (; said < time * Rate; said += block.Length)
                {
                    for (int i = 0; i < 2; i++)
                    {
                        Array.Clear(block, 0, block.Length);
                        if (i == 0 && said + block.Length <= speech.Length) Array.Copy(speech, said, block, 0, block.Length);
                        GameObject.Send(avatars[i], "OnAudioFilterRead", block, 1);
                    }
                }
                foreach (UmoAvatar avatar in avatars) Settle(avatar);
                GameObject.Send(scene, "LateUpdate");
                foreach (UmoAvatar avatar in avatars) GameObject.Send(avatar, "LateUpdate");
                if (each != null) each();
            }
        }

        private void Settle(UmoAvatar avatar)
        {
            Latency latency;
            Stats stats;
            avatar.Session.GetLatency(out latency);
            long due = (said - begun - (long)latency.AlgorithmicSamples - Rate / 20) * 30 / Rate;
            for (int tries = 0; tries < 20000; tries++)
            {
                avatar.Session.GetStats(out stats);
                if ((long)stats.Frames >= due) return;
                Thread.Sleep(1);
            }
            Assert.IsTrue(false, "the engine computes nothing");
        }

        private static readonly FieldInfo FrameField = typeof(UmoAvatar).GetField("frame", BindingFlags.NonPublic | BindingFlags.Instance);

        /// Turn of neck and head to the right, radians.
        private static double Yaw(UmoAvatar avatar)
        {
            float[] rotations = new float[4 * Native.JointCount];
            ((Frames)FrameField.GetValue(avatar)).Rotations(0, rotations);
            const int Neck = 12, Head = 15;
            return 2 * Math.Atan2(rotations[4 * Neck + 1], rotations[4 * Neck + 3]) + 2 * Math.Atan2(rotations[4 * Head + 1], rotations[4 * Head + 3]);
        }

        /// Mean turn of the listener while the speaker stands at x.
        private double Turn(float x)
        {
            said = 0;
            time = 0;
            Speaker.transform.localPosition = new Vector3(x, 0, 1);
            Speaker.transform.localRotation = new Quaternion(0, 1, 0, 0);
            Enable();
            Run(2.2);
            Assert.IsTrue(scene.Floor != null && scene.Floor.avatar == Speaker, "who speaks has the floor");
            Member info;
            Assert.IsTrue(scene.GetInfo(scene.members[1], out info) && info.Role == Role.Listening, "the other listens");
            double sum = 0;
            int count = 0;
            Run(0.8, () =>
            {
                sum += Yaw(Listener);
                count++;
            });
            Disable();
            return sum / count;
        }

        [Test]
        public void the_listener_turns_to_who_speaks()
        {
            double right = Turn(1.5f), left = Turn(-1.5f);
            Assert.IsTrue(right - left > 0.2, "turned by " + right + " and " + left);
        }

        [Test]
        public void a_person_speaks_and_a_target_is_looked_at()
        {
            GameObject camera = new GameObject("camera");
            camera.transform.localPosition = new Vector3(0, 1.7f, 2);
            AudioSource microphone = camera.AddComponent<AudioSource>();
            UmoSceneMember person = new UmoSceneMember { eyes = camera.transform, voice = microphone };
            UmoSceneMember heard = null;
            scene.FloorChanged += member => heard = member;
            said = speech.Length;
            time = said / (double)Rate;
            Enable();
            scene.Add(person);
            scene.members[0].parts = ScenePart.Nod;
            scene.members[1].lookAt = Speaker.transform;
            microphone.Play();
            Run(1);
            Assert.IsTrue(scene.Floor == person && heard == person, "the person has the floor");
            Member info;
            Assert.IsTrue(scene.GetInfo(scene.members[1], out info) && info.AttendsTo == 1, "it looks where it is told to");
            scene.Remove(person);
            Run(0.1);
            Assert.IsTrue(scene.Floor == null && heard == null, "nobody has the floor");
            // An avatar that goes leaves the scene, and comes back as another member.
            GameObject.Send(Speaker, "OnDisable");
            GameObject.Send(scene, "LateUpdate");
            Assert.IsTrue(!scene.GetInfo(scene.members[0], out info), "it has left");
            GameObject.Send(Speaker, "OnEnable");
            GameObject.Send(scene, "LateUpdate");
            Assert.IsTrue(scene.GetInfo(scene.members[0], out info), "it is there again");
            Disable();
        }

        [Test]
        public void a_frame_allocates_nothing()
        {
            Func<long> allocated = (Func<long>)Delegate.CreateDelegate(typeof(Func<long>),
                typeof(GC).GetMethod("GetAllocatedBytesForCurrentThread", BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.Static));
            Action update = (Action)Delegate.CreateDelegate(typeof(Action), scene, typeof(UmoScene).GetMethod("LateUpdate", BindingFlags.NonPublic | BindingFlags.Instance));
            GameObject voice = new GameObject("person");
            AudioSource microphone = voice.AddComponent<AudioSource>();
            microphone.Play();
            Enable();
            scene.Add(new UmoSceneMember { eyes = voice.transform, voice = microphone, lookAt = room.transform });
            Time.unscaledDeltaTime = (float)Frame;
            for (int i = 0; i < 10; i++) update();
            long before = allocated();
            for (int i = 0; i < 1000; i++) update();
            long bytes = allocated() - before;
            Assert.AreEqual(0L, bytes, "bytes");
            Assert.AreEqual("", scene.Error);
            Disable();
        }
    }
}
