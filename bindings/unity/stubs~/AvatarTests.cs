// SPDX-License-Identifier: MIT OR Apache-2.0
// The component in a stand-in for Unity with the real library: an audio thread, the game's frames, play and stop.

using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Threading;
using NUnit.Framework;
using UnityEditor;
using UnityEngine;

namespace Umo.Unity.Tests
{
    public sealed class AvatarTests
    {
        private const int Block = 1024;
        private const double Frame = 1 / 60.0;

        private readonly GameObject figure = new GameObject("figure");
        private readonly AudioSource source;
        private readonly UmoAvatar avatar;
        private readonly Animator animator;
        private readonly SkinnedMeshRenderer mesh;
        private readonly float[] speech;
        private float[] playing;
        private int played;
        private double blocks, time;
        private readonly List<float> heard = new List<float>();

        public AvatarTests()
        {
            // The editor does this after loading the code.
            System.Runtime.CompilerServices.RuntimeHelpers.RunClassConstructor(typeof(Editing.UmoReload).TypeHandle);
            Debug.Said.Clear();
            AudioSettings.outputSampleRate = 48000;
            AudioSettings.speakerMode = AudioSpeakerMode.Stereo;
            Application.streamingAssetsPath = Path.GetDirectoryName(Runner.Arguments[0]);
            byte[] wav = File.ReadAllBytes(Runner.Arguments[1]);
            short[] samples = new short[(wav.Length - 44) / 2];
            Buffer.BlockCopy(wav, 44, samples, 0, 2 * samples.Length);
            // 16 kHz mono to 48 kHz stereo, the mixer's format.
            speech = new float[6 * samples.Length];
            for (int i = 0; i < speech.Length; i++) speech[i] = samples[i / 6] / 32768f;

            figure.transform.localPosition = new Vector3(3, 0, 5);
            figure.transform.localRotation = new Quaternion(0, 1, 0, 0);
            source = figure.AddComponent<AudioSource>();
            animator = figure.AddComponent<Animator>();
            Bones();
            mesh = new GameObject("head", figure).AddComponent<SkinnedMeshRenderer>();
            mesh.sharedMesh = new Mesh { Shapes = new[] { "blendShape1.jawOpen", "blendShape1.eyeBlink_L", "blendShape1.other" } };
            avatar = figure.AddComponent<UmoAvatar>();
            avatar.model = Path.GetFileName(Runner.Arguments[0]);
        }

        private void Bones()
        {
            Bone("hips", figure, HumanBodyBones.Hips, 0, 1, 0);
            GameObject spine = Bone("spine", Of(HumanBodyBones.Hips), HumanBodyBones.Spine, 0, 0.2f, 0);
            GameObject chest = Bone("chest", spine, HumanBodyBones.Chest, 0, 0.2f, 0);
            GameObject head = Bone("head", chest, HumanBodyBones.Head, 0, 0.3f, 0);
            Bone("jaw", head, HumanBodyBones.Jaw, 0, 0, 0.1f);
            // An arm with a rotated rest pose.
            GameObject upper = Bone("upper arm", chest, HumanBodyBones.LeftUpperArm, -0.2f, 0.2f, 0);
            GameObject lower = Bone("lower arm", upper, HumanBodyBones.LeftLowerArm, -0.2f, -0.2f, 0);
            Bone("hand", lower, HumanBodyBones.LeftHand, -0.2f, -0.2f, 0);
        }

        private GameObject Of(HumanBodyBones bone) { return animator.Bones[bone].gameObject; }

        private GameObject Bone(string name, GameObject parent, HumanBodyBones bone, float x, float y, float z)
        {
            GameObject made = new GameObject(name, parent);
            made.transform.localPosition = new Vector3(x, y, z);
            animator.Bones[bone] = made.transform;
            return made;
        }

        private void Enable() { GameObject.Send(avatar, "OnEnable"); }
        private void Disable() { GameObject.Send(avatar, "OnDisable"); }

        private readonly float[] block = new float[2 * Block];

        /// Processes one mixer block. While nothing plays, a filter is either not called or called with silence.
        private void Mix(bool callsAlways)
        {
            if (!source.isPlaying && !callsAlways) return;
            Array.Clear(block, 0, block.Length);
            if (source.isPlaying)
            {
                int count = Math.Min(block.Length, playing.Length - played);
                Array.Copy(playing, played, block, 0, count);
                played += count;
                if (played == playing.Length) source.Stop();
            }
            GameObject.Send(avatar, "OnAudioFilterRead", block, 2);
            heard.AddRange(block);
        }

        /// Runs sound and frames for the given time, each waiting for due frames, so that a slow machine changes
        /// nothing.
        private void Run(double seconds, Action each = null, bool callsAlways = false)
        {
            for (double end = time + seconds; time < end; time += Frame)
            {
                while (blocks * Block / 48000 <= time)
                {
                    Mix(callsAlways);
                    blocks++;
                }
                Time.unscaledDeltaTime = (float)Frame;
                Settle();
                GameObject.Send(avatar, "LateUpdate");
                if (each != null) each();
            }
        }

        /// Waits until the engine has computed all frames that the audio so far allows.
        private void Settle()
        {
            VoiceLine line = (VoiceLine)LineField.GetValue(avatar);
            if (avatar.Session == null) return;
            Latency latency;
            Stats stats;
            avatar.Session.GetLatency(out latency);
            // The resampler also holds back some samples.
            long heard = line.Pushed - begun - (long)latency.AlgorithmicSamples - AudioSettings.outputSampleRate / 20;
            long due = computed + Math.Max(heard, 0) * 30 / AudioSettings.outputSampleRate;
            for (int tries = 0; tries < 20000; tries++)
            {
                avatar.Session.GetStats(out stats);
                if ((long)stats.Frames >= due) return;
                Thread.Sleep(1);
            }
            Assert.IsTrue(false, "the engine computes nothing");
        }

        /// First sample of the stream, and the number of frames computed before it.
        private long begun, computed;

        private void Interrupt(float seconds)
        {
            avatar.Interrupt(seconds);
            // Frames that were just computed are counted even if dropped.
            Thread.Sleep(300);
            Stats stats;
            avatar.Session.GetStats(out stats);
            computed = (long)stats.Frames;
            begun = ((VoiceLine)LineField.GetValue(avatar)).Pushed;
        }

        private static readonly FieldInfo LineField = typeof(UmoAvatar).GetField("line", BindingFlags.NonPublic | BindingFlags.Instance);

        private void Play(float[] samples)
        {
            playing = samples;
            played = 0;
            source.Play();
        }

        private float Jaw { get { return mesh.Weights.ContainsKey(0) ? mesh.Weights[0] : 0; } }

        private static readonly FieldInfo ClockField = typeof(UmoAvatar).GetField("clock", BindingFlags.NonPublic | BindingFlags.Instance);
        private double Clock { get { return ((MotionClock)ClockField.GetValue(avatar)).Time; } }

        private static readonly FieldInfo FrameField = typeof(UmoAvatar).GetField("frame", BindingFlags.NonPublic | BindingFlags.Instance);

        /// The shown frame belongs to the sound being heard.
        private void InStep()
        {
            VoiceLine line = (VoiceLine)LineField.GetValue(avatar);
            Frames frame = (Frames)FrameField.GetValue(avatar);
            Assert.AreEqual(line.Pushed / 48000.0 - avatar.Delay, frame.Sample(0) / 48000.0, 0.08, "the frame's sample");
        }

        private void NothingSaid() { Assert.AreEqual("", string.Join("; ", Debug.Said)); }

        [Test]
        public void bones_and_shapes_follow_what_is_heard()
        {
            Enable();
            Assert.AreEqual("", avatar.Error);
            Assert.AreEqual(2, avatar.ShapeCount);
            // The jaw is moved by a blend shape and not by its bone as well.
            Assert.AreEqual(7, avatar.BoneCount);
            Play(speech);
            HashSet<float> jaws = new HashSet<float>();
            HashSet<float> heads = new HashSet<float>();
            float hand = animator.Bones[HumanBodyBones.LeftHand].position.y;
            Run(3, () =>
            {
                jaws.Add(Jaw);
                heads.Add(animator.Bones[HumanBodyBones.Head].rotation.x);
            });
            Assert.IsTrue(jaws.Count > 50 && heads.Count > 50, jaws.Count + " jaws, " + heads.Count + " heads");
            Assert.IsTrue(jaws.Max() > 1 && jaws.All(w => w >= 0 && w <= 100), "weights from " + jaws.Min() + " to " + jaws.Max());
            Assert.IsTrue(!mesh.Weights.ContainsKey(2), "a shape that is not a channel was moved");
            Assert.IsTrue(Math.Abs(animator.Bones[HumanBodyBones.LeftHand].position.y - hand) > 0.01, "the hand moved");
            // The sound is heard exactly as late as its motion is shown.
            int late = heard.FindIndex(s => s != 0) / 2 - Array.FindIndex(speech, s => s != 0) / 2;
            Assert.AreEqual(avatar.Delay * 48000 - 4 * 1024, late, 1.0, "the voice's delay");
            Assert.AreEqual(3 - avatar.Delay, Clock, 0.06, "the motion's");
            Disable();
            NothingSaid();
        }

        [Test]
        public void a_pose_is_the_one_that_the_library_gives_for_that_moment()
        {
            // Layers follow the clock while there are no frames.
            avatar.gazeLayer = avatar.idleLayer = avatar.asymmetryLayer = avatar.nodsLayer = avatar.moodLayer = avatar.feetLayer = avatar.bodyLayer = 0;
            Enable();
            Play(speech);
            Run(3);
            // Push the same sound with the same seed to a separate session.
            Engine engine = avatar.Session.Engine;
            SessionConfig config = Session.Defaults(engine.Model);
            config.SampleRate = 48000;
            config.Channels = 2;
            config.Target = (uint)avatar.target;
            if (avatar.lookahead >= 0) config.Lookahead = (uint)avatar.lookahead;
            using (Session session = new Session(engine, config))
            {
                for (uint layer = (uint)Parameter.LayerGaze; layer <= (uint)Parameter.LayerBody; layer++) session.Set((Parameter)layer, 0);
                int taken;
                // Samples of a block may be dropped before the component sees that the source plays; none were, or the
                // result would differ.
                session.PushAudio(speech, 0, 2 * 3 * 48000, out taken);
                Frames frames = new Frames(engine.Model, 1, Axes.Unity);
                Sampled sampled;
                do
                {
                    Thread.Sleep(1);
                    session.SamplePose(0, frames, out sampled);
                } while (sampled.Newest < Clock);
                session.SamplePose(Clock, frames, out sampled);
                float[] face = new float[frames.Channels];
                frames.Face(0, face);
                int jaw = Array.IndexOf(engine.Model.ChannelNames(), "jawOpen");
                Assert.AreEqual(100 * face[jaw], Jaw, 1e-4, "the jaw");
                // The figure is rotated half a turn about up: rotations of the hips are the pelvis rotations followed
                // by that turn.
                float[] rotations = new float[220];
                frames.Rotations(0, rotations);
                Quaternion hips = new Quaternion(0, 1, 0, 0) * new Quaternion(rotations[0], rotations[1], rotations[2], rotations[3]);
                Quaternion got = animator.Bones[HumanBodyBones.Hips].rotation;
                Assert.AreEqual(1, Math.Abs(hips.x * got.x + hips.y * got.y + hips.z * got.z + hips.w * got.w), 1e-5, "the hips");
            }
            Disable();
        }

        [Test]
        public void the_mouth_does_not_stick_when_the_voice_stops()
        {
            foreach (bool callsAlways in new[] { false, true })
            {
                avatar.idle = Idle.Rest;
                Enable();
                Play(speech);
                Run(2, null, callsAlways);
                source.Stop();
                Run(4, null, callsAlways);
                float rest = Jaw;
                Run(1, () => Assert.AreEqual(rest, Jaw, 1e-6, "at rest"), callsAlways);
                // The next speech is also shown when it is heard.
                Play(speech);
                HashSet<float> jaws = new HashSet<float>();
                Run(3, () => jaws.Add(Jaw), callsAlways);
                Assert.IsTrue(jaws.Count > 50, "it speaks again: " + jaws.Count);
                InStep();
                Disable();
            }
            NothingSaid();
        }

        /// Simulates frames in a WebGL player: no audio thread calls, and the position of a source advances with time.
        private void RunInBrowser(double seconds, Action each = null)
        {
            for (double end = time + seconds; time < end; time += Frame)
            {
                if (source.isPlaying) source.timeSamples += 800;
                if (source.isPlaying && source.timeSamples >= source.clip.samples)
                {
                    if (source.loop) source.timeSamples -= source.clip.samples;
                    else source.Stop();
                }
                Time.unscaledDeltaTime = (float)Frame;
                Time.frameCount++;
                GameObject.Send(avatar, "LateUpdate");
                if (each != null) each();
            }
        }

        [Test]
        public void in_a_browser_a_clip_is_read_and_heard_when_its_motion_is_there()
        {
            Application.platform = RuntimePlatform.WebGLPlayer;
            UmoRuntime.Shutdown();
            UmoRuntime.PollMicroseconds = 10000000;
            try
            {
                AudioClip clip = AudioClip.Create("hello", speech.Length / 2, 2, 48000, false);
                clip.SetData(speech, 0);
                Enable();
                Assert.AreEqual("", avatar.Error);
                RunInBrowser(1);
                // A clip of another format needs another session.
                avatar.Speak(clip);
                RunInBrowser(Frame);
                Assert.IsTrue(!source.isPlaying && source.IsPaused, "it waits for its motion");
                double begins = 0, start = time;
                long first = Line.Pushed;
                HashSet<float> jaws = new HashSet<float>();
                RunInBrowser(3, () =>
                {
                    if (begins == 0 && source.isPlaying) begins = time;
                    jaws.Add(Jaw);
                    if (begins == 0 || time - begins < 0.3) return;
                    // The shown frame belongs to the sample being heard.
                    Frames frame = (Frames)FrameField.GetValue(avatar);
                    Assert.AreEqual(source.timeSamples / 48000.0, ((double)frame.Sample(0) - first) / 48000, 0.08, "the frame's sample");
                });
                Assert.AreEqual(avatar.Delay, begins - start, 0.04, "it is heard as late as its motion is shown");
                Assert.IsTrue(jaws.Count > 50, "the jaw moves: " + jaws.Count);
                // To its end and beyond: all audio read ahead is shown, and the avatar stays alive.
                double before = Clock;
                RunInBrowser(clip.samples / 48000.0 + 2);
                Assert.AreEqual(before + clip.samples / 48000.0 + 2, Clock, 0.1, "the motion goes on");
                Assert.IsTrue(!source.isPlaying && !source.IsPaused, "it has ended");
                // A loop has no end, and the position can be changed.
                source.loop = true;
                source.Play();
                RunInBrowser(clip.samples / 48000.0 + 3);
                Assert.IsTrue(source.isPlaying, "it goes on");
                long pushed = Line.Pushed;
                source.timeSamples = 48000;
                RunInBrowser(1);
                Assert.AreEqual(1, (Line.Pushed - pushed) / 48000.0, 0.05, "a second for a second");
                // Barge-in while it waits: the clip must not be heard later.
                source.Stop();
                RunInBrowser(1);
                avatar.Speak(clip);
                RunInBrowser(0.1);
                avatar.Interrupt(0.3f);
                RunInBrowser(2);
                Assert.IsTrue(!source.isPlaying, "it stays silent");
                NothingSaid();
                // An unreadable clip is reported once, and plays.
                clip.IsReadable = false;
                source.loop = false;
                source.Play();
                RunInBrowser(0.5);
                Assert.AreEqual(1, Debug.Said.Count);
                Assert.IsTrue(Debug.Said[0].Contains("Decompress On Load") && source.isPlaying, Debug.Said[0]);
                Disable();
            }
            finally
            {
                UmoRuntime.Shutdown();
                Application.platform = RuntimePlatform.LinuxPlayer;
                UmoRuntime.PollMicroseconds = 4000;
            }
        }

        private VoiceLine Line { get { return (VoiceLine)LineField.GetValue(avatar); } }

        [Test]
        public void an_avatar_lives_while_nothing_plays()
        {
            Enable();
            HashSet<float> heads = new HashSet<float>();
            Run(3, () => heads.Add(animator.Bones[HumanBodyBones.Head].rotation.x));
            Assert.IsTrue(heads.Count > 50, heads.Count + " poses");
            InStep();
            Disable();
            NothingSaid();
        }

        [Test]
        public void an_interrupt_eases_to_rest_and_the_next_speech_follows()
        {
            Enable();
            Play(speech);
            Run(2.5);
            double before = Clock;
            Interrupt(0.5f);
            Assert.IsTrue(!source.isPlaying, "it is silent");
            float last = Jaw, largest = 0;
            Run(0.45, () =>
            {
                largest = Math.Max(largest, Math.Abs(Jaw - last));
                last = Jaw;
            });
            Assert.AreEqual(before + 0.45, Clock, 0.04, "the ease is shown at once");
            Assert.IsTrue(largest < 20, "the jaw jumped by " + largest);
            Play(speech);
            HashSet<float> jaws = new HashSet<float>();
            Run(3, () => jaws.Add(Jaw));
            Assert.IsTrue(jaws.Count > 50, "it speaks again: " + jaws.Count);
            InStep();
            Disable();
            NothingSaid();
        }

        [Test]
        public void silence_is_put_in_before_sound_whose_motion_would_be_in_the_past()
        {
            Enable();
            using (Session session = new Session(avatar.Session.Engine, Stereo()))
            {
                VoiceLine line = new VoiceLine(session, 48000, 2, 0);
                Action<int, string> process = (wanted, what) =>
                {
                    line.Process(Enumerable.Repeat(0.5f, 2 * Block).ToArray(), 2);
                    Assert.AreEqual((long)wanted, line.Pushed, what);
                };
                process(Block, "sound");
                line.StartAt(5000);
                process(5000 + Block, "silence up to there, and sound");
                process(5000 + 2 * Block, "sound alone");
                line.Silence(700);
                Assert.AreEqual(5000L + 2 * Block + 700, line.Pushed, "silence instead of sound");
                line.Process(new float[2 * Block], 2);
                Assert.AreEqual(5000L + 2 * Block + 700, line.Pushed, "silence of a source that stands");
                line.Playing = true;
                line.Process(new float[2 * Block], 2);
                Assert.AreEqual(5000L + 3 * Block + 700, line.Pushed, "silence of a source that plays");
            }
            Disable();
        }

        private SessionConfig Stereo()
        {
            SessionConfig config = Session.Defaults(avatar.Session.Engine.Model);
            config.SampleRate = 48000;
            config.Channels = 2;
            return config;
        }

        [Test]
        public void a_voice_that_was_cut_off_is_not_heard_before_the_next()
        {
            Enable();
            Play(Enumerable.Repeat(0.5f, 8 * 48000).ToArray());
            Run(1.5);
            source.Stop();
            Run(0.5);
            heard.Clear();
            Play(Enumerable.Repeat(0.25f, 8 * 48000).ToArray());
            Run(1.5);
            Assert.IsTrue(heard.All(s => s == 0 || s == 0.25f), "the old voice is heard");
            Assert.IsTrue(heard.Last() == 0.25f, "the new voice is not heard");
            Disable();
        }

        [Test]
        public void parts_that_are_turned_off_stay_at_rest()
        {
            avatar.faceGain = 0;
            avatar.upperGain = 0;
            Enable();
            Play(speech);
            Run(1.5);
            float jaw = Jaw;
            Quaternion hand = animator.Bones[HumanBodyBones.LeftHand].localRotation;
            Run(1, () =>
            {
                Assert.AreEqual(jaw, Jaw, 1e-6, "the jaw");
                Assert.AreEqual(hand.x, animator.Bones[HumanBodyBones.LeftHand].localRotation.x, 1e-5, "the hand");
            });
            avatar.faceGain = 1;
            HashSet<float> jaws = new HashSet<float>();
            Run(1, () => jaws.Add(Jaw));
            Assert.IsTrue(jaws.Count > 20, "the face moves again");
            Disable();
        }

        [Test]
        public void the_mixers_rate_and_channels_may_change()
        {
            Enable();
            Play(speech);
            Run(1);
            Session first = avatar.Session;
            AudioSettings.Change(44100);
            Run(0.1);
            Assert.IsTrue(avatar.Session != null && avatar.Session != first, "a new session at the new rate");
            int taken;
            Assert.AreEqual(Status.InvalidHandle, first.PushAudio(block, 0, 2, out taken));
            GameObject.Send(avatar, "OnAudioFilterRead", new float[6 * 512], 6);
            Session second = avatar.Session;
            GameObject.Send(avatar, "LateUpdate");
            Assert.IsTrue(avatar.Session != second, "a new session for six channels");
            GameObject.Send(avatar, "OnAudioFilterRead", new float[6 * 512], 6);
            GameObject.Send(avatar, "LateUpdate");
            Disable();
            NothingSaid();
        }

        [Test]
        public void play_starts_and_stops_many_times_under_a_running_mixer()
        {
            bool ends = false;
            Exception thrown = null;
            MethodInfo read = typeof(UmoAvatar).GetMethod("OnAudioFilterRead", BindingFlags.NonPublic | BindingFlags.Instance);
            Action<float[], int> filter = (Action<float[], int>)Delegate.CreateDelegate(typeof(Action<float[], int>), avatar, read);
            Thread mixer = new Thread(() =>
            {
                try
                {
                    float[] data = new float[2 * Block];
                    for (int at = 0; !Volatile.Read(ref ends); at = (at + data.Length) % (speech.Length - data.Length))
                    {
                        Array.Copy(speech, at, data, 0, data.Length);
                        filter(data, 2);
                    }
                }
                catch (Exception error)
                {
                    thrown = error;
                }
            }) { IsBackground = true };
            mixer.Start();
            source.Play();
            for (int round = 0; round < 50; round++)
            {
                Enable();
                Assert.AreEqual("", avatar.Error);
                for (int i = 0; i < 5; i++) GameObject.Send(avatar, "LateUpdate");
                if (round % 5 == 0) AssemblyReloadEvents.Raise();
                Disable();
                if (round % 3 == 0) EditorApplication.Raise(PlayModeStateChange.EnteredEditMode);
                if (round % 4 == 0) UmoRuntime.Shutdown();
            }
            ends = true;
            mixer.Join();
            Assert.AreEqual(null, thrown);
            Assert.IsTrue(!AudioSettings.HasListeners, "a listener was left");
            Assert.IsTrue(!UmoRuntime.Has(Path.Combine(Application.streamingAssetsPath, avatar.model)), "an engine was left");
        }

        [Test]
        public void engines_are_shared_and_freed_with_the_last_user()
        {
            Enable();
            string path = Path.Combine(Application.streamingAssetsPath, avatar.model);
            Engine same = UmoRuntime.Acquire(path);
            Assert.AreEqual(avatar.Session.Engine, same);
            Disable();
            Assert.IsTrue(UmoRuntime.Has(path), "it is still used");
            UmoRuntime.Release(path, same);
            Assert.IsTrue(!UmoRuntime.Has(path), "it is not freed");
        }

        [Test]
        public void settings_are_those_of_the_engines_made_from_then_on()
        {
            string path = Path.Combine(Application.streamingAssetsPath, avatar.model), problem = "";
            UmoRuntime.MaxBatch = 65;
            try { UmoRuntime.Acquire(path); }
            catch (UmoException error) { problem = error.Message; }
            finally { UmoRuntime.MaxBatch = 0; }
            Assert.IsTrue(problem.Contains("65"), problem);
        }

        [Test]
        public void what_is_wrong_is_said_in_the_inspector()
        {
            var inspector = new Editing.UmoAvatarInspector { target = avatar };
            avatar.model = "none.safetensors";
            Enable();
            GameObject.Send(avatar, "LateUpdate");
            GameObject.Send(avatar, "OnAudioFilterRead", block, 2);
            EditorGUILayout.Shown.Clear();
            inspector.OnInspectorGUI();
            Assert.IsTrue(EditorGUILayout.Shown.Single().StartsWith("Error: ") && EditorGUILayout.Shown.Single().Contains("none.safetensors"), EditorGUILayout.Shown[0]);
            Assert.IsTrue(Debug.Said.Single().Contains("none.safetensors"), Debug.Said[0]);
            Disable();
            avatar.model = Path.GetFileName(Runner.Arguments[0]);
            avatar.target = 99;
            Enable();
            Assert.IsTrue(avatar.Error.Length > 0, "99 keyframes at once");
            Assert.IsTrue(!UmoRuntime.Has(Path.Combine(Application.streamingAssetsPath, avatar.model)), "an engine was left");
            avatar.target = 2;
            Disable();
            Enable();
            EditorGUILayout.Shown.Clear();
            inspector.OnInspectorGUI();
            Assert.IsTrue(EditorGUILayout.Shown.Last().Contains("7 bones, 2 blend shapes"), EditorGUILayout.Shown.Last());
            Disable();
        }

        [Test]
        public void a_live_voice_is_not_delayed_and_the_mouth_moves_with_it()
        {
            avatar.liveVoice = true;
            avatar.model = Runner.Arguments[2];
            Enable();
            Assert.AreEqual("", avatar.Error);
            Assert.IsTrue(avatar.IsLive, "the model has a mouth network");
            Latency latency;
            avatar.Session.GetLatency(out latency);
            Assert.AreEqual(Math.Max(latency.MouthSamples, 4 * 1024ul) / 48000.0, avatar.Delay, 1e-6, "behind the mixer");
            Play(speech);
            HashSet<float> jaws = new HashSet<float>();
            Run(2, () => jaws.Add(Jaw));
            Assert.IsTrue(jaws.Count > 20, jaws.Count + " jaws");
            Assert.IsTrue(heard.Take(48000).SequenceEqual(speech.Take(48000)), "the voice was changed");
            Assert.AreEqual(2 - avatar.Delay, Clock, 0.06, "the motion's");
            InStep();
            Disable();
        }

        [Test]
        public void a_microphone_has_the_live_voice_where_the_model_has_a_mouth_network()
        {
            foreach (string model in new[] { Runner.Arguments[2], Runner.Arguments[0] })
            {
                avatar.model = model;
                Enable();
                Assert.IsTrue(!avatar.IsLive, "nothing asked for it");
                bool hasMouth = avatar.Session.Engine.Model.Info.HasMouth == 1;
                playing = speech;
                played = 0;
                avatar.UseMicrophone();
                Assert.AreEqual("default", Microphone.Open);
                Run(0.1);
                Assert.AreEqual(hasMouth, avatar.IsLive, "the live voice");
                Assert.IsTrue(!source.isPlaying, "nothing was recorded yet");
                Microphone.Written = 480;
                heard.Clear();
                HashSet<float> jaws = new HashSet<float>();
                Run(2, () => jaws.Add(Jaw));
                Assert.IsTrue(source.isPlaying && source.timeSamples == 48000 + 480 - 960, "it plays what was just recorded");
                Assert.IsTrue(jaws.Count > 20, jaws.Count + " jaws");
                Assert.IsTrue(heard.All(s => s == 0), "it is not to be heard");
                avatar.StopMicrophone();
                Assert.AreEqual(null, Microphone.Open);
                Run(0.1);
                Assert.IsTrue(!avatar.IsLive && !source.isPlaying, "as before");
                Disable();
            }
            avatar.UseMicrophone("none");
            Assert.IsTrue(Debug.Said.Last().Contains("microphone"), Debug.Said.Last());
        }

        /// Sideways turn of the head after a while.
        private float Turned(float x)
        {
            // The figure faces -Z.
            avatar.lookAt.localPosition = figure.transform.TransformPoint(new Vector3(x, 1.4f, 1));
            Enable();
            Play(speech);
            Run(1.5);
            Quaternion head = Quaternion.Inverse(figure.transform.rotation) * animator.Bones[HumanBodyBones.Head].rotation;
            source.Stop();
            Disable();
            return head.y;
        }

        [Test]
        public void it_looks_where_it_is_to_look()
        {
            avatar.lookAt = new GameObject("player").transform;
            float right = Turned(2), left = Turned(-2);
            Assert.IsTrue(right > left + 0.1f, "the head's turn: " + right + " to the right, " + left + " to the left");
            // A position that the library would refuse.
            avatar.lookAt.localPosition = new Vector3(1e6f, 0, float.NaN);
            Enable();
            Run(0.1);
            avatar.lookAt.localPosition = new Vector3(1e6f, 0, 0);
            Run(0.1);
            avatar.lookAt = null;
            Run(0.1);
            Assert.AreEqual("", avatar.Error);
            Disable();
        }

        [Test]
        public void gestures_are_played_by_name()
        {
            Assert.IsTrue(!avatar.PlayGesture("wave") && avatar.GestureNames.Length == 0, "there is no session");
            Enable();
            Assert.IsTrue(avatar.GestureNames.Contains("wave"), string.Join(" ", avatar.GestureNames));
            Assert.IsTrue(avatar.PlayGesture("wave"), "it waves");
            Assert.IsTrue(avatar.PlayGesture("point", new GameObject("player").transform, Side.Left, 0.5f), "it points");
            NothingSaid();
            Assert.IsTrue(!avatar.PlayGesture("somersault"), "an unknown gesture");
            Assert.IsTrue(Debug.Said.Single().Contains("somersault"), Debug.Said[0]);
            float hand = animator.Bones[HumanBodyBones.LeftHand].position.y, highest = hand;
            Assert.IsTrue(avatar.PlayGesture("stop", null, Side.Left), "a known gesture");
            avatar.idle = Idle.Live;
            Run(6, () => highest = Math.Max(highest, animator.Bones[HumanBodyBones.LeftHand].position.y));
            Assert.IsTrue(highest > hand + 0.2f, "the hand rose from " + hand + " to " + highest);
            Disable();
        }

        [Test]
        public void words_become_gestures_at_their_time()
        {
            Assert.IsTrue(!avatar.HintWords("stop", 0, 0.1f) && avatar.GivenSeconds == 0, "there is no session");
            // "now" means nothing in English.
            string rules = "[class.own]\nwords = ['now']\ngestures = [{ name = 'stop', side = 'left' }]";
            avatar.wordRules = new TextAsset { bytes = System.Text.Encoding.UTF8.GetBytes(rules) };
            // Hands rest, but for the gesture.
            avatar.activity = 0;
            Enable();
            // After a while of silence, as in a game.
            Run(1);
            float begins = avatar.GivenSeconds;
            Assert.AreEqual(1, begins, 0.1, "seconds given");
            Assert.IsTrue(avatar.HintWords("now", begins + 2, begins + 2.4f), "a word");
            Play(speech);
            double heard = time + avatar.Delay, raised = 0;
            float hand = Of(HumanBodyBones.LeftHand).transform.position.y;
            Run(3, () =>
            {
                if (raised == 0 && Of(HumanBodyBones.LeftHand).transform.position.y > hand + 0.35f) raised = time - heard;
            });
            Assert.AreEqual(1.95, raised, 0.25, "seconds of the speech");
            NothingSaid();
            Assert.IsTrue(!avatar.HintWords("now", 9, 8) && Debug.Said.Count == 1, "it ends before it starts");
            Disable();
            avatar.language = "xx";
            Enable();
            Assert.IsTrue(avatar.Error.Contains("xx"), avatar.Error);
            Disable();
        }

        [Test]
        public void gestures_of_ones_own_come_out_of_files()
        {
            UmoGesture salute = ScriptableObject.CreateInstance<UmoGesture>();
            salute.name = "greet";
            salute.file = new TextAsset { bytes = File.ReadAllBytes(Runner.Arguments[3]) };
            salute.movesHead = salute.movesTrunk = salute.movesLeftArm = false;
            avatar.gestures = new[] { salute, null };
            Enable();
            NothingSaid();
            Assert.IsTrue(avatar.GestureNames.Contains("greet"), string.Join(" ", avatar.GestureNames));
            Assert.IsTrue(avatar.PlayGesture("greet"), "it greets");
            Disable();
            salute.animationName = "wave";
            Enable();
            Assert.IsTrue(avatar.Error.Contains("no animation `wave`") && avatar.Error.Contains("salute"), avatar.Error);
            Disable();
        }

        [Test]
        public void a_film_that_is_captured_goes_by_its_own_time()
        {
            Enable();
            Run(1);
            Time.captureFramerate = 10;
            Run(0.5);
            Quaternion before = Of(HumanBodyBones.Chest).transform.localRotation;
            // A frame of the film lasts a tenth of a second, however fast it was rendered.
            Run(Frame * 1.5);
            float moved = Angle(before, Of(HumanBodyBones.Chest).transform.localRotation);
            Time.captureFramerate = 0;
            Assert.IsTrue(moved > 0, "it moves by " + moved);
            Disable();
            NothingSaid();
        }

        private static float Angle(Quaternion a, Quaternion b)
        {
            return Math.Abs(a.x - b.x) + Math.Abs(a.y - b.y) + Math.Abs(a.z - b.z) + Math.Abs(a.w - b.w);
        }

        [Test]
        public void attention_mood_and_layers_are_handed_on()
        {
            avatar.otherSource = new GameObject("other").AddComponent<AudioSource>();
            avatar.otherSource.Play();
            avatar.attention = Attention.Thinking;
            avatar.mood = Mood.Joy;
            avatar.moodStrength = 0.5f;
            avatar.feetLayer = 0.25f;
            avatar.outputDelay = 1;
            Enable();
            Run(0.2);
            double value;
            Assert.AreEqual(Status.Ok, avatar.Session.Get(Parameter.Attention, out value));
            Assert.AreEqual((double)Attention.Thinking, value);
            Assert.AreEqual(Status.Ok, avatar.Session.Get(Parameter.LayerFeet, out value));
            Assert.AreEqual(0.25, value);
            Assert.AreEqual(Status.Ok, avatar.Session.Get(Parameter.OutputDelay, out value));
            Assert.AreEqual(1.0, value);
            Assert.AreEqual("", avatar.Error);
            Disable();
        }

        [Test]
        public void a_model_in_an_archive_is_fetched()
        {
            Application.streamingAssetsPath = "file://" + Application.streamingAssetsPath;
            Enable();
            Assert.AreEqual("", avatar.Error);
            Assert.IsTrue(avatar.Session != null, "a session");
            Disable();
            avatar.model = "none.safetensors";
            Enable();
            Assert.IsTrue(avatar.Error.Contains("none.safetensors"), avatar.Error);
            Disable();
        }

        [Test]
        public void a_clip_is_said_to_its_last_sound()
        {
            Enable();
            AudioClip clip = AudioClip.Create("hello", 16000, 1, 16000, false);
            float[] ones = Enumerable.Repeat(0.5f, 16000).ToArray();
            clip.SetData(ones, 0);
            avatar.Speak(clip);
            Assert.IsTrue(source.isPlaying, "it plays");
            Assert.AreEqual(16000 + (int)Math.Ceiling(avatar.Delay * 16000), source.clip.samples);
            float[] both = new float[source.clip.samples];
            source.clip.GetData(both, 0);
            Assert.IsTrue(both[15999] == 0.5f && both[16000] == 0, "the clip, then silence");
            Disable();
        }

        /// Adds what a body needs: the other arm, legs, and a wide trunk, skinned to the spine.
        private SkinnedMeshRenderer Widen()
        {
            GameObject upper = Bone("right arm", Of(HumanBodyBones.Chest), HumanBodyBones.RightUpperArm, 0.2f, 0.2f, 0);
            GameObject lower = Bone("right lower arm", upper, HumanBodyBones.RightLowerArm, 0.2f, -0.2f, 0);
            Bone("right hand", lower, HumanBodyBones.RightHand, 0.2f, -0.2f, 0);
            foreach (int side in new[] { -1, 1 })
            {
                bool left = side < 0;
                GameObject thigh = Bone("thigh", Of(HumanBodyBones.Hips), left ? HumanBodyBones.LeftUpperLeg : HumanBodyBones.RightUpperLeg, 0.1f * side, -0.05f, 0);
                GameObject shin = Bone("shin", thigh, left ? HumanBodyBones.LeftLowerLeg : HumanBodyBones.RightLowerLeg, 0, -0.45f, 0);
                Bone("foot", shin, left ? HumanBodyBones.LeftFoot : HumanBodyBones.RightFoot, 0, -0.42f, 0);
            }
            Transform[] bones = new[] { HumanBodyBones.Hips, HumanBodyBones.Spine, HumanBodyBones.Chest }.Select(bone => animator.Bones[bone]).ToArray();
            SkinnedMeshRenderer skin = new GameObject("trunk", figure).AddComponent<SkinnedMeshRenderer>();
            skin.bones = bones;
            List<Vector3> points = new List<Vector3>();
            List<BoneWeight> weights = new List<BoneWeight>();
            List<int> triangles = new List<int>();
            for (int ring = 0; ring <= 30; ring++)
            {
                for (int at = 0; at < 24; at++)
                {
                    double turn = Math.PI * at / 12;
                    points.Add(new Vector3(0.28f * (float)Math.Sin(turn), 0.9f + 0.7f * ring / 30, 0.3f * (float)Math.Cos(turn)));
                    weights.Add(new BoneWeight { boneIndex0 = ring < 8 ? 0 : ring < 18 ? 1 : 2, weight0 = 1 });
                    int a = 24 * ring + at, b = 24 * ring + (at + 1) % 24;
                    if (ring < 30) triangles.AddRange(new[] { a, b, a + 24, b, b + 24, a + 24 });
                }
            }
            skin.sharedMesh = new Mesh
            {
                name = "trunk",
                vertices = points.ToArray(),
                boneWeights = weights.ToArray(),
                triangles = triangles.ToArray(),
                // The figure stands at the origin of its own frame, its bones unrotated.
                bindposes = new[] { -1f, -1.2f, -1.4f }.Select(y => Matrix4x4.Translate(new Vector3(0, y, 0))).ToArray(),
            };
            return skin;
        }

        /// Least distance of the left hand from the axis of the hips, level with the trunk, while it goes to the body.
        private double Nearest()
        {
            double least = 10;
            Enable();
            Assert.AreEqual("", avatar.Error);
            Assert.IsTrue(avatar.PlayGesture("me", null, Side.Left), "a known gesture");
            Run(3, () =>
            {
                Transform hips = animator.Bones[HumanBodyBones.Hips];
                Vector3 hand = hips.InverseTransformPoint(animator.Bones[HumanBodyBones.LeftHand].position);
                if (hand.y > 0 && hand.y < 0.5) least = Math.Min(least, Math.Sqrt(hand.x * hand.x + hand.z * hand.z));
            });
            Disable();
            return least;
        }

        [Test]
        public void arms_keep_out_of_a_wide_body()
        {
            SkinnedMeshRenderer skin = Widen();
            avatar.idle = Idle.Live;
            double before = Nearest();
            NothingSaid();
            avatar.volume = 1;
            double after = Nearest();
            NothingSaid();
            Assert.IsTrue(before < 0.24 && after > before + 0.03, "the hand, from " + before + " to " + after);
            skin.sharedMesh.isReadable = false;
            Nearest();
            Assert.IsTrue(Debug.Said.Single().Contains("trunk cannot be read"), Debug.Said[0]);
        }

        [Test]
        public void a_figure_without_legs_has_no_volume()
        {
            avatar.volume = 1;
            Enable();
            Assert.IsTrue(Debug.Said.Single().Contains("no volume") && Debug.Said[0].Contains("left_hip"), Debug.Said[0]);
            Assert.AreEqual("", avatar.Error);
            Run(0.2);
            Disable();
        }

        [Test]
        public void neither_thread_allocates()
        {
            Func<long> allocated = (Func<long>)Delegate.CreateDelegate(typeof(Func<long>),
                typeof(GC).GetMethod("GetAllocatedBytesForCurrentThread", BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.Static));
            BindingFlags own = BindingFlags.NonPublic | BindingFlags.Instance;
            Action<float[], int> filter = (Action<float[], int>)Delegate.CreateDelegate(typeof(Action<float[], int>), avatar, typeof(UmoAvatar).GetMethod("OnAudioFilterRead", own));
            Action update = (Action)Delegate.CreateDelegate(typeof(Action), avatar, typeof(UmoAvatar).GetMethod("LateUpdate", own));
            avatar.lookAt = new GameObject("player").transform;
            avatar.otherSource = new GameObject("other").AddComponent<AudioSource>();
            avatar.otherSource.Play();
            Widen();
            avatar.volume = 1;
            Enable();
            NothingSaid();
            Play(speech);
            Run(1.5);
            float[] data = new float[2 * Block];
            Time.unscaledDeltaTime = 0.02f;
            long before = allocated();
            object kept = new byte[100];
            Assert.IsTrue(allocated() > before, "the counter counts nothing " + kept);
            before = allocated();
            for (int i = 0; i < 2000; i++)
            {
                Array.Copy(speech, i * 100, data, 0, data.Length);
                filter(data, 2);
                update();
            }
            long bytes = allocated() - before;
            Assert.AreEqual(0L, bytes, "bytes");
            Assert.AreEqual("", avatar.Error);
            Disable();
        }
    }
}
