// SPDX-License-Identifier: MIT OR Apache-2.0
// Speak MODEL WAV: feeds a 16-bit recording to an avatar as a game would, in real time: one thread pushes the samples
// that a sound card would play, the other asks 60 times a second for the pose at that moment. Prints the position of
// the jaw.

using System;
using System.Diagnostics;
using System.IO;
using System.Threading;
using Umo;

internal static class Speak
{
    private static int Main(string[] args)
    {
        if (args.Length != 2)
        {
            Console.Error.WriteLine("usage: Speak MODEL WAV");
            return 2;
        }
        int rate, channels;
        short[] samples = ReadWav(args[1], out rate, out channels);

        using (Model model = Model.Load(args[0]))
        using (Engine engine = new Engine(model))
        {
            Console.Error.WriteLine("umo {0}, model {1}. {2}", Native.Text(Native.umo_version()), model.Name, model.Notice);
            SessionConfig config = Session.Defaults(model);
            config.SampleRate = (uint)rate;
            config.Channels = (uint)channels;
            using (Session session = new Session(engine, config))
            {
                Latency latency;
                session.GetLatency(out latency);
                // A player delays the sound by this much, plus some time for the processor.
                double delay = latency.AlgorithmicSamples / (double)rate + 0.1;
                Console.Error.WriteLine("motion lags speech by {0:0.000} s", delay);

                Stopwatch clock = Stopwatch.StartNew();
                Thread audio = new Thread(() => Push(session, samples, rate, channels, clock));
                audio.Start();

                Frames pose = new Frames(model, 1, Axes.Unity);
                float[] face = new float[pose.Channels];
                int jaw = Array.IndexOf(model.ChannelNames(), "jawOpen");
                double seconds = samples.Length / channels / (double)rate;
                double shown = 0;
                for (double time = 0; time < seconds; time = clock.Elapsed.TotalSeconds - delay)
                {
                    Sampled sampled;
                    Status status = session.SamplePose(Math.Max(time, 0), pose, out sampled);
                    if (status != Status.Ok)
                    {
                        Console.Error.WriteLine(UmoException.Describe(status) + ": " + session.LastError());
                        return 1;
                    }
                    pose.Face(0, face);
                    if (time >= shown && jaw >= 0)
                    {
                        Console.WriteLine("{0,6:0.00} s  {1}", time, new string('#', (int)(40 * face[jaw])));
                        shown += 0.1;
                    }
                    Thread.Sleep(16);
                }
                audio.Join();
                Stats stats;
                session.GetStats(out stats);
                Console.Error.WriteLine("{0} frames, {1} late", stats.Frames, stats.LateFrames);
            }
        }
        return 0;
    }

    private static void Push(Session session, short[] samples, int rate, int channels, Stopwatch clock)
    {
        int done = 0;
        while (done < samples.Length)
        {
            int due = Math.Min(samples.Length, (int)(clock.Elapsed.TotalSeconds * rate) * channels), taken;
            Status status = session.PushAudio(samples, done, due - done, out taken);
            if (status != Status.Ok)
            {
                Console.Error.WriteLine(UmoException.Describe(status));
                return;
            }
            done += taken;
            Thread.Sleep(10);
        }
        session.Finish();
    }

    private static short[] ReadWav(string path, out int rate, out int channels)
    {
        rate = channels = 0;
        using (BinaryReader file = new BinaryReader(File.OpenRead(path)))
        {
            file.ReadBytes(12);
            while (true)
            {
                string chunk = new string(file.ReadChars(4));
                int size = file.ReadInt32();
                if (chunk == "fmt ")
                {
                    file.ReadInt16();
                    channels = file.ReadInt16();
                    rate = file.ReadInt32();
                    file.ReadBytes(6);
                    if (file.ReadInt16() != 16) throw new InvalidDataException("this example reads only 16-bit recordings");
                    file.ReadBytes(size - 16);
                }
                else if (chunk == "data")
                {
                    byte[] bytes = file.ReadBytes(size);
                    short[] samples = new short[bytes.Length / 2];
                    Buffer.BlockCopy(bytes, 0, samples, 0, 2 * samples.Length);
                    return samples;
                }
                else
                {
                    file.ReadBytes(size);
                }
            }
        }
    }
}
