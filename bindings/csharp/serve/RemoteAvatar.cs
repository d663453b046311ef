// SPDX-License-Identifier: MIT OR Apache-2.0
// A client of `umo serve`: sends speech to a server and receives frames or packets. Does not need libumo.

using System;
using System.IO;
using System.Net.WebSockets;
using System.Runtime.Serialization;
using System.Runtime.Serialization.Json;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Umo.Serve
{
    /// <summary>The server refused a session or ended it.</summary>
    public sealed class ServeException : Exception
    {
        /// <summary>Error code: "full", "unauthorized", "bad_request" …; "closed" if the connection broke.</summary>
        public string Code { get; }

        public ServeException(string code, string reason, Exception cause = null) : base(reason, cause)
        {
            Code = code;
        }
    }

    /// <summary>Settings that a client requests. Null selects the server's default.</summary>
    [DataContract]
    public sealed class Hello
    {
        [DataMember(Name = "type")] internal string Type = "hello";
        [DataMember(Name = "restore", EmitDefaultValue = false)] internal long? Restore;

        /// <summary>Required if the server uses tokens.</summary>
        [DataMember(Name = "token", EmitDefaultValue = false)] public string Token { get; set; }
        /// <summary>"pcm" or "opus".</summary>
        [DataMember(Name = "audio", EmitDefaultValue = false)] public string Audio { get; set; }
        /// <summary>Samples a second, 8000 to 192000; with Opus 8000, 12000, 16000, 24000 or 48000.</summary>
        [DataMember(Name = "rate", EmitDefaultValue = false)] public int? Rate { get; set; }
        /// <summary>"frames" or "packets".</summary>
        [DataMember(Name = "output", EmitDefaultValue = false)] public string Output { get; set; }
        /// <summary>"delayed" or "live".</summary>
        [DataMember(Name = "voice", EmitDefaultValue = false)] public string Voice { get; set; }
        /// <summary>Random seed: another seed gives another take.</summary>
        [DataMember(Name = "seed", EmitDefaultValue = false)] public long? Seed { get; set; }
        /// <summary>Free text, for models that take one.</summary>
        [DataMember(Name = "prompt", EmitDefaultValue = false)] public string Prompt { get; set; }
        /// <summary>Language of the words: "en" or "de".</summary>
        [DataMember(Name = "language", EmitDefaultValue = false)] public string Language { get; set; }
        /// <summary>"joy", "sad", "angry", "surprised", "disgusted", "afraid" or "neutral".</summary>
        [DataMember(Name = "mood", EmitDefaultValue = false)] public string Mood { get; set; }
        /// <summary>0 to 1.</summary>
        [DataMember(Name = "mood_strength", EmitDefaultValue = false)] public double? MoodStrength { get; set; }
        /// <summary>Keyframes in a chunk.</summary>
        [DataMember(Name = "target", EmitDefaultValue = false)] public int? Target { get; set; }
        /// <summary>Keyframes of audio to wait for beyond the end of a chunk.</summary>
        [DataMember(Name = "horizon", EmitDefaultValue = false)] public int? Horizon { get; set; }
        /// <summary>Strength of the layers, 0 to 1.</summary>
        [DataMember(Name = "layers", EmitDefaultValue = false)] public double? Layers { get; set; }
        /// <summary>Name of the room that the session joins.</summary>
        [DataMember(Name = "room", EmitDefaultValue = false)] public string Room { get; set; }
        /// <summary>Place in the room: x and z in metres, and degrees to the left of +Z.</summary>
        [DataMember(Name = "place", EmitDefaultValue = false)] public double[] Place { get; set; }
        /// <summary>Whether the client accepts the session's state when the server stops.</summary>
        [DataMember(Name = "handover", EmitDefaultValue = false)] public bool? Handover { get; set; }
        /// <summary>Number of samples at the start that a restored session already has.</summary>
        [DataMember(Name = "skip", EmitDefaultValue = false)] public long? Skip { get; set; }
    }

    /// <summary>A text message from the server. The fields present depend on its type.</summary>
    [DataContract]
    public sealed class Reply
    {
        /// <summary>"ready", "done", "state" or "error".</summary>
        [DataMember(Name = "type")] public string Type { get; private set; }
        [DataMember(Name = "version")] public int Version { get; private set; }
        [DataMember(Name = "model")] public string Model { get; private set; }
        [DataMember(Name = "rate")] public int Rate { get; private set; }
        [DataMember(Name = "audio")] public string Audio { get; private set; }
        [DataMember(Name = "output")] public string Output { get; private set; }
        [DataMember(Name = "frame_rate")] public int FrameRate { get; private set; }
        [DataMember(Name = "joints")] public int Joints { get; private set; }
        /// <summary>Names of the face channels.</summary>
        [DataMember(Name = "face")] public string[] Face { get; private set; }
        /// <summary>Number of floats in a frame.</summary>
        [DataMember(Name = "floats")] public int Floats { get; private set; }
        [DataMember(Name = "chunk_frames")] public int ChunkFrames { get; private set; }
        [DataMember(Name = "latency_samples")] public long LatencySamples { get; private set; }
        [DataMember(Name = "mouth_samples")] public long MouthSamples { get; private set; }
        [DataMember(Name = "state_bytes")] public long StateBytes { get; private set; }
        /// <summary>In "done": frames since the start of the session.</summary>
        [DataMember(Name = "frames")] public long Frames { get; private set; }
        [DataMember(Name = "late_frames")] public long LateFrames { get; private set; }
        /// <summary>
        /// In "state": samples of this connection that the state includes. Push the samples after them to the restored
        /// session.
        /// </summary>
        [DataMember(Name = "samples")] public long Samples { get; private set; }
        [DataMember(Name = "bytes")] internal long Bytes { get; private set; }
        /// <summary>In "state": whether the server is ending the session.</summary>
        [DataMember(Name = "is_handover")] public bool IsHandover { get; private set; }
        [DataMember(Name = "code")] public string Code { get; private set; }
        [DataMember(Name = "reason")] public string Reason { get; private set; }
    }

    /// <summary>One pose.</summary>
    public struct RemoteFrame
    {
        /// <summary>Index of the frame since the start of the session.</summary>
        public long Index;
        /// <summary>Sample of the speech that the frame belongs to.</summary>
        public long Sample;
        /// <summary>[joints * 4]: rotation of each joint in its parent's frame, x, y, z, w.</summary>
        public float[] Rotations;
        /// <summary>[3]: position of the root, metres.</summary>
        public float[] Translation;
        /// <summary>[channels]: face channels.</summary>
        public float[] Face;
    }

    /// <summary>One received message: exactly one kind is set.</summary>
    public sealed class Received
    {
        /// <summary>Frames in order.</summary>
        public RemoteFrame[] Frames { get; internal set; }
        /// <summary>A packet for a decoder.</summary>
        public byte[] Packet { get; internal set; }
        /// <summary>
        /// State of the session, for <see cref="RemoteAvatar.ConnectAsync"/>; Reply gives the sample that it was saved
        /// at.
        /// </summary>
        public byte[] State { get; internal set; }
        /// <summary>Set with a state, or alone for "done": all frames of the speech were received.</summary>
        public Reply Reply { get; internal set; }
        /// <summary>Whether all frames of the speech were received.</summary>
        public bool IsDone { get { return Reply != null && Reply.Type == "done"; } }
    }

    /// <summary>A session on a server. One task may send while another receives.</summary>
    public sealed class RemoteAvatar : IDisposable
    {
        // Maximum size in bytes of a message with audio or a state.
        private const int Piece = 32768;

        private readonly ClientWebSocket socket;
        private readonly SemaphoreSlim sending = new SemaphoreSlim(1, 1);
        private readonly byte[] room = new byte[Piece];
        private Reply waiting;
        private readonly MemoryStream state = new MemoryStream();

        /// <summary>The server's description of the session.</summary>
        public Reply Ready { get; private set; }

        private RemoteAvatar(ClientWebSocket socket)
        {
            this.socket = socket;
        }

        /// <summary>Opens a session at "ws://HOST:PORT/v1/session". A given state is restored; the hello must be that of the saved session.</summary>
        public static async Task<RemoteAvatar> ConnectAsync(
            Uri address, Hello hello, byte[] state = null, CancellationToken cancel = default(CancellationToken))
        {
            RemoteAvatar avatar = new RemoteAvatar(new ClientWebSocket());
            try
            {
                try
                {
                    await avatar.socket.ConnectAsync(address, cancel).ConfigureAwait(false);
                }
                catch (WebSocketException error)
                {
                    throw new ServeException("closed", "no connection to " + address + ": " + error.Message, error);
                }
                hello.Restore = state == null ? (long?)null : state.Length;
                await avatar.SayAsync(hello, cancel).ConfigureAwait(false);
                if (state != null)
                    await avatar.SendAsync(state, cancel).ConfigureAwait(false);
                WebSocketMessageType kind;
                byte[] data;
                (kind, data) = await avatar.MessageAsync(cancel).ConfigureAwait(false);
                Reply reply = kind == WebSocketMessageType.Text ? Read(data) : null;
                if (reply == null || reply.Type != "ready")
                    throw Refused(reply);
                avatar.Ready = reply;
                return avatar;
            }
            catch
            {
                avatar.Dispose();
                throw;
            }
        }

        /// <summary>Sends mono samples.</summary>
        public Task PushAsync(short[] samples, int start, int count, CancellationToken cancel = default(CancellationToken))
        {
            if (start < 0 || count < 0 || count > samples.Length - start)
                throw new ArgumentOutOfRangeException(nameof(count), "outside the array of samples");
            byte[] data = new byte[2 * count];
            for (int i = 0; i < count; i++)
            {
                data[2 * i] = (byte)samples[start + i];
                data[2 * i + 1] = (byte)(samples[start + i] >> 8);
            }
            return SendAsync(data, cancel);
        }

        /// <summary>Sends one Opus packet, as carried by RTP. The hello must say "opus".</summary>
        public Task PushOpusAsync(byte[] packet, CancellationToken cancel = default(CancellationToken))
        {
            if (packet == null || packet.Length == 0 || packet.Length > Piece)
                throw new ArgumentException("an Opus packet has 1 to " + Piece + " bytes", nameof(packet));
            return SendAsync(packet, cancel);
        }

        /// <summary>Reports that packets before the next one were lost: the server conceals them.</summary>
        public Task LostAsync(int packets = 1, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "lost", Packets = packets }, cancel);
        }

        /// <summary>Ends the speech: its last frames arrive, then "done".</summary>
        public Task FinishAsync(CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "finish" }, cancel);
        }

        /// <summary>
        /// Drops unsent frames and eases to rest over the given number of seconds. Audio pushed afterwards starts a new
        /// speech.
        /// </summary>
        public Task InterruptAsync(double ease = 0.2, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "interrupt", Ease = ease }, cancel);
        }

        /// <summary>Sets the mood.</summary>
        public Task SetMoodAsync(string mood, double strength = 1, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "mood", Mood = mood, Strength = strength }, cancel);
        }

        /// <summary>Plays a gesture on top of the motion, at a time of the motion or as soon as possible.</summary>
        public Task PlayGestureAsync(string name, double? at = null, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "gesture", Name = name, At = at }, cancel);
        }

        /// <summary>
        /// Gives a word and its time, in seconds of the audio sent since the session began: some become gestures.
        /// </summary>
        public Task HintWordsAsync(string text, double start, double end, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "words", Text = text, Start = start, End = end }, cancel);
        }

        /// <summary>Moves in the room: x and z in metres, and degrees to the left of +Z.</summary>
        public Task SetPlaceAsync(double x, double z, double degrees, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "place", Place = new[] { x, z, degrees } }, cancel);
        }

        /// <summary>Turns eyes, head and trunk to a point, in metres.</summary>
        public Task LookAtAsync(float x, float y, float z, double strength = 1, CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "look_at", Point = new[] { x, y, z }, Strength = strength }, cancel);
        }

        /// <summary>Requests the session's state, which arrives through ReceiveAsync.</summary>
        public Task SaveAsync(CancellationToken cancel = default(CancellationToken))
        {
            return SayAsync(new Request { Type = "save" }, cancel);
        }

        /// <summary>Receives the next message. Throws <see cref="ServeException"/> if the server ends the session.</summary>
        public async Task<Received> ReceiveAsync(CancellationToken cancel = default(CancellationToken))
        {
            while (true)
            {
                WebSocketMessageType kind;
                byte[] data;
                (kind, data) = await MessageAsync(cancel).ConfigureAwait(false);
                if (kind == WebSocketMessageType.Text)
                {
                    Reply reply = Read(data);
                    if (reply.Type == "error")
                        throw Refused(reply);
                    if (reply.Type == "done")
                        return new Received { Reply = reply };
                    if (reply.Type == "state")
                        waiting = reply;
                }
                else if (data.Length > 0 && data[0] == 1)
                {
                    return new Received { Frames = Frames(data) };
                }
                else if (data.Length > 0 && data[0] == 2)
                {
                    return new Received { Packet = Rest(data) };
                }
                else if (data.Length > 0 && data[0] == 3)
                {
                    state.Write(data, 1, data.Length - 1);
                    if (waiting == null || state.Length < waiting.Bytes)
                        continue;
                    Received whole = new Received { State = state.ToArray(), Reply = waiting };
                    state.SetLength(0);
                    return whole;
                }
            }
        }

        /// <summary>Ends the session.</summary>
        public void Dispose()
        {
            socket.Dispose();
        }

        private RemoteFrame[] Frames(byte[] data)
        {
            int count = BitConverter.ToUInt16(data, 2), floats = (int)BitConverter.ToUInt32(data, 4), bones = 4 * Ready.Joints;
            RemoteFrame[] frames = new RemoteFrame[count];
            for (int i = 0, at = 8; i < count; i++, at += 16 + 4 * floats)
            {
                frames[i] = new RemoteFrame
                {
                    Index = BitConverter.ToInt64(data, at),
                    Sample = BitConverter.ToInt64(data, at + 8),
                    Rotations = Floats(data, at + 16, bones),
                    Translation = Floats(data, at + 16 + 4 * bones, 3),
                    Face = Floats(data, at + 16 + 4 * (bones + 3), floats - bones - 3),
                };
            }
            return frames;
        }

        // Little-endian, like every machine that .NET runs on.
        private static float[] Floats(byte[] data, int at, int count)
        {
            float[] values = new float[count];
            Buffer.BlockCopy(data, at, values, 0, 4 * count);
            return values;
        }

        private static byte[] Rest(byte[] data)
        {
            byte[] rest = new byte[data.Length - 1];
            Buffer.BlockCopy(data, 1, rest, 0, rest.Length);
            return rest;
        }

        private static ServeException Refused(Reply reply)
        {
            return reply == null || reply.Code == null
                ? new ServeException("closed", "the server speaks another protocol")
                : new ServeException(reply.Code, reply.Reason);
        }

        private async Task<(WebSocketMessageType, byte[])> MessageAsync(CancellationToken cancel)
        {
            using (MemoryStream message = new MemoryStream())
            {
                while (true)
                {
                    WebSocketReceiveResult part;
                    try
                    {
                        part = await socket.ReceiveAsync(new ArraySegment<byte>(room), cancel).ConfigureAwait(false);
                    }
                    catch (WebSocketException error)
                    {
                        throw new ServeException("closed", "the connection broke: " + error.Message, error);
                    }
                    if (part.MessageType == WebSocketMessageType.Close)
                        throw new ServeException("closed", "the connection ended: " + part.CloseStatusDescription);
                    message.Write(room, 0, part.Count);
                    if (part.EndOfMessage)
                        return (part.MessageType, message.ToArray());
                }
            }
        }

        private async Task SendAsync(byte[] data, CancellationToken cancel)
        {
            await sending.WaitAsync(cancel).ConfigureAwait(false);
            try
            {
                for (int at = 0; at < data.Length; at += Piece)
                {
                    ArraySegment<byte> part = new ArraySegment<byte>(data, at, Math.Min(Piece, data.Length - at));
                    await socket.SendAsync(part, WebSocketMessageType.Binary, true, cancel).ConfigureAwait(false);
                }
            }
            finally
            {
                sending.Release();
            }
        }

        private async Task SayAsync<T>(T message, CancellationToken cancel)
        {
            byte[] text;
            using (MemoryStream stream = new MemoryStream())
            {
                new DataContractJsonSerializer(typeof(T)).WriteObject(stream, message);
                text = stream.ToArray();
            }
            await sending.WaitAsync(cancel).ConfigureAwait(false);
            try
            {
                await socket.SendAsync(new ArraySegment<byte>(text), WebSocketMessageType.Text, true, cancel).ConfigureAwait(false);
            }
            finally
            {
                sending.Release();
            }
        }

        private static Reply Read(byte[] text)
        {
            try
            {
                using (MemoryStream stream = new MemoryStream(text))
                    return (Reply)new DataContractJsonSerializer(typeof(Reply)).ReadObject(stream);
            }
            catch (SerializationException error)
            {
                throw new ServeException("closed", "not a message of umo serve: " + Encoding.UTF8.GetString(text), error);
            }
        }

        [DataContract]
        private sealed class Request
        {
            [DataMember(Name = "type")] internal string Type;
            [DataMember(Name = "packets", EmitDefaultValue = false)] internal int? Packets;
            [DataMember(Name = "ease", EmitDefaultValue = false)] internal double? Ease;
            [DataMember(Name = "mood", EmitDefaultValue = false)] internal string Mood;
            [DataMember(Name = "place", EmitDefaultValue = false)] internal double[] Place;
            [DataMember(Name = "name", EmitDefaultValue = false)] internal string Name;
            [DataMember(Name = "at", EmitDefaultValue = false)] internal double? At;
            [DataMember(Name = "text", EmitDefaultValue = false)] internal string Text;
            [DataMember(Name = "start", EmitDefaultValue = false)] internal double? Start;
            [DataMember(Name = "end", EmitDefaultValue = false)] internal double? End;
            [DataMember(Name = "point", EmitDefaultValue = false)] internal float[] Point;
            [DataMember(Name = "strength", EmitDefaultValue = false)] internal double? Strength;
        }
    }
}
