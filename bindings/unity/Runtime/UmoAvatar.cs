// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Networking;

namespace Umo.Unity
{
    /// <summary>
    /// Animates a humanoid and its blend shapes from the sound of its AudioSource. The model needs some audio from the
    /// future, so the voice is delayed until its motion is ready. With the live voice, which is used for a microphone,
    /// it is not delayed: the mouth moves at once and the body follows.
    /// </summary>
    [AddComponentMenu("Audio/umo Avatar")]
    [DisallowMultipleComponent]
    [DefaultExecutionOrder(1000)]
    [RequireComponent(typeof(AudioSource))]
    public sealed class UmoAvatar : MonoBehaviour
    {
        [Tooltip("Model file in StreamingAssets, or an absolute path.")]
        public string model = "umo-people.safetensors";
        [Tooltip("The figure. Empty: an Animator on this object or its children.")]
        public Animator animator;
        [Tooltip("Meshes with ARKit blend shapes. Empty: all on this object and its children.")]
        public SkinnedMeshRenderer[] faces = new SkinnedMeshRenderer[0];

        [Header("Applied while running")]
        [Range(0, 2)] public float faceGain = 1;
        [Range(0, 2)] public float handsGain = 1;
        [Range(0, 2)] public float upperGain = 1;
        [Range(0, 2)] public float lowerGain = 1;
        [Tooltip("Behaviour without speech: the last pose, the rest pose, or the model run on silence.")]
        public Idle idle = Idle.Live;
        [Tooltip("Text prompt, for models that take text.")]
        public string prompt = "";
        [Tooltip("Whether the hips translate as well as rotate.")]
        public bool moveHips = true;
        [Tooltip("Focus of attention. Auto: speaking while its voice is heard, listening while the other source is heard, else idle.")]
        public Attention attention = Attention.Auto;
        [Tooltip("The mood of face and posture.")]
        public Mood mood = Mood.Neutral;
        [Range(0, 1)] public float moodStrength = 1;
        [Tooltip("How far body and face follow the arousal of the voice.")]
        [Range(0, 1)] public float expression = 0.5f;
        [Tooltip("How often hands leave rest: 0.5 is as people do, 0 hardly ever, 1 nearly always.")]
        [Range(0, 1)] public float activity = 0.5f;
        [Tooltip("Object to look at, such as the player's head.")]
        public Transform lookAt;
        [Range(0, 1)] public float lookAtStrength = 1;
        [Tooltip("The interlocutor's voice: the avatar listens while this source is heard.")]
        public AudioSource otherSource;
        [Tooltip("Delay of the output device in seconds: about 0.2 for Bluetooth.")]
        [Range(0, 2)] public float outputDelay = 0;

        [Header("Layers over the model's motion, applied while running")]
        [Range(0, 1)] public float gazeLayer = 1;
        [Range(0, 1)] public float idleLayer = 1;
        [Range(0, 1)] public float asymmetryLayer = 1;
        [Range(0, 1)] public float nodsLayer = 1;
        [Range(0, 1)] public float moodLayer = 1;
        [Range(0, 1)] public float feetLayer = 1;
        [Range(0, 1)] public float bodyLayer = 1;

        [Header("Applied when enabled")]
        [Tooltip("Keyframes per step, ten a second in the default model: fewer reduce latency, more give more context. 0: the model's default.")]
        [Min(0)] public int target = 1;
        [Tooltip("Frames held back for smoother seams; adds that much latency. -1: the model's default.")]
        [Min(-1)] public int lookahead = -1;
        [Tooltip("Delay the voice until its motion is ready. Off: the voice plays at once and the motion lags.")]
        public bool delayVoice = true;
        [Tooltip("The voice plays at once, the mouth moves with it, and the body follows. Needs a model with a mouth network. UseMicrophone enables it.")]
        public bool liveVoice = false;
        [Tooltip("Whether the microphone's sound is also played.")]
        public bool playMicrophone = false;
        [Tooltip("Time reserved for computing in seconds, in addition to the audio that the model needs.")]
        [Range(0, 1)] public float margin = 0.1f;
        [Tooltip("Low-pass of the body's motion, standard deviation in frames: 0 turns it off. -1: the default.")]
        [Range(-1, 1.5f)] public float smoothing = -1;
        [Tooltip("Guidance strength of the prompt, for models that support it.")]
        [Range(1, 3)] public float guidance = 1;
        [Tooltip("Keyframes of future voice to use, for models that support it; adds that much latency.")]
        [Min(0)] public int horizon = 0;
        [Tooltip("Strength with which arms keep out of the body, whose girth is measured on the figure's meshes (Read/Write must be on). 0: the figure's own retargeting, without volume.")]
        [Range(0, 1)] public float volume = 0;
        [Tooltip("Custom gestures for PlayGesture.")]
        public UmoGesture[] gestures = new UmoGesture[0];
        [Tooltip("Language of the words of HintWords: en or de.")]
        public string language = "en";
        [Tooltip("Your own word rules (docs/words.md), added to the language's.")]
        public TextAsset wordRules;
        [Tooltip("The same seed and voice give the same motion.")]
        public int seed = 0;
        [Tooltip("Template of the model. Empty: speech to motion.")]
        public string template = "";

        private AudioSource source;
        private string path;
        private Session session;
        /// Read by the audio thread once per block.
        private volatile VoiceLine line;
        /// Used if there is no audio thread; else null.
        private ClipVoice voice;
        private bool cannotRead;
        private MotionClock clock;
        private Frames frame;
        private HumanFigure figure;
        private FaceShapes shapes;
        private Retarget retarget;
        /// Null without volume.
        private BodyRetarget body;
        private float[] rotations, translation, face;
        private Quat[] turned;
        private int rate, channels, lag, bodyLag;
        private double quiet, restLength, hostTime;
        private int blocks;
        private bool any, restart;
        private readonly double[] sent = new double[15];
        private Idle sentIdle;
        private string sentPrompt;
        private Mood sentMood;
        private float sentMoodStrength;
        private bool looks;
        private readonly float[] otherHeard = new float[4096];
        private float[] otherSamples;
        private bool usesMicrophone;
#if !UNITY_WEBGL || UNITY_EDITOR
        private string microphone;
#endif
        /// The rest pose is captured the first time: later poses are animated. Kept across code reloads.
        private Quaternion[] restRotations;
        private Vector3[] restPlaces;

        /// <summary>Reason why the avatar does not move; else empty.</summary>
        public string Error { get; private set; } = "";

        /// <summary>Notice that users of the model must be shown; may be empty.</summary>
        public string Notice { get; private set; } = "";

        /// <summary>Number of blend shapes found, and of bones.</summary>
        public int ShapeCount { get { return shapes == null ? 0 : shapes.Count; } }
        public int BoneCount { get { return figure == null ? 0 : figure.Count; } }

        /// <summary>Delay of voice and motion behind the AudioSource, in seconds.</summary>
        public float Delay { get { return rate == 0 ? 0 : lag / (float)rate; } }

        /// <summary>Whether the mouth moves as the sound is heard: the live voice is on and the model has a mouth network.</summary>
        public bool IsLive { get; private set; }

        /// <summary>The session, for anything this component does not offer; null if there is none.</summary>
        public Session Session { get { return session; } }

        /// Stands on the floor and faces ahead.
        internal Transform Body { get { return figure == null ? transform : figure.Root; } }

        /// Height of the eyes above the floor in metres.
        internal float EyeHeight { get { return figure == null ? 1.6f : figure.EyeHeight; } }

        private void OnEnable()
        {
            source = GetComponent<AudioSource>();
            AudioSettings.OnAudioConfigurationChanged += ConfigurationChanged;
            Begin(0);
        }

        private void OnDisable()
        {
            AudioSettings.OnAudioConfigurationChanged -= ConfigurationChanged;
            StopAllCoroutines();
            StopMicrophone();
            End();
        }

        private void ConfigurationChanged(bool deviceWasChanged) { restart = true; }

        /// <summary>Speaks a clip to its end: the AudioSource keeps playing until its last sound has been heard. Allocates.</summary>
        public void Speak(AudioClip clip)
        {
            if (UmoRuntime.IsPolled)
            {
                // The end is heard when its motion is shown, because the start is delayed equally.
                source.Stop();
                if (voice != null) voice.Stop();
                source.clip = clip;
                source.loop = false;
                source.Play();
                return;
            }
            float[] samples = new float[clip.samples * clip.channels];
            if (!clip.GetData(samples, 0))
            {
                Debug.LogWarning("umo: the samples of " + clip.name + " cannot be read: set its load type to Decompress On Load", this);
                return;
            }
            int tail = Mathf.CeilToInt(Delay * clip.frequency);
            Array.Resize(ref samples, (clip.samples + tail) * clip.channels);
            AudioClip longer = AudioClip.Create(clip.name, clip.samples + tail, clip.channels, clip.frequency, false);
            longer.SetData(samples, 0);
            source.Stop();
            source.clip = longer;
            source.loop = false;
            source.Play();
            if (spoken != null) Destroy(spoken);
            spoken = longer;
        }

        private AudioClip spoken;

        /// <summary>
        /// Speaks the input of a microphone, or the system's default if none is named, with the live voice if the model
        /// has a mouth network. Starts a new session.
        /// </summary>
        public void UseMicrophone(string device = null)
        {
#if UNITY_WEBGL && !UNITY_EDITOR
            Debug.LogWarning("umo: Unity WebGL players have no microphone", this);
#else
            StopMicrophone();
            AudioClip clip = Microphone.Start(device, true, 1, AudioSettings.outputSampleRate);
            if (clip == null)
            {
                Debug.LogWarning("umo: the microphone cannot be opened: is one connected, and allowed to be used?", this);
                return;
            }
            source.Stop();
            source.clip = clip;
            source.loop = true;
            microphone = device;
            usesMicrophone = true;
            restart = true;
#endif
        }

        /// <summary>Stops the microphone.</summary>
        public void StopMicrophone()
        {
            if (!usesMicrophone) return;
            usesMicrophone = false;
            restart = true;
            source.Stop();
            source.clip = null;
            source.loop = false;
#if !UNITY_WEBGL || UNITY_EDITOR
            Microphone.End(microphone);
#endif
        }

        /// <summary>
        /// Plays a gesture over the motion as soon as possible: one of GestureNames, such as wave, nod, thumbs_up, or
        /// point, which points at the target. False if the gesture is unknown or eight are already queued.
        /// </summary>
        public bool PlayGesture(string gesture, Transform target = null, Side side = Side.Auto, float strength = 1, byte variant = 0)
        {
            if (session == null) return false;
            GestureOptions options = Session.GestureDefaults;
            options.Side = side;
            options.Strength = Mathf.Clamp(strength, 0, 1);
            options.Variant = variant;
            Vec place;
            if (target != null && Place(target.position, out place)) options.PointAt(Axes.Unity, place.X, place.Y, place.Z);
            return Takes(session.PlayGesture(gesture, options));
        }

        /// <summary>Names of the available gestures; empty if there is no session.</summary>
        public string[] GestureNames { get { return session == null ? new string[0] : session.Engine.GestureNames(); } }

        /// <summary>
        /// Seconds of sound that the avatar has received, including silence: sound that starts to play now will be at this
        /// time, to within one block of the mixer. The clock of HintWords, and of Session.HintLips.
        /// </summary>
        public float GivenSeconds { get { return rate == 0 || line == null ? 0 : line.NextPlace / (float)rate; } }

        /// <summary>
        /// Gives a word and its time, as known from a speech synthesiser: some words become gestures. Times are on the clock
        /// of GivenSeconds, to be read when the speech starts to play. False if 64 words are queued.
        /// </summary>
        public bool HintWords(string text, float start, float end)
        {
            return session != null && Takes(session.HintWords(text, start, end));
        }

        private bool Takes(Status status)
        {
            if (status == Status.Ok) return true;
            Debug.LogWarning("umo: " + session.LastError(), this);
            return false;
        }

        /// <summary>Barge-in: the avatar falls silent at once and eases to rest. Later sound starts a new speech.</summary>
        public void Interrupt(float easeSeconds = 0.3f)
        {
            if (session == null) return;
            uint ease = (uint)Mathf.RoundToInt(1000 * Mathf.Clamp(easeSeconds, 0, 10));
            source.Stop();
            if (voice != null) voice.Stop();
            line.Playing = false;
            line.Clear();
            if (!Works(session.Interrupt(ease))) return;
            clock.Interrupt(frame.Index(0), any, ease, line.Pushed);
            line.StartAt(clock.NextSample);
        }

        private void Begin(int hostChannels)
        {
            Error = Notice = "";
            restart = false;
            path = System.IO.Path.Combine(Application.streamingAssetsPath, model);
            if (path.Contains("://") && !UmoRuntime.Has(path)) StartCoroutine(Fetch(hostChannels));
            else Begin(hostChannels, null);
        }

        /// For assets that are packed in an archive, as on Android.
        private IEnumerator Fetch(int hostChannels)
        {
            // In WebGL players the library is stored beside the model.
            WebLibrary.Load(System.IO.Path.Combine(Application.streamingAssetsPath, "umo.wasm"));
            while (!LibraryIsReady())
            {
                if (Error.Length > 0) yield break;
                yield return null;
            }
            using (UnityWebRequest request = UnityWebRequest.Get(path))
            {
                yield return request.SendWebRequest();
                if (!string.IsNullOrEmpty(request.error)) Fail(path + ": " + request.error);
                else Begin(hostChannels, request.downloadHandler.data);
            }
        }

        private bool LibraryIsReady()
        {
            try
            {
                return WebLibrary.IsReady;
            }
            catch (UmoException error)
            {
                Fail(error.Message);
                return false;
            }
        }

        private void Begin(int hostChannels, byte[] bytes)
        {
            try
            {
                Engine engine = UmoRuntime.Acquire(path, bytes);
                try
                {
                    Make(engine, hostChannels);
                }
                catch
                {
                    UmoRuntime.Release(path, engine);
                    throw;
                }
            }
            catch (UmoException error)
            {
                Fail(error.Message);
            }
            catch (DllNotFoundException)
            {
                Fail("the native library is missing: bindings/unity/fetch-native copies it into the package's Plugins folder");
            }
            catch (EntryPointNotFoundException error)
            {
                Fail("the native library is of another version: " + error.Message);
            }
        }

        private void Make(Engine engine, int hostChannels)
        {
            Model loaded = engine.Model;
            // The mixer's rate, which filters receive, not the clip's. Without filters, clips are read.
            bool polled = UmoRuntime.IsPolled;
            AudioClip clip = polled ? source.clip : null;
            rate = clip != null ? clip.frequency : AudioSettings.outputSampleRate;
            channels = hostChannels > 0 ? hostChannels : SpeakerChannels(AudioSettings.speakerMode);
            if (polled) channels = clip != null ? clip.channels : 1;
            SessionConfig config = Session.Defaults(loaded);
            config.SampleRate = (uint)rate;
            config.Channels = (uint)channels;
            config.Seed = (ulong)seed;
            if (target > 0) config.Target = (uint)target;
            if (lookahead >= 0) config.Lookahead = (uint)lookahead;
            IsLive = (liveVoice || usesMicrophone) && loaded.Info.HasMouth != 0;
            config.Voice = IsLive ? Voice.Live : Voice.Delayed;
            if (smoothing >= 0) config.Smoothing = Mathf.Clamp(smoothing, 0, 1.5f);
            config.Guidance = Mathf.Clamp(guidance, 1, 3);
            config.Horizon = (uint)Math.Max(horizon, 0);
            foreach (UmoGesture gesture in gestures) if (gesture != null) gesture.AddTo(engine);
            engine.SetWordRules(language, wordRules == null ? null : wordRules.text);
            Session made = new Session(engine, config, string.IsNullOrEmpty(template) ? null : template);

            Latency latency;
            made.GetLatency(out latency);
            int length, count;
            AudioSettings.GetDSPBufferSize(out length, out count);
            int delay = (int)latency.AlgorithmicSamples + Mathf.CeilToInt(margin * rate);
            // The mixer's output is heard after its buffers have been played.
            int buffered = polled ? 0 : length * count;
            bodyLag = delay + buffered;
            lag = IsLive ? Math.Max((int)latency.MouthSamples, buffered) : bodyLag;
            restLength = (config.IdleAfterMs + config.EaseMs) / 1000.0;
            quiet = double.MaxValue;
            hostTime = 0;
            any = false;

            Notice = loaded.Notice;
            clock = new MotionClock(rate);
            frame = new Frames(loaded, 1, Axes.Unity);
            rotations = new float[4 * Native.JointCount];
            translation = new float[3];
            face = new float[frame.Channels];
            FindFigure(loaded);
            for (int i = 0; i < sent.Length; i++) sent[i] = 1;
            sent[AttentionIndex] = (double)Attention.Auto;
            sent[DelayIndex] = 0;
            sent[ExpressionIndex] = sent[ActivityIndex] = 0.5;
            sentIdle = config.Idle;
            sentPrompt = "";
            sentMood = Mood.Neutral;
            sentMoodStrength = 1;
            looks = false;
            otherSamples = new float[otherHeard.Length * channels];
            session = made;
            int later = delayVoice && !IsLive ? delay : 0;
            VoiceLine now = new VoiceLine(made, rate, channels, polled ? 0 : later, usesMicrophone && !playMicrophone);
            voice = polled ? new ClipVoice(now, rate, channels, later) : null;
            cannotRead = false;
            line = now;
        }

        private void FindFigure(Model loaded)
        {
            SkinnedMeshRenderer[] meshes = faces != null && faces.Length > 0 ? faces : GetComponentsInChildren<SkinnedMeshRenderer>(true);
            shapes = new FaceShapes(meshes, loaded.ChannelNames());
            Animator found = animator != null ? animator : GetComponentInChildren<Animator>();
            figure = null;
            if (found == null || !found.isHuman) return;
            figure = new HumanFigure(found, shapes.Channels == 0);
            if (restPlaces == null || restPlaces.Length != figure.Count) figure.Capture(out restRotations, out restPlaces);
            int[] parents;
            float[] offsets;
            loaded.Skeleton(Axes.Unity, out parents, out offsets);
            retarget = new Retarget(parents, offsets, figure.Rest(restRotations, restPlaces));
            turned = new Quat[figure.Count];
            FindVolume(loaded);
        }

        private void FindVolume(Model loaded)
        {
            if (body != null) body.Dispose();
            body = null;
            if (!(volume > 0)) return;
            List<string> notes = new List<string>();
            try
            {
                body = new BodyRetarget(loaded, figure, restRotations, restPlaces, Mathf.Clamp(volume, 0, 1), notes);
            }
            catch (UmoException error)
            {
                notes.Add("no volume: " + error.Message);
            }
            foreach (string note in notes) Debug.LogWarning("umo: " + note, this);
        }

        private void End()
        {
            line = null;
            if (body != null) body.Dispose();
            body = null;
            if (voice != null) voice.Release(source);
            voice = null;
            if (session == null) return;
            // The audio thread may still be processing a block: the library reports this, and Dispose waits.
            session.Dispose();
            UmoRuntime.Release(path, session.Engine);
            session = null;
        }

        private void Fail(string message)
        {
            Error = message;
            Debug.LogError("umo: " + message, this);
            End();
        }

        private bool Works(Status status)
        {
            if (status == Status.Ok || status == Status.Busy) return true;
            Fail(UmoException.Describe(status) + ": " + session.LastError());
            return false;
        }

        private void OnAudioFilterRead(float[] data, int blockChannels)
        {
            VoiceLine now = line;
            if (now != null) now.Process(data, blockChannels);
        }

        private void LateUpdate()
        {
            if (session == null) return;
            if (restart || line.ChannelsSeen != channels || (voice != null && voice.IsOther(source.clip)))
            {
                int seen = restart ? 0 : line.ChannelsSeen;
                End();
                Begin(seen);
                if (session == null) return;
            }
            if (!Send() || !Look() || !Listen() || !Works(line.Status)) return;
            if (usesMicrophone && !source.isPlaying) PlayMicrophone();
            double seconds = FrameSeconds;
            if (voice != null && !voice.Follow(source, seconds) && !cannotRead)
            {
                cannotRead = true;
                Debug.LogWarning("umo: the samples of " + source.clip.name + " cannot be read: set its load type to Decompress On Load", this);
            }
            Tick(seconds);
            UmoRuntime.Compute();
            // Without speech, motion follows the frame time, however long frames take to render.
            hostTime += seconds;
            if (!Works(session.SetClock(hostTime))) return;
            Sampled sampled;
            if (!Works(session.SamplePose(clock.Time, frame, out sampled))) return;
            if (sampled.IsAhead == 0) any = true;
            if (any) clock.Follow(frame.Index(0), frame.Sample(0));
            Show();
        }

        /// Duration of a frame: that of the captured film while capturing, else real time.
        internal static double FrameSeconds
        {
            get { return Time.captureFramerate > 0 ? 1.0 / Time.captureFramerate : Time.unscaledDeltaTime; }
        }

        private void Tick(double seconds)
        {
            line.Playing = voice != null ? voice.Plays : source.isPlaying;
            if (line.Playing)
            {
                quiet = 0;
                clock.Advance(seconds, line.Pushed - lag);
                return;
            }
            // Filters of a stopped source are not called, so the end of the speech would never be shown.
            quiet += seconds;
            // The rest of a voice that was cut off must not be heard before the next one.
            if (quiet < 0.2) blocks = line.Blocks;
            else if (blocks == line.Blocks) line.Clear();
            else blocks = -1;
            double tail = bodyLag / (double)rate + outputDelay + 0.1;
            bool feeds = idle == Idle.Live || quiet < tail;
            if (feeds)
            {
                line.Silence((int)Math.Round(seconds * rate));
                clock.Advance(seconds, line.Pushed - lag);
            }
            else if (idle == Idle.Rest && quiet < tail + restLength)
            {
                clock.Rest(seconds);
                line.StartAt(clock.NextSample);
            }
        }

        /// Starts playing a microphone's clip slightly behind its write position.
        private void PlayMicrophone()
        {
#if !UNITY_WEBGL || UNITY_EDITOR
            int written = Microphone.GetPosition(microphone), length = source.clip.samples;
            if (written <= 0) return;
            source.Play();
            source.timeSamples = (written + length - source.clip.frequency / 50) % length;
#endif
        }

        /// Sends the look-at target, scaled to the model's size.
        private bool Look()
        {
            if (lookAt == null && !looks) return true;
            looks = lookAt != null;
            if (!looks) return Works(session.LookAt(Axes.Unity, 0, 0, 0, 0));
            Vec at;
            if (!Place(lookAt.position, out at)) return true;
            return Works(session.LookAt(Axes.Unity, at.X, at.Y, at.Z, Mathf.Clamp(lookAtStrength, 0, 1)));
        }

        /// Converts a world position to the model's space and size; false if it is not finite.
        private bool Place(Vector3 world, out Vec at)
        {
            Vector3 place = Body.InverseTransformPoint(world);
            at = new Vec(place.x, place.y, place.z);
            if (figure != null) at = retarget.Place(at);
            float distance = at.Length;
            // The library accepts positions within 10 km.
            if (distance > 9000) at = 9000 / distance * at;
            return distance < float.PositiveInfinity;
        }

        /// Sends the interlocutor's audio since the last frame: one channel, since only its loudness counts.
        private bool Listen()
        {
            // WebGL players do not expose the output of a source.
            if (otherSource == null || !otherSource.isPlaying || voice != null) return true;
            int count = Math.Min(Mathf.RoundToInt((float)(FrameSeconds * rate)), otherHeard.Length);
            otherSource.GetOutputData(otherHeard, 0);
            for (int i = 0; i < count * channels; i++) otherSamples[i] = otherHeard[otherHeard.Length - count + i / channels];
            return Works(session.PushOtherAudio(otherSamples, 0, count * channels));
        }

        /// Indices of the attention, the output delay, the expression and the activity in `sent`.
        private const int AttentionIndex = 11, DelayIndex = 12, ExpressionIndex = 13, ActivityIndex = 14;

        /// Sends settings that were changed in the inspector or by a script.
        private bool Send()
        {
            bool works = Send(0, Parameter.GainFace, faceGain, 2) && Send(1, Parameter.GainHands, handsGain, 2)
                && Send(2, Parameter.GainUpper, upperGain, 2) && Send(3, Parameter.GainLower, lowerGain, 2)
                && Send(4, Parameter.LayerGaze, gazeLayer, 1) && Send(5, Parameter.LayerIdle, idleLayer, 1)
                && Send(6, Parameter.LayerAsymmetry, asymmetryLayer, 1) && Send(7, Parameter.LayerNods, nodsLayer, 1)
                && Send(8, Parameter.LayerMood, moodLayer, 1) && Send(9, Parameter.LayerFeet, feetLayer, 1)
                && Send(10, Parameter.LayerBody, bodyLayer, 1)
                && Send(AttentionIndex, Parameter.Attention, (float)attention, (float)Attention.Speaking)
                && Send(DelayIndex, Parameter.OutputDelay, outputDelay, 2)
                && Send(ExpressionIndex, Parameter.Expression, expression, 1)
                && Send(ActivityIndex, Parameter.Activity, activity, 1);
            float strength = Mathf.Clamp(moodStrength, 0, 1);
            if (works && (mood != sentMood || strength != sentMoodStrength))
            {
                works = Works(session.SetMood(mood, strength));
                sentMood = mood;
                sentMoodStrength = strength;
            }
            // This component inserts the silence for Live, so that sound and motion share one clock.
            Idle wanted = idle == Idle.Rest ? Idle.Rest : Idle.Hold;
            if (works && wanted != sentIdle)
            {
                works = Works(session.Set(Parameter.Idle, (uint)wanted));
                sentIdle = wanted;
            }
            string text = prompt ?? "";
            if (works && text != sentPrompt)
            {
                sentPrompt = text;
                Status status = session.SetPrompt(text);
                if (status == Status.Unsupported) Debug.LogWarning("umo: " + model + " takes no prompts", this);
                else works = Works(status);
            }
            return works;
        }

        private bool Send(int index, Parameter parameter, float value, float most)
        {
            double wanted = Mathf.Clamp(value, 0, most);
            if (wanted == sent[index]) return true;
            sent[index] = wanted;
            return Works(session.Set(parameter, wanted));
        }

        private void Show()
        {
            if (shapes.Count > 0)
            {
                frame.Face(0, face);
                shapes.Show(face);
            }
            if (figure == null) return;
            frame.Rotations(0, rotations);
            frame.Translation(0, translation);
            Vec hips = retarget.Hips(translation);
            if (body != null) body.Apply((float)FrameSeconds, rotations, translation, turned, ref hips);
            else retarget.Rotate(rotations, turned);
            figure.Show(turned, hips, moveHips);
        }

        private static int SpeakerChannels(AudioSpeakerMode mode)
        {
            switch (mode)
            {
                case AudioSpeakerMode.Mono: return 1;
                case AudioSpeakerMode.Quad: return 4;
                case AudioSpeakerMode.Surround: return 5;
                case AudioSpeakerMode.Mode5point1: return 6;
                case AudioSpeakerMode.Mode7point1: return 8;
                default: return 2;
            }
        }
    }
}
