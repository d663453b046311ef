// SPDX-License-Identifier: MIT OR Apache-2.0
// Tests MODEL WAV LAYOUT FRAMES-GLTF FRAMES-UNITY MOUTH: LAYOUT is the output of tests/layout, FRAMES the output of
// tests/reference, MOUTH a model with a mouth network.

using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Runtime.CompilerServices;
using System.Runtime.InteropServices;
using System.Text.RegularExpressions;
using System.Threading;
using Umo;
using ParameterInfo = Umo.ParameterInfo;

internal static unsafe class Tests
{
    private static string modelPath, headerPath, mouthPath, salute;
    private static string[] framesPaths;
    private static short[] speech;
    private static Model model;
    private static Engine engine;
    private const int Rate = 16000;

    private static int Main(string[] args)
    {
        modelPath = args[0];
        byte[] wav = File.ReadAllBytes(args[1]);
        speech = new short[(wav.Length - 44) / 2];
        Buffer.BlockCopy(wav, 44, speech, 0, 2 * speech.Length);
        headerPath = args[2];
        framesPaths = new[] { args[3], args[4] };
        mouthPath = args[5];
        salute = args[6];
        model = Model.Load(modelPath);
        engine = new Engine(model);

        int failed = 0;
        MethodInfo[] tests = typeof(Tests).GetMethods(BindingFlags.NonPublic | BindingFlags.Static)
            .Where(m => m.IsDefined(typeof(TestAttribute), false)).ToArray();
        foreach (MethodInfo test in tests)
        {
            try
            {
                test.Invoke(null, null);
                Console.WriteLine("ok      " + test.Name);
            }
            catch (TargetInvocationException error)
            {
                failed++;
                Console.WriteLine("FAILED  " + test.Name + "\n" + error.InnerException);
            }
        }
        Console.WriteLine("{0} tests, {1} failed", tests.Length, failed);
        engine.Dispose();
        model.Dispose();
        return failed == 0 && tests.Length > 0 ? 0 : 1;
    }

    [AttributeUsage(AttributeTargets.Method)]
    private sealed class TestAttribute : Attribute { }

    private static void Equal<T>(T wanted, T got, string what = "")
    {
        if (!EqualityComparer<T>.Default.Equals(wanted, got)) throw new Exception(what + ": wanted " + wanted + ", got " + got);
    }

    private static void True(bool what, string message)
    {
        if (!what) throw new Exception(message);
    }

    private static Session NewSession(Action<SessionConfigBox> change = null)
    {
        SessionConfigBox box = new SessionConfigBox { Config = Session.Defaults(model) };
        if (change != null) change(box);
        return new Session(engine, box.Config);
    }

    private sealed class SessionConfigBox { public SessionConfig Config; }

    [Test]
    private static void every_function_of_the_header_is_there_and_no_other()
    {
        string code = Regex.Replace(File.ReadAllText(headerPath), "//.*|/\\*(.|\\n)*?\\*/", "");
        string[] wanted = Regex.Matches(code, @"\b(umo_\w+)\(").Cast<Match>().Select(match => match.Groups[1].Value).OrderBy(name => name).ToArray();
        True(wanted.Length > 50, "the header was not read");
        MethodInfo[] methods = typeof(Native).GetMethods(BindingFlags.Public | BindingFlags.Static)
            .Where(method => (method.Attributes & MethodAttributes.PinvokeImpl) != 0).ToArray();
        Equal(string.Join(" ", wanted), string.Join(" ", methods.Select(method => method.Name).OrderBy(name => name)));
        // Throws if the library lacks the symbol.
        foreach (MethodInfo method in methods) Marshal.Prelink(method);
        Equal(Native.AbiVersion, Native.umo_abi_version());
    }

    private static byte[] Speak(Axes axes, int piece, bool floats)
    {
        Frames frames = new Frames(model, 7, axes);
        MemoryStream all = new MemoryStream();
        int total = speech.Length * 30 / Rate, done = 0, got = 0, taken, count;
        float[] samples = speech.Select(s => s / 32768f).ToArray();
        using (Session session = NewSession())
        {
            while (got < total)
            {
                if (done < speech.Length)
                {
                    int next = Math.Min(piece, speech.Length - done);
                    Equal(Status.Ok, floats ? session.PushAudio(samples, done, next, out taken) : session.PushAudio(speech, done, next, out taken));
                    done += taken;
                    if (done == speech.Length) Equal(Status.Ok, session.Finish());
                }
                Equal(Status.Ok, session.PullFrames(frames, out count));
                byte[] bytes = new byte[count * frames.Layout.FrameStride];
                Buffer.BlockCopy(frames.Words, 0, bytes, 0, bytes.Length);
                all.Write(bytes, 0, bytes.Length);
                got += count;
                if (count == 0 && done == speech.Length) Thread.Sleep(1);
            }
        }
        return all.ToArray();
    }

    [Test]
    private static void frames_are_those_of_c_bit_for_bit()
    {
        byte[] gltf = File.ReadAllBytes(framesPaths[0]), unity = File.ReadAllBytes(framesPaths[1]);
        True(gltf.Length > 200 * 1000 && !gltf.SequenceEqual(unity), "the reference has no frames");
        True(Speak(Axes.Gltf, 1000, false).SequenceEqual(gltf), "frames differ");
        True(Speak(Axes.Unity, 333, true).SequenceEqual(unity), "frames in Unity's axes differ");
    }

    [Test]
    private static void values_of_a_frame_are_found_where_the_layout_says()
    {
        Frames frames = new Frames(model, 4, Axes.Gltf);
        byte[] reference = File.ReadAllBytes(framesPaths[0]);
        FrameLayout layout = frames.Layout;
        Buffer.BlockCopy(reference, 100 * (int)layout.FrameStride, frames.Words, 0, 4 * (int)layout.FrameStride);
        float[] place = new float[3], rotations = new float[220], face = new float[frames.Channels], visemes = new float[15];
        for (int i = 0; i < 4; i++)
        {
            int start = (100 + i) * (int)layout.FrameStride;
            Equal((ulong)(100 + i), frames.Index(i));
            Equal((ulong)(100 + i) * Rate / 30, frames.Sample(i));
            frames.Translation(i, place);
            frames.Rotations(i, rotations);
            frames.Face(i, face);
            frames.Visemes(i, visemes);
            Equal(BitConverter.ToSingle(reference, start + (int)layout.Translation + 4), place[1]);
            Equal(BitConverter.ToSingle(reference, start + (int)layout.Rotations + 4 * 219), rotations[219]);
            Equal(BitConverter.ToSingle(reference, start + (int)layout.Channels + 4 * 51), face[51]);
            Equal(BitConverter.ToSingle(reference, start + (int)layout.Visemes + 4 * 14), visemes[14]);
            True(Math.Abs(visemes.Sum() - 1) < 1e-5, "visemes add up to 1");
            for (int joint = 0; joint < 55; joint++)
            {
                double norm = Enumerable.Range(4 * joint, 4).Sum(k => (double)rotations[k] * rotations[k]);
                True(Math.Abs(norm - 1) < 1e-4, "joint " + joint + " has norm " + norm);
            }
        }
        Throws<ArgumentOutOfRangeException>(() => frames.Index(4));
        Throws<ArgumentException>(() => frames.Face(0, new float[3]));
    }

    /// The file is the same for frames in either axes.
    [Test]
    private static void frames_become_files()
    {
        Equal("alex bea carl dina", string.Join(" ", Model.FigureNames()));
        string path = Path.Combine(Path.GetTempPath(), "umo-B\u00e4r-" + System.Diagnostics.Process.GetCurrentProcess().Id + ".glb");
        List<byte[]> files = new List<byte[]>();
        try
        {
            foreach (Axes axes in new[] { Axes.Gltf, Axes.Unity })
            {
                byte[] reference = File.ReadAllBytes(framesPaths[axes == Axes.Gltf ? 0 : 1]);
                Frames frames = new Frames(model, 90, axes);
                Buffer.BlockCopy(reference, 0, frames.Words, 0, (int)frames.Size);
                frames.WriteFile(model, 90, FileFormat.Glb, path);
                files.Add(File.ReadAllBytes(path));
                frames.WriteFile(model, 90, FileFormat.Glb, path, null);
                True(File.ReadAllBytes(path).Length < files[0].Length, "the file has a figure");
                frames.WriteFile(model, 90, FileFormat.Vrma, path);
                Throws<UmoException>(() => frames.WriteFile(model, 90, FileFormat.Glb, path, "zoe"));
                Throws<UmoException>(() => frames.WriteFile(model, 0, FileFormat.Glb, path));
                Throws<ArgumentOutOfRangeException>(() => frames.WriteFile(model, 91, FileFormat.Glb, path));
            }
        }
        finally
        {
            File.Delete(path);
        }
        True(files[0].Length > 1000 * 1000 && files[0].SequenceEqual(files[1]), "the files differ");
    }

    private static T Throws<T>(Action action) where T : Exception
    {
        try
        {
            action();
        }
        catch (T error)
        {
            return error;
        }
        throw new Exception("no " + typeof(T).Name);
    }

    [Test]
    private static void a_model_says_what_it_has()
    {
        Equal(30u, model.Info.FrameRate);
        Equal(52, model.ChannelNames().Length);
        Equal("jawOpen", model.ChannelNames()[Array.IndexOf(model.ChannelNames(), "jawOpen")]);
        Equal("pelvis left_elbow", Model.JointNames()[0] + " " + Model.JointNames()[18]);
        Equal("sil ou", Model.VisemeNames()[0] + " " + Model.VisemeNames()[14]);
        True(model.Name.Length > 0 && model.License.Contains("MIT"), "name and licence");
        int[] parents;
        float[] offsets, mirrored;
        model.Skeleton(Axes.Gltf, out parents, out offsets);
        model.Skeleton(Axes.Unity, out parents, out mirrored);
        Equal(-1, parents[0]);
        Equal(16, parents[18]);
        // The left arm lies along +X in glTF's axes, along -X in Unity's.
        True(offsets[3 * 18] > 0.1f, "left elbow");
        Equal(-offsets[3 * 18], mirrored[3 * 18]);
        using (Model same = Model.Load(File.ReadAllBytes(modelPath))) Equal(model.Name, same.Name);
        if (model.Info.HasText == 1) True(model.EncodeText("hello").Length > 0, "ids of a text");
        else Equal(Status.Unsupported, Throws<UmoException>(() => model.EncodeText("hello")).Status);
    }

    [Test]
    private static void this_machine_tests_itself()
    {
        string report;
        True(model.SelfTest(out report), report);
        True(report.StartsWith("umo ") && report.Contains("self-test passed") && !report.Contains("/"), report);
    }

    [Test]
    private static void setting_up_wrongly_throws_the_right_status()
    {
        UmoException error = Throws<UmoException>(() => Model.Load("/no/such/file"));
        Equal(Status.Io, error.Status);
        True(error.Message.Contains("/no/such/file"), error.Message);
        Equal(Status.Model, Throws<UmoException>(() => Model.Load(new byte[64])).Status);
        Throws<ArgumentNullException>(() => Model.Load((string)null));
        EngineConfig config = Engine.Defaults;
        config.Threads = 65;
        error = Throws<UmoException>(() => new Engine(model, config));
        Equal(Status.InvalidArgument, error.Status);
        True(error.Message.Contains("65"), error.Message);
        config = Engine.Defaults;
        config.Priority = (Priority)3;
        error = Throws<UmoException>(() => new Engine(model, config));
        Equal(Status.InvalidArgument, error.Status);
        True(error.Message.Contains("priority 3"), error.Message);
        config.Priority = Priority.Low;
        config.BatchWindowMs = 50;
        new Engine(model, config).Dispose();
        Equal(Status.InvalidArgument, Throws<UmoException>(() => NewSession(box => box.Config.SampleRate = 7999)).Status);
        Equal(Status.StructSize, Throws<UmoException>(() => NewSession(box => box.Config.StructSize = 3)).Status);
        Throws<UmoException>(() => new Session(engine, null, "no_such_template"));
        FrameLayout layout = model.Layout(Axes.Unity);
        Equal(10, model.CheckLayout(layout, 10 * layout.FrameStride));
        layout.Axes = (Axes)9;
        Equal(Status.InvalidArgument, Throws<UmoException>(() => model.CheckLayout(layout, 1 << 20)).Status);
        using (Model gone = Model.Load(modelPath))
        {
            gone.Dispose();
            Equal(Status.InvalidHandle, Throws<UmoException>(() => new Engine(gone)).Status);
            Equal(Status.InvalidHandle, Throws<UmoException>(() => gone.ChannelNames()).Status);
        }
    }

    [Test]
    private static void wrong_use_of_a_session_gives_the_right_status()
    {
        int taken, count;
        double value;
        bool more;
        Sampled sampled;
        Frames frames = new Frames(model, 2, Axes.Gltf);
        using (Session session = NewSession(box => box.Config.Channels = 2))
        {
            Equal(Status.InvalidArgument, session.PushAudio(new float[3], 0, 3, out taken));
            True(session.LastError().Length > 0, "a detail");
            Equal(Status.InvalidArgument, session.PushAudio(new float[4], 2, 4, out taken));
            Equal(Status.InvalidArgument, session.PushAudio(new float[4], -2, 2, out taken));
            Equal(Status.InvalidArgument, session.PushAudio(new short[4], 4, int.MaxValue, out taken));
            Equal(Status.NullPointer, session.PushAudio((float[])null, 0, 0, out taken));
            Equal(Status.Ok, session.PushAudio(new float[0], 0, 0, out taken));
            Equal(Status.Ok, session.PushAudio(new float[4], 4, 0, out taken));
            Equal(Status.Ok, session.PushAudio(new float[8], 2, 4, out taken));
            Equal(4, taken);
            Equal(Status.NullPointer, session.PullFrames(null, out count));
            Equal(Status.InvalidArgument, session.SamplePose(double.NaN, frames, out sampled));
            Equal(Status.InvalidArgument, session.Set(Parameter.GainFace, 2.5));
            Equal(Status.InvalidArgument, session.Set((Parameter)99, 0));
            Equal(Status.Ok, session.Set(Parameter.GainFace, 0.5));
            Equal(Status.Ok, session.Get(Parameter.GainFace, out value));
            Equal(0.5, value);
            Equal(Status.Ok, session.Set(Parameter.Attention, (double)Attention.Thinking));
            Equal(Status.InvalidArgument, session.Set(Parameter.Attention, 5));
            Equal(Status.InvalidArgument, session.Set(Parameter.LayerGaze, 1.5));
            Equal(Status.Ok, session.Set(Parameter.LayerFeet, 0.25));
            Equal(Status.Ok, session.Get(Parameter.LayerFeet, out value));
            Equal(0.25, value);
            Equal(Status.InvalidArgument, session.Set(Parameter.OutputDelay, 2.5));
            Equal(Status.Ok, session.Set(Parameter.OutputDelay, 0.2));
            Equal(Status.Ok, session.Get(Parameter.OutputDelay, out value));
            Equal(0.2, value);
            Equal(Status.InvalidArgument, session.PushOtherAudio(new float[3], 0, 3));
            Equal(Status.InvalidArgument, session.PushOtherAudio(new float[4], 2, 4));
            Equal(Status.NullPointer, session.PushOtherAudio(null, 0, 0));
            Equal(Status.Ok, session.PushOtherAudio(new float[4], 4, 0));
            Equal(Status.Ok, session.PushOtherAudio(new float[8], 2, 4));
            Equal(Status.InvalidArgument, session.LookAt(Axes.Unity, 0, float.NaN, 1, 1));
            Equal(Status.InvalidArgument, session.LookAt((Axes)9, 0, 1, 1, 1));
            Equal(Status.InvalidArgument, session.LookAt(Axes.Unity, 0, 1, 1, 1.5f));
            Equal(Status.Ok, session.LookAt(Axes.Unity, 0, 1, 1, 1));
            Equal(Status.InvalidArgument, session.SetMood((Mood)7, 1));
            Equal(Status.InvalidArgument, session.SetMood(Mood.Joy, -1));
            Equal(Status.Ok, session.SetMood(Mood.Joy, 0.5f));
            Equal(Status.InvalidArgument, session.HintLips((LipShape)3, 0, 0.1));
            Equal(Status.InvalidArgument, session.HintLips(LipShape.Closed, -1, 0.1));
            Equal(Status.Ok, session.HintLips(LipShape.Closed, 0.5, 0.1));
            Equal(Status.NullPointer, session.HintWords(null, 0, 0.1));
            Equal(Status.InvalidArgument, session.HintWords("no", 1, 0.5));
            Equal(Status.Ok, session.HintWords("no", 0.5, 0.8));
            Equal(Status.NullPointer, session.PlayGesture(null));
            Equal(Status.InvalidArgument, session.PlayGesture("somersault"));
            True(session.LastError().Contains("somersault"), session.LastError());
            GestureOptions options = Session.GestureDefaults;
            options.Speed = 9;
            Equal(Status.InvalidArgument, session.PlayGesture("nod", options));
            options = Session.GestureDefaults;
            options.Variant = 256;
            Equal(Status.InvalidArgument, session.PlayGesture("nod", options));
            options.Variant = 5;
            options.PointAt(Axes.Unity, 1, float.NaN, 2);
            Equal(Status.InvalidArgument, session.PlayGesture("point", options));
            options.PointAt(Axes.Unity, 1, 1.5f, 2);
            Equal(Status.Ok, session.PlayGesture("point", options));
            Equal(Status.Ok, session.PlayGesture("nod"));
            Equal(Status.InvalidArgument, session.Interrupt(10001));
            Equal(Status.Unsupported, engine.Poll(0, out more));
            Equal(Status.InvalidArgument, session.SetPromptIds(new uint[] { uint.MaxValue }));
            Equal(Status.Ok, session.SetPromptIds(new uint[0]));
            Equal(model.Info.HasText == 1 ? Status.Ok : Status.Unsupported, session.SetPrompt("wave"));
            Equal(Status.Ok, session.Finish());
            Equal(Status.Finished, session.PushAudio(new float[2], 0, 2, out taken));
            Equal(Status.Ok, session.Reset());
            Equal(Status.Ok, session.PushAudio(new float[2], 0, 2, out taken));
            Stats stats;
            Equal(Status.Ok, session.GetStats(out stats));
            session.Dispose();
            session.Dispose();
            Equal(Status.InvalidHandle, session.PushAudio(new float[2], 0, 2, out taken));
            Equal(Status.InvalidHandle, session.PullFrames(frames, out count));
            Equal(Status.InvalidHandle, session.Finish());
            Equal("", session.LastError());
        }
    }

    [Test]
    private static void a_session_outlives_its_engine_and_says_so()
    {
        int taken;
        Engine brief = new Engine(model);
        using (Session session = new Session(brief))
        {
            brief.Dispose();
            Equal(Status.Closed, session.PushAudio(speech, 0, 160, out taken));
        }
        Equal(Status.InvalidHandle, Throws<UmoException>(() => new Session(brief)).Status);
    }

    [Test]
    private static void the_arousal_of_a_voice_is_heard()
    {
        using (Session session = NewSession())
        {
            float arousal, trend;
            Equal(Status.Ok, session.Arousal(out arousal, out trend));
            True(arousal == 0.5f && trend == 0, "an ordinary voice before the first frame");
            Equal(Status.Ok, session.Set(Parameter.Expression, 1));
        }
    }

    [Test]
    private static void hosts_give_their_time()
    {
        using (Session session = new Session(engine))
        {
            Frames frame = new Frames(model, 1, Axes.Unity);
            float[] first = new float[4 * Native.JointCount], second = new float[4 * Native.JointCount];
            Sampled sampled;
            Equal(Status.InvalidArgument, session.SetClock(-1));
            Equal(Status.Ok, session.SetClock(7));
            for (int i = 0; i < 3; i++) Equal(Status.Ok, session.SamplePose(0, frame, out sampled));
            frame.Rotations(0, first);
            System.Threading.Thread.Sleep(50);
            Equal(Status.Ok, session.SamplePose(0, frame, out sampled));
            frame.Rotations(0, second);
            True(first.SequenceEqual(second), "it must stand still while the host's time does");
            Equal(Status.Ok, session.SetClock(7.5));
            Equal(Status.Ok, session.SamplePose(0, frame, out sampled));
            frame.Rotations(0, second);
            True(!first.SequenceEqual(second), "it must move when the host's time does");
        }
    }

    [Test]
    private static void settings_of_the_motion_make_the_latency()
    {
        SessionConfig config = Session.Defaults(model);
        True(config.Smoothing > 0 && config.Guidance == 1 && config.Horizon == 0, "the defaults");
        config.Lookahead = 0;
        ulong[] samples = new ulong[2];
        for (int i = 0; i < 2; i++)
        {
            Latency latency;
            using (Session session = new Session(engine, config)) session.GetLatency(out latency);
            samples[i] = latency.AlgorithmicSamples;
            config.Smoothing = 0;
        }
        Equal(samples[1] + 3 * config.SampleRate / 30, samples[0]);
        config.Guidance = 9;
        True(Throws<UmoException>(() => new Session(engine, config)).Message.Contains("guidance"), "the message must name the setting");
    }

    [Test]
    private static void hosts_add_gestures()
    {
        using (Engine own = new Engine(model))
        {
            string[] names = own.GestureNames();
            True(names.Contains("wave") && names.Contains("point"), string.Join(" ", names));
            float[] still = new float[31 * 4 * Native.JointCount];
            for (int i = 3; i < still.Length; i += 4) still[i] = 1;
            UmoException error = Throws<UmoException>(() => own.AddGesture("late", still, 30, 2, Gesture.Head, Axes.Unity));
            Equal(Status.InvalidArgument, error.Status);
            True(error.Message.Contains("stroke"), error.Message);
            Throws<ArgumentException>(() => own.AddGesture("part", new float[5], 30, 0, Gesture.Head, Axes.Unity));
            own.AddGesture("salute", still, 30, 0.5f, Gesture.Head | Gesture.RightArm, Axes.Unity);
            Equal("salute", own.GestureNames().Last());
            using (Session session = new Session(own)) Equal(Status.Ok, session.PlayGesture("salute"));

            byte[] file = File.ReadAllBytes(salute);
            own.AddGestureFile("greet", salute, null, Gesture.RightArm);
            own.AddGestureFile("look", file, "turn", Gesture.Head, 0.5f);
            Equal("greet look", string.Join(" ", own.GestureNames().Skip(names.Length + 1)));
            Equal(Status.Io, Throws<UmoException>(() => own.AddGestureFile("greet", "/no/such/file.glb")).Status);
            error = Throws<UmoException>(() => own.AddGestureFile("greet", file, "wave"));
            True(error.Status == Status.InvalidArgument && error.Message.Contains("salute"), error.Message);
            error = Throws<UmoException>(() => own.AddGestureFile("greet", new byte[0]));
            True(error.Message.Contains("not a glb file"), error.Message);
            Throws<ArgumentNullException>(() => own.AddGestureFile("greet", (byte[])null));
            using (Session session = new Session(own)) Equal(Status.Ok, session.PlayGesture("look"));
        }
    }

    [Test]
    private static void a_live_mouth_waits_for_no_computing()
    {
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        using (Model mouth = Model.Load(mouthPath))
        using (Engine polled = new Engine(mouth, config))
        {
            Equal(1u, mouth.Info.HasMouth);
            SessionConfig wanted = Session.Defaults(mouth);
            Equal(Voice.Delayed, wanted.Voice);
            wanted.Voice = (Voice)3;
            Equal(Status.InvalidArgument, Throws<UmoException>(() => new Session(polled, wanted)).Status);
            wanted.Voice = Voice.Live;
            using (Session session = new Session(polled, wanted))
            {
                Latency latency;
                int taken, ready;
                Equal(Status.Ok, session.GetLatency(out latency));
                True(latency.MouthSamples > 0 && latency.MouthSamples <= Rate / 10, latency.MouthSamples + " samples");
                True(latency.MouthSamples < latency.AlgorithmicSamples, "the mouth is ahead of the body");
                Equal(Status.Ok, session.PushAudio(speech, 0, Rate, out taken));
                Equal(Status.Ok, session.ReadyFrames(out ready));
                True(ready >= 27, ready + " frames of a second");
            }
        }
    }

    [Test]
    private static void a_polled_engine_computes_on_this_thread()
    {
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        config.Threads = 1;
        using (Engine polled = new Engine(model, config))
        using (Session session = new Session(polled))
        {
            int taken, ready;
            bool more = true;
            Equal(Status.Ok, session.PushAudio(speech, 0, 2 * Rate, out taken));
            Equal(Status.Ok, session.ReadyFrames(out ready));
            Equal(0, ready);
            while (more) Equal(Status.Ok, polled.Poll(1000, out more));
            Equal(Status.Ok, session.ReadyFrames(out ready));
            True(ready >= 12, ready + " frames of two seconds");
        }
    }

    [Test]
    private static void an_audio_thread_pushes_while_a_game_thread_samples()
    {
        using (Session session = NewSession())
        {
            Status pushed = Status.Ok;
            int sent = 0;
            Thread audio = new Thread(() =>
            {
                for (int at = 0; at < speech.Length && pushed == Status.Ok;)
                {
                    int taken;
                    pushed = session.PushAudio(speech, at, Math.Min(160, speech.Length - at), out taken);
                    at += taken;
                    Volatile.Write(ref sent, at);
                    if (at % 1600 == 0) Thread.Sleep(1);
                }
                if (pushed == Status.Ok) pushed = session.Finish();
            });
            audio.Start();
            Frames pose = new Frames(model, 1, Axes.Unity);
            float[] face = new float[pose.Channels], last = new float[pose.Channels];
            int moved = 0, steps = 0;
            ulong index = 0;
            Sampled sampled = default(Sampled);
            for (double time = 0; time < 7.6; steps++)
            {
                Equal(Status.Ok, session.SamplePose(time, pose, out sampled));
                True(pose.Index(0) >= index, "frames go on");
                index = pose.Index(0);
                pose.Face(0, face);
                if (!face.SequenceEqual(last)) moved++;
                Array.Copy(face, last, face.Length);
                if (sampled.IsAhead == 0) time += 1 / 60.0;
                else Thread.Sleep(1);
                True(steps < 100000, "no frames after " + time + " s of " + Volatile.Read(ref sent) + " samples");
            }
            audio.Join();
            Equal(Status.Ok, pushed);
            True(moved > 300, "the face moved " + moved + " times");
        }
    }

    [Test]
    private static void a_session_is_disposed_under_a_thread_that_pushes()
    {
        for (int round = 0; round < 100; round++)
        {
            Session session = NewSession();
            Status last = Status.Ok;
            bool started = false;
            Thread audio = new Thread(() =>
            {
                float[] block = new float[512];
                int taken;
                while (last == Status.Ok)
                {
                    last = session.PushAudio(block, 0, block.Length, out taken);
                    Volatile.Write(ref started, true);
                }
            });
            audio.Start();
            while (!Volatile.Read(ref started)) Thread.Yield();
            session.Dispose();
            audio.Join();
            Equal(Status.InvalidHandle, last);
        }
    }

    [Test]
    private static void a_thousand_sessions_are_made_and_disposed()
    {
        long before = 0;
        for (int i = 0; i < 1000; i++)
        {
            using (Session session = NewSession())
            {
                int taken;
                Equal(Status.Ok, session.PushAudio(speech, 0, 160, out taken));
            }
            if (i == 100) before = Resident();
        }
        // A session uses about 1 MiB: 900 leaked ones would show.
        long grown = Resident() - before;
        True(grown < 64 << 20, "memory grew by " + grown + " bytes");
    }

    /// Resident memory of the process in bytes.
    private static long Resident()
    {
        string line = File.ReadLines("/proc/self/status").First(l => l.StartsWith("VmRSS:"));
        return 1024 * long.Parse(line.Split(new[] { ' ', '\t' }, StringSplitOptions.RemoveEmptyEntries)[1]);
    }

    [Test]
    private static void what_is_forgotten_is_collected_and_freed()
    {
        EngineConfig config = Engine.Defaults;
        config.MaxSessions = 2;
        Engine small = new Engine(model, config);
        for (int i = 0; i < 100; i++)
        {
            Forget(small);
            for (int tries = 0; ; tries++)
            {
                GC.Collect();
                GC.WaitForPendingFinalizers();
                try
                {
                    new Session(small).Dispose();
                    break;
                }
                catch (UmoException full) when (full.Status == Status.Full && tries < 200)
                {
                    // The collector scans stacks conservatively: sleeping and retrying gives another stack.
                    Thread.Sleep(1);
                }
            }
        }
        small.Dispose();
    }

    [MethodImpl(MethodImplOptions.NoInlining)]
    private static void Forget(Engine small)
    {
        // In its own thread, whose stack disappears with it.
        Thread thread = new Thread(() =>
        {
            int taken;
            new Session(small).PushAudio(speech, 0, speech.Length, out taken);
        });
        thread.Start();
        thread.Join();
    }

    [Test]
    private static void a_session_keeps_its_engine()
    {
        Session session = MakeWithForgottenEngine();
        for (int i = 0; i < 5; i++)
        {
            GC.Collect();
            GC.WaitForPendingFinalizers();
        }
        int taken;
        Equal(Status.Ok, session.PushAudio(speech, 0, 160, out taken));
        session.Engine.Dispose();
        session.Dispose();
    }

    [MethodImpl(MethodImplOptions.NoInlining)]
    private static Session MakeWithForgottenEngine()
    {
        Session made = null;
        Thread thread = new Thread(() => made = new Session(new Engine(Model.Load(modelPath))));
        thread.Start();
        thread.Join();
        return made;
    }

    /// Bytes that this thread has allocated since it started; null if the runtime does not count them.
    private static Func<long> AllocatedBytes()
    {
        MethodInfo count = typeof(GC).GetMethod("GetAllocatedBytesForCurrentThread", BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.Static);
        return count == null ? null : (Func<long>)Delegate.CreateDelegate(typeof(Func<long>), count);
    }

    [Test]
    private static void pushing_and_pulling_allocates_nothing()
    {
        Frames frames = new Frames(model, 16, Axes.Unity), pose = new Frames(model, 1, Axes.Unity);
        float[] block = new float[160];
        using (Scene scene = new Scene())
        using (Session session = NewSession())
        {
            uint avatar, person, floor;
            Member info;
            Equal(Status.Ok, scene.Add(session, new Place(Axes.Unity, 0, 0, 0), out avatar));
            Equal(Status.Ok, scene.Add(null, new Place(Axes.Unity, 0, 0, 2), out person));
            Status worst = Status.Ok;
            object kept = null;
            Action<int> work = calls =>
            {
                for (int i = 0; i < calls; i++)
                {
                    int taken, count;
                    Sampled sampled;
                    Stats stats;
                    Latency latency;
                    double value;
                    Status a = session.PushAudio(block, 0, block.Length, out taken);
                    Status b = session.PushAudio(speech, i, 160, out taken);
                    Status c = i % 2 == 0 ? session.PullFrames(frames, out count) : session.SamplePose(i / 100.0, pose, out sampled);
                    Status d = session.Set(Parameter.GainFace, 1), e = session.Get(Parameter.GainFace, out value);
                    Status f = session.GetStats(out stats), g = session.GetLatency(out latency);
                    Status h = scene.SetPlace(avatar, new Place(Axes.Unity, 0, 0, i % 9)), j = scene.SetTarget(avatar, Axes.Unity, 0, 1, 2);
                    Status k = scene.PushAudio(person, block, 0, block.Length), l = scene.Update(0.01);
                    Status m = scene.Floor(out floor), n = scene.GetMember(avatar, out info);
                    worst = (Status)Math.Min((int)worst, Math.Min(Math.Min(Math.Min((int)h, (int)j), Math.Min((int)k, (int)l)), Math.Min((int)m, (int)n)));
                    // A failing call allocates no more than a successful one.
                    session.PushAudio(block, 100, 100, out taken);
                    session.Interrupt(99999);
                    worst = (Status)Math.Min((int)worst, Math.Min(Math.Min((int)a, (int)b), Math.Min((int)c, Math.Min(Math.Min((int)d, (int)e), Math.Min((int)f, (int)g)))));
                }
            };
            Action<int> allocating = calls => { for (int i = 0; i < calls; i++) kept = new byte[1]; };
            Func<long> allocated = AllocatedBytes();
            Func<Action<int>, long> bytes = action =>
            {
                action(100);
                if (allocated != null)
                {
                    long before = allocated();
                    action(10000);
                    return allocated() - before;
                }
                // Less exact fallback: as many rounds as it takes to fill the young generation many times.
                int collections = GC.CollectionCount(0);
                for (int i = 0; i < 100; i++) action(10000);
                return GC.CollectionCount(0) - collections;
            };
            True(bytes(allocating) > 0, "the counter counts nothing");
            Equal(0L, bytes(work), allocated == null ? "collections" : "bytes");
            Equal(Status.Ok, worst);
            GC.KeepAlive(kept);
        }
    }

    [Test]
    private static void a_state_gives_the_same_frames_again()
    {
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        config.Threads = 1;
        using (Engine polled = new Engine(model, config))
        using (Session first = new Session(polled))
        using (Session second = new Session(polled))
        {
            int taken, size, written;
            Equal(Status.Ok, first.PushAudio(speech, 0, 3 * Rate, out taken));
            Pull(polled, first, 30);
            Equal(Status.Ok, first.StateSize(out size));
            byte[] state = new byte[size];
            Equal(Status.InvalidArgument, first.Save(new byte[0], out written));
            Equal(Status.Ok, first.Save(state, out written));
            True(written > 0 && written <= size, written + " bytes of " + size);
            Equal(Status.Ok, first.PushAudio(speech, 3 * Rate, 2 * Rate, out taken));
            byte[] wanted = Pull(polled, first, 60);
            Equal(Status.Ok, second.Restore(state, written));
            Equal(Status.Ok, second.PushAudio(speech, 3 * Rate, 2 * Rate, out taken));
            True(Pull(polled, second, 60).SequenceEqual(wanted), "frames differ");
            state[written / 2] ^= 1;
            Equal(Status.State, second.Restore(state, written));
            Equal(Status.State, second.Restore(state, 0));
            Equal(Status.InvalidArgument, second.Restore(state, size + 1));
            Equal(Status.NullPointer, second.Restore(null, 0));
        }
    }

    /// Computes all due work, then pulls the given number of frames.
    private static byte[] Pull(Engine polled, Session session, int count)
    {
        Frames frames = new Frames(model, count, Axes.Gltf);
        bool more = true;
        while (more) Equal(Status.Ok, polled.Poll(100000, out more));
        int got;
        Equal(Status.Ok, session.PullFrames(frames, out got));
        Equal(count, got);
        return frames.Words.SelectMany(BitConverter.GetBytes).ToArray();
    }

    private static float[] voice, quiet;

    /// Two sessions that have heard three seconds: the recording, and silence.
    private static Session[] Voices(Engine polled)
    {
        voice = speech.Take(3 * Rate).Select(sample => sample / 32768f).ToArray();
        quiet = new float[voice.Length];
        return new[] { voice, quiet }.Select(samples =>
        {
            int taken;
            Session session = new Session(polled);
            Equal(Status.Ok, session.PushAudio(samples, 0, samples.Length, out taken));
            Equal(samples.Length, taken);
            Equal(Status.Ok, session.Finish());
            return session;
        }).ToArray();
    }

    private static Engine Polled()
    {
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        config.Threads = 1;
        return new Engine(model, config);
    }

    /// Turn of neck and head to the right in Unity's axes, radians.
    private static double Yaw(Frames frame)
    {
        float[] rotations = new float[4 * Native.JointCount];
        frame.Rotations(0, rotations);
        const int Neck = 12, Head = 15;
        return 2 * Math.Atan2(rotations[4 * Neck + 1], rotations[4 * Neck + 3]) + 2 * Math.Atan2(rotations[4 * Head + 1], rotations[4 * Head + 3]);
    }

    [Test]
    private static void who_speaks_has_the_floor_and_the_listener_turns_there()
    {
        Frames frame = new Frames(model, 1, Axes.Unity);
        double[] turns = new double[2];
        using (Engine polled = Polled())
        {
            for (int side = 0; side < 2; side++)
            {
                Session[] sessions = Voices(polled);
                bool more = true;
                while (more) Equal(Status.Ok, polled.Poll(100000, out more));
                Scene scene = new Scene(1);
                uint speaker, listener, floor = 0;
                Equal(Status.Ok, scene.Add(sessions[0], new Place(Axes.Unity, side == 0 ? 1 : -1, 0, 1, (float)Math.PI), out speaker));
                Equal(Status.Ok, scene.Add(sessions[1], new Place(Axes.Unity, 0, 0, 0), out listener));
                Equal(Status.Ok, scene.SetAllowed(listener, ScenePart.Look));
                for (int i = 0; i < 75; i++)
                {
                    Equal(Status.Ok, scene.Update(1 / 30.0));
                    foreach (Session session in sessions)
                    {
                        int count;
                        Equal(Status.Ok, session.PullFrames(frame, out count));
                        Equal(1, count);
                    }
                    if (i < 45) continue;
                    Equal(Status.Ok, scene.Floor(out floor));
                    Equal(speaker, floor, "floor");
                    turns[side] += Yaw(frame) / 30;
                }
                Member info;
                Equal(Status.Ok, scene.GetMember(listener, out info));
                Equal(Role.Listening, info.Role);
                // Freed in either order.
                if (side == 0) scene.Dispose();
                foreach (Session session in sessions) session.Dispose();
                if (side == 1) Equal(Status.Ok, scene.Update(0.1));
                scene.Dispose();
                Equal(Status.InvalidHandle, scene.Update(0.1));
            }
        }
        True(turns[0] - turns[1] > 0.2, "turned by " + turns[0] + " and " + turns[1]);
    }

    [Test]
    private static void a_scene_is_saved_and_takes_persons_targets_and_parts()
    {
        using (Engine polled = Polled())
        using (Scene scene = new Scene())
        {
            Session[] sessions = Voices(polled);
            uint[] members = new uint[3];
            for (int i = 0; i < 2; i++) Equal(Status.Ok, scene.Add(sessions[i], new Place(Axes.Unity, 2 * i, 0, 0), out members[i]));
            Equal(Status.Ok, scene.Add(null, new Place(Axes.Unreal, 0, 100, 0, 0, 170), out members[2]));
            Pull(polled, sessions[1], 30);
            Equal(Status.Ok, scene.Update(1));
            int size, written;
            Equal(Status.Ok, scene.StateSize(out size));
            byte[] state = new byte[size];
            Equal(Status.BufferTooSmall, scene.Save(new byte[10], out written));
            Equal(Status.Ok, scene.Save(state, out written));
            byte[] wanted = Pull(polled, sessions[1], 20);
            Equal(Status.Ok, scene.Restore(state, written));
            True(Pull(polled, sessions[1], 20).SequenceEqual(wanted), "frames differ");
            Equal(Status.State, scene.Restore(state, written - 1));
            True(scene.LastError().Length > 0, "the reason is missing");

            Equal(Status.Ok, scene.SetTarget(members[0], members[2]));
            Equal(Status.Ok, scene.SetTarget(members[0], Axes.Unity, 0, 1, 2));
            Equal(Status.Ok, scene.SetTarget(members[0], 0));
            Equal(Status.InvalidArgument, scene.SetTarget(members[0], members[0]));
            Equal(Status.InvalidArgument, scene.SetAllowed(members[0], (ScenePart)32));
            Equal(Status.Ok, scene.SetAllowed(members[0], Scene.AllParts));
            Equal(Status.Ok, scene.SetPlace(members[0], new Place(Axes.Unity, 0, 0, 1)));
            Equal(Status.InvalidArgument, scene.SetPlace(members[0], new Place(Axes.Unity, float.NaN, 0, 1)));
            Equal(Status.Ok, scene.PushAudio(members[2], voice, 0, voice.Length));
            Equal(Status.InvalidArgument, scene.PushAudio(members[0], voice, 0, voice.Length));
            Equal(Status.InvalidArgument, scene.PushAudio(members[2], voice, 1, voice.Length));
            Equal(Status.NullPointer, scene.PushAudio(members[2], null, 0, 0));
            Equal(Status.Ok, scene.Remove(members[1]));
            Equal(Status.InvalidArgument, scene.Remove(members[1]));
            foreach (Session session in sessions) session.Dispose();
        }
    }

    [Test]
    private static void a_take_is_recorded_and_played()
    {
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        config.Threads = 1;
        SessionConfig recording = Session.Defaults(model);
        recording.TakeBytes = 1 << 14;
        using (Engine polled = new Engine(model, config))
        using (Session session = new Session(polled, recording))
        using (Session plain = new Session(polled))
        {
            int taken;
            byte[] bytes, none;
            bool more = false;
            Equal(Status.Ok, session.PushAudio(speech, 0, 3 * Rate, out taken));
            byte[] wanted = Pull(polled, session, 60);
            Equal(Status.Ok, session.GetTake(out bytes));
            Equal(Status.InvalidArgument, plain.GetTake(out none));
            Equal(Status.InvalidArgument, plain.PushTake(out more));
            using (Take take = new Take(bytes))
            using (Session player = Session.Player(model, take))
            {
                TakeInfo info;
                Equal(Status.Ok, take.GetInfo(out info));
                Equal(60u, info.Frames);
                for (int i = 0; i < 20; i++) Equal(Status.Ok, player.PushTake(out more));
                True(Pull(polled, player, 60).SequenceEqual(wanted), "frames differ");
            }
            bytes[400] ^= 1;
            Throws<UmoException>(() => new Take(bytes));
            Throws<ArgumentNullException>(() => new Take(null));
        }
    }

    [Test]
    private static void a_decoder_has_the_frames_of_its_sender()
    {
        Parameter[] layers =
        {
            Parameter.LayerGaze, Parameter.LayerIdle, Parameter.LayerAsymmetry, Parameter.LayerNods, Parameter.LayerMood, Parameter.LayerFeet, Parameter.LayerBody,
        };
        EngineConfig config = Engine.Defaults;
        config.Mode = EngineMode.Polled;
        config.Threads = 1;
        SessionConfig sending = Session.Defaults(model);
        sending.Packets = Packets.BesideFrames;
        using (Engine polled = new Engine(model, config))
        using (Session sender = new Session(polled, sending))
        using (Session plain = new Session(polled))
        using (Session decoder = Session.Decoder(model))
        {
            foreach (Parameter layer in layers)
            {
                Equal(Status.Ok, sender.Set(layer, 0));
                Equal(Status.Ok, decoder.Set(layer, 0));
            }
            int taken, length;
            byte[] packet = new byte[sender.PacketSize];
            True(packet.Length > 100 && packet.Length < 1000, packet.Length + " bytes");
            Equal(Status.Ok, sender.PushAudio(speech, 0, 3 * Rate, out taken));
            byte[] wanted = Pull(polled, sender, 60);
            ulong packets = 0;
            while (sender.PullPacket(packet, out length) == Status.Ok && length > 0)
            {
                packets++;
                Equal(Status.Packet, decoder.PushPacket(packet, length - 1));
                True(decoder.LastError().Contains("not a packet"), decoder.LastError());
                Equal(Status.Ok, decoder.PushPacket(packet, length));
                Equal(Status.Ok, decoder.PushPacket(packet, length));
            }
            Equal(6ul, packets);
            True(Pull(polled, decoder, 60).SequenceEqual(wanted), "frames differ");
            Received stats;
            Equal(Status.Ok, decoder.GetReceived(out stats));
            Equal(packets, stats.Packets);
            Equal(packets, stats.Late);
            Equal(0ul, stats.Lost + stats.Held);
            // Calls that only the other kind of session accepts.
            Equal(Status.InvalidArgument, decoder.PushAudio(speech, 0, 10, out taken));
            Equal(Status.InvalidArgument, plain.PushPacket(packet, 0));
            Equal(Status.InvalidArgument, plain.PullPacket(packet, out length));
            Equal(Status.InvalidArgument, plain.GetReceived(out stats));
            Equal(Status.BufferTooSmall, sender.PullPacket(new byte[10], out length));
            Equal(Status.NullPointer, decoder.PushPacket(null, 0));
            Equal(Status.InvalidArgument, decoder.PushPacket(packet, packet.Length + 1));
            Equal(0, plain.PacketSize);
        }
    }

    /// The model's own skeleton with a wide trunk, in Unity's axes.
    private static RigAtRest Wide()
    {
        int[] parents;
        float[] offsets;
        model.Skeleton(Axes.Unity, out parents, out offsets);
        int count = parents.Length;
        RigAtRest rig = new RigAtRest { Parents = parents, Joints = Enumerable.Range(0, count).ToArray() };
        rig.Places = new float[3 * count];
        rig.Rotations = new float[4 * count];
        for (int joint = 0; joint < count; joint++)
        {
            rig.Rotations[4 * joint + 3] = 1;
            for (int i = 0; i < 3; i++)
            {
                rig.Places[3 * joint + i] = offsets[3 * joint + i] + (parents[joint] < 0 ? 0 : rig.Places[3 * parents[joint] + i]);
            }
        }
        List<float> points = new List<float>();
        List<int> bones = new List<int>();
        float low = rig.Places[4] - 0.05f, high = rig.Places[3 * 16 + 1];
        for (int ring = 0; ring <= 30; ring++)
        {
            for (int side = 0; side < 24; side++)
            {
                double turn = Math.PI * side / 12;
                points.AddRange(new[] { 0.3f * (float)Math.Sin(turn), low + (high - low) * ring / 30, 0.35f * (float)Math.Cos(turn) });
                bones.Add(ring < 6 ? 0 : ring < 15 ? 3 : 9);
            }
        }
        rig.Vertices = points.ToArray();
        rig.VertexBones = bones.ToArray();
        return rig;
    }

    [Test]
    private static void poses_are_put_on_other_characters()
    {
        RigAtRest rig = Wide();
        float[] pose = new float[4 * Native.JointCount], at = { 0.1f, 0.02f, -0.2f };
        float[] turned = new float[pose.Length], plain = new float[pose.Length], place = new float[3];
        for (int joint = 0; joint < Native.JointCount; joint++) pose[4 * joint + 3] = 1;
        // A left hand before the belly; rotations of Unity's left-handed axes.
        pose[4 * 16 + 2] = (float)Math.Sin(0.6);
        pose[4 * 16 + 3] = (float)Math.Cos(0.6);
        pose[4 * 18 + 1] = (float)Math.Sin(0.95);
        pose[4 * 18 + 3] = (float)Math.Cos(0.95);
        using (RigRetarget body = new RigRetarget(model, rig))
        {
            Equal("0 1 2", string.Join(" ", body.Joints.Take(3)));
            Equal(Status.Ok, body.Apply(pose, at, turned, place));
            Equal(Status.NullPointer, body.Apply(pose, null, turned, place));
            Equal(Status.InvalidArgument, body.Apply(pose, at, new float[4], place));
            Equal(Status.InvalidArgument, body.Apply(pose, at, turned, new float[2]));
            Func<long> allocated = AllocatedBytes();
            long before = allocated();
            Equal(Status.Ok, body.SetStep(1 / 60f));
            Equal(Status.InvalidArgument, body.SetStep(float.NaN));
            for (int i = 0; i < 100; i++) body.Apply(pose, at, turned, null);
            Equal(0L, allocated() - before, "bytes");
        }
        rig.Gain = 0;
        RigRetarget none = new RigRetarget(model, rig);
        Equal(Status.Ok, none.Apply(pose, at, plain, place));
        none.Dispose();
        Equal(Status.InvalidHandle, none.Apply(pose, at, plain, place));
        float[] apart = Enumerable.Range(0, Native.JointCount).Select(joint => Enumerable.Range(0, 4).Max(i => Math.Abs(turned[4 * joint + i] - plain[4 * joint + i]))).ToArray();
        True(apart[16] + apart[18] > 0.1f && apart[17] < 0.03f, "arms: " + apart[16] + " " + apart[18] + " " + apart[17]);
        True(Enumerable.Range(0, plain.Length).All(i => Math.Abs(plain[i] - pose[i]) < 2e-3f), "without volume the pose stays");
        True(new[] { 0, 2 }.All(i => Math.Abs(place[i] - rig.Places[i] - at[i]) < 1e-3f), "the hips' place");
        // By name.
        rig.Joints = null;
        Throws<ArgumentException>(() => new RigRetarget(model, rig));
        rig.Names = Enumerable.Range(0, Native.JointCount).Select(joint => Native.Text(Native.umo_joint_name((uint)joint))).ToArray();
        using (RigRetarget named = new RigRetarget(model, rig)) Equal(18, named.Joints[18]);
        rig.Names[18] = "tail";
        True(Throws<UmoException>(() => new RigRetarget(model, rig)).Message.Contains("left_elbow"), "the missing bone is named");
        rig = Wide();
        rig.VertexBones[5] = 99;
        True(Throws<UmoException>(() => new RigRetarget(model, rig)).Message.Contains("99"), "the wrong bone is named");
        rig.VertexBones = null;
        Throws<ArgumentException>(() => new RigRetarget(model, rig));
    }

    [Test]
    private static void messages_come_in_and_exceptions_do_not_go_out()
    {
        List<string> said = new List<string>();
        LogSink sink = new LogSink((level, message) =>
        {
            said.Add(level + " " + message);
            throw new Exception("in a callback");
        });
        EngineConfig config = Engine.Defaults;
        config.Log = sink.Pointer;
        new Engine(model, config).Dispose();
        True(said.Count >= 2 && said.All(line => line.StartsWith("Info ")), string.Join("; ", said));
        Throws<UmoException>(() => new Session(new Engine(model, config), null, "no_such_template"));
        True(said.Last().StartsWith("Error "), said.Last());
    }

    [Test]
    private static void parameters_have_names_and_ranges()
    {
        List<string> names = new List<string>();
        ParameterInfo info = default(ParameterInfo);
        info.StructSize = (uint)sizeof(ParameterInfo);
        for (uint i = 0; Native.umo_parameter_get_info(i, &info) == Status.Ok; i++)
        {
            names.Add(Native.Text(info.Name));
            True(info.Minimum < info.Maximum && Enum.IsDefined(typeof(Parameter), info.Id), names.Last());
        }
        Equal(Enum.GetValues(typeof(Parameter)).Length, names.Count);
    }
}
