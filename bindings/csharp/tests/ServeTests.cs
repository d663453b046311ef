// SPDX-License-Identifier: MIT OR Apache-2.0
// ServeTests URL WAV FRAMES OPUS: tests the client of `umo serve` against a server. FRAMES was written by
// `umo animate --horizon 0 -o FRAMES.jsonl`.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Text.RegularExpressions;
using System.Threading;
using System.Threading.Tasks;
using Umo.Serve;

internal static class ServeTests
{
    private static Uri address;
    private static short[] speech;
    private static string opus;
    private static float[][] wanted;
    private static readonly CancellationToken Soon = new CancellationTokenSource(120000).Token;

    private static int Main(string[] args)
    {
        address = new Uri(args[0]);
        byte[] wav = File.ReadAllBytes(args[1]);
        speech = new short[(wav.Length - 44) / 2];
        Buffer.BlockCopy(wav, 44, speech, 0, 2 * speech.Length);
        opus = args[3];
        wanted = File.ReadLines(args[2]).Skip(1).Select(Numbers).ToArray();
        var tests = new Dictionary<string, Func<Task>>
        {
            { "frames equal those of umo animate", FramesAreThoseOfAnimate },
            { "a restored session continues from its state", AStateGoesOn },
            { "an interrupt starts a new speech", AnotherSpeechFollows },
            { "packets replace frames", PacketsCome },
            { "Opus packets animate, and lost ones keep their duration", PacketsOfOpusAnimate },
            { "errors say what is wrong", WhatIsWrongIsSaid },
        };
        int failed = 0;
        foreach (KeyValuePair<string, Func<Task>> test in tests)
        {
            try
            {
                test.Value().GetAwaiter().GetResult();
                Console.WriteLine("ok      " + test.Key);
            }
            catch (Exception error)
            {
                failed++;
                Console.WriteLine("FAILED  " + test.Key + ": " + error);
            }
        }
        return failed == 0 ? 0 : 1;
    }

    // Translation, rotations and face of a line; its first two numbers are the frame index and the time.
    private static float[] Numbers(string line)
    {
        MatchCollection found = Regex.Matches(line, @"-?\d+\.?\d*(e-?\d+)?(?=[,\]}])");
        return found.Cast<Match>().Skip(2).Select(each => float.Parse(each.Value, CultureInfo.InvariantCulture)).ToArray();
    }

    private static async Task FramesAreThoseOfAnimate()
    {
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, new Hello { Rate = 16000 }, null, Soon))
        {
            Check(avatar.Ready.Joints == 55 && avatar.Ready.Face.Length == 52 && avatar.Ready.FrameRate == 30, "ready");
            for (int at = 0; at < speech.Length; at += 20001)
                await avatar.PushAsync(speech, at, Math.Min(20001, speech.Length - at), Soon);
            await avatar.FinishAsync(Soon);
            Tuple<List<RemoteFrame>, Reply> all = await Speech(avatar);
            List<RemoteFrame> frames = all.Item1;
            Reply done = all.Item2;
            Same(frames, 0);
            Check(frames.Count == wanted.Length && done.Frames == frames.Count, frames.Count + " frames");
        }
    }

    private static async Task AStateGoesOn()
    {
        Hello hello = new Hello { Rate = 16000 };
        List<RemoteFrame> before = new List<RemoteFrame>();
        Received saved = null;
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, hello, null, Soon))
        {
            await avatar.PushAsync(speech, 0, speech.Length / 2, Soon);
            await avatar.SaveAsync(Soon);
            while (saved == null)
            {
                Received received = await avatar.ReceiveAsync(Soon);
                before.AddRange(received.Frames ?? new RemoteFrame[0]);
                saved = received.State != null ? received : null;
            }
        }
        Check(!saved.Reply.IsHandover && saved.Reply.Samples <= speech.Length / 2, "state");
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, hello, saved.State, Soon))
        {
            int from = (int)saved.Reply.Samples;
            await avatar.PushAsync(speech, from, speech.Length - from, Soon);
            await avatar.FinishAsync(Soon);
            List<RemoteFrame> after = (await Speech(avatar)).Item1;
            Same(before, 0);
            Same(after, (int)after[0].Index);
            Check(after[0].Index <= before.Count && after.Last().Index == wanted.Length - 1, "a gap");
        }
    }

    private static async Task AnotherSpeechFollows()
    {
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, new Hello { Rate = 16000, Mood = "joy", MoodStrength = 0.5 }, null, Soon))
        {
            await avatar.PushAsync(speech, 0, 32000, Soon);
            await avatar.FinishAsync(Soon);
            int first = (await Speech(avatar)).Item1.Count;
            await avatar.InterruptAsync(0.2, Soon);
            await avatar.SetMoodAsync("sad", 1, Soon);
            await avatar.PlayGestureAsync("wave", null, Soon);
            await avatar.HintWordsAsync("hello", 2.1, 2.4, Soon);
            await avatar.LookAtAsync(0.5f, 1.6f, 2, 1, Soon);
            await avatar.PushAsync(speech, 0, 16000, Soon);
            await avatar.FinishAsync(Soon);
            List<RemoteFrame> frames = (await Speech(avatar)).Item1;
            Check(first == 60 && frames.Count == 36 && frames[0].Index == 60, first + " and " + frames.Count + " frames");
        }
    }

    private static async Task PacketsOfOpusAnimate()
    {
        // Packets of 20 ms, 0.6 s of speech, each preceded by its length.
        byte[] data = File.ReadAllBytes(opus);
        Hello hello = new Hello { Audio = "opus" };
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, hello, null, Soon))
        {
            Check(avatar.Ready.Audio == "opus", "ready says " + avatar.Ready.Audio);
            int count = 0;
            for (int at = 0; at < data.Length && count < 28; count++)
            {
                byte[] packet = new byte[BitConverter.ToUInt16(data, at)];
                Buffer.BlockCopy(data, at + 2, packet, 0, packet.Length);
                at += 2 + packet.Length;
                await avatar.PushOpusAsync(packet, Soon);
            }
            await avatar.LostAsync(2, Soon);
            await avatar.FinishAsync(Soon);
            int frames = (await Speech(avatar)).Item1.Count;
            Check(frames == 18, frames + " frames");
        }
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, hello, null, Soon))
        {
            await avatar.PushOpusAsync(new byte[] { 0x4b, 0 }, Soon);
            try
            {
                await avatar.ReceiveAsync(Soon);
                Check(false, "no error");
            }
            catch (ServeException error)
            {
                Check(error.Code == "bad_request" && error.Message.Contains("not an Opus packet"), error.Message);
            }
        }
    }

    private static async Task PacketsCome()
    {
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, new Hello { Rate = 16000, Output = "packets" }, null, Soon))
        {
            await avatar.PushAsync(speech, 0, speech.Length, Soon);
            await avatar.FinishAsync(Soon);
            int packets = 0;
            while (true)
            {
                Received received = await avatar.ReceiveAsync(Soon);
                if (received.IsDone)
                    break;
                Check(received.Packet != null && received.Packet.Length < 500, "a packet");
                packets++;
            }
            Check(packets > 10, packets + " packets");
        }
    }

    private static async Task WhatIsWrongIsSaid()
    {
        Check((await Refused(new Hello { Rate = 1 })).Message.Contains("rate 1"), "the rate");
        Check((await Refused(new Hello { Mood = "happy" })).Message.Contains("joy"), "the mood");
        using (RemoteAvatar avatar = await RemoteAvatar.ConnectAsync(address, new Hello(), null, Soon))
        {
            await avatar.PlayGestureAsync("somersault", null, Soon);
            try
            {
                while (true)
                    await avatar.ReceiveAsync(Soon);
            }
            catch (ServeException error)
            {
                Check(error.Code == "bad_request" && error.Message.Contains("unknown gesture"), error.Code + ": " + error.Message);
            }
        }
        try
        {
            await RemoteAvatar.ConnectAsync(new Uri("ws://127.0.0.1:9/v1/session"), new Hello(), null, Soon);
            throw new Exception("connected to a server that does not exist");
        }
        catch (ServeException error)
        {
            Check(error.Code == "closed" && error.Message.Contains("127.0.0.1:9"), error.Message);
        }
    }

    private static async Task<ServeException> Refused(Hello hello)
    {
        try
        {
            (await RemoteAvatar.ConnectAsync(address, hello, null, Soon)).Dispose();
        }
        catch (ServeException error)
        {
            Check(error.Code == "bad_request", error.Code);
            return error;
        }
        throw new Exception("it was not refused");
    }

    private static async Task<Tuple<List<RemoteFrame>, Reply>> Speech(RemoteAvatar avatar)
    {
        List<RemoteFrame> frames = new List<RemoteFrame>();
        while (true)
        {
            Received received = await avatar.ReceiveAsync(Soon);
            if (received.IsDone)
                return Tuple.Create(frames, received.Reply);
            frames.AddRange(received.Frames);
        }
    }

    private static void Same(List<RemoteFrame> frames, int first)
    {
        for (int i = 0; i < frames.Count; i++)
        {
            float[] values = frames[i].Translation.Concat(frames[i].Rotations).Concat(frames[i].Face).ToArray();
            Check(frames[i].Index == first + i, "index " + frames[i].Index);
            Check(values.SequenceEqual(wanted[first + i]), "frame " + (first + i) + " is another");
        }
    }

    private static void Check(bool holds, string what)
    {
        if (!holds)
            throw new Exception("not so: " + what);
    }
}
