// SPDX-License-Identifier: MIT OR Apache-2.0
// No type of the engine: this half is tested without it.

using System;
using System.Threading;

namespace Umo.Unity
{
    /// <summary>
    /// The audio thread's side: sound goes to the session, and comes out as much later as its motion does. Allocates nothing
    /// after it is made, and waits for nobody.
    /// </summary>
    public sealed class VoiceLine
    {
        /// Most silence at once, seconds.
        private const int MostSilence = 5;

        private readonly Session session;
        private readonly int rate, channels;
        private readonly float[] line;
        private readonly float[] silence;
        private readonly bool mutes;
        private int at;
        private long pushed;
        private long next;
        private int inside, clear, status, channelsSeen, blocks;
        private volatile bool playing;

        /// <param name="delay">Samples of each channel by which sound is delayed; 0 leaves it alone.</param>
        /// <param name="mutes">Whether no sound comes out.</param>
        public VoiceLine(Session session, int sampleRate, int channels, int delay, bool mutes = false)
        {
            this.mutes = mutes;
            this.session = session;
            this.channels = channels;
            rate = sampleRate;
            channelsSeen = channels;
            line = new float[delay * channels];
            silence = new float[512 * channels];
        }

        /// <summary>Samples of each channel that the session has taken.</summary>
        public long Pushed { get { return Interlocked.Read(ref pushed); } }

        /// <summary>What the last push came to.</summary>
        public Status Status { get { return (Status)Volatile.Read(ref status); } }

        /// <summary>Channels of the last block: where they are others than the session's, nothing is pushed.</summary>
        public int ChannelsSeen { get { return Volatile.Read(ref channelsSeen); } }

        /// <summary>Blocks that came.</summary>
        public int Blocks { get { return Volatile.Read(ref blocks) & int.MaxValue; } }

        /// <summary>Whether the source plays. Where it does not, silence is no speech.</summary>
        public bool Playing { get { return playing; } set { playing = value; } }

        /// <summary>Silence is put in before the next sound, so that this is its first sample.</summary>
        public void StartAt(long sample) { Interlocked.Exchange(ref next, sample); }

        /// <summary>Drops the sound that is delayed.</summary>
        public void Clear() { Volatile.Write(ref clear, 1); }

        /// <summary>A block of sound, on the audio thread.</summary>
        public void Process(float[] data, int blockChannels)
        {
            Volatile.Write(ref channelsSeen, blockChannels);
            Interlocked.Increment(ref blocks);
            if (blockChannels != channels) return;
            if (playing || !IsSilent(data)) Push(data, data.Length);
            if (mutes) Array.Clear(data, 0, data.Length);
            else Delay(data);
        }

        /// <summary>Sound for the session, without a delay of what is heard.</summary>
        public void Push(float[] data, int count)
        {
            // Where the game thread is just putting silence in, that stands for this block.
            if (Interlocked.CompareExchange(ref inside, 1, 0) != 0) return;
            PutSilence(Math.Min(Interlocked.Read(ref next) - pushed, MostSilence * (long)rate));
            Put(data, count);
            Volatile.Write(ref inside, 0);
        }

        /// <summary>Silence instead of sound, on the game thread.</summary>
        public void Silence(int samples)
        {
            if (Interlocked.CompareExchange(ref inside, 1, 0) != 0) return;
            PutSilence(samples);
            Volatile.Write(ref inside, 0);
        }

        private void PutSilence(long samples)
        {
            while (samples > 0)
            {
                int count = (int)Math.Min(samples, silence.Length / channels);
                if (!Put(silence, count * channels)) return;
                samples -= count;
            }
        }

        private bool Put(float[] samples, int count)
        {
            int taken;
            Status result = session.PushAudio(samples, 0, count, out taken);
            Volatile.Write(ref status, (int)result);
            Interlocked.Add(ref pushed, taken / channels);
            return taken == count;
        }

        private void Delay(float[] data)
        {
            if (line.Length == 0) return;
            if (Interlocked.Exchange(ref clear, 0) == 1) Array.Clear(line, 0, line.Length);
            for (int i = 0; i < data.Length; i++)
            {
                float late = line[at];
                line[at] = data[i];
                data[i] = late;
                if (++at == line.Length) at = 0;
            }
        }

        private static bool IsSilent(float[] data)
        {
            for (int i = 0; i < data.Length; i++)
            {
                if (data[i] != 0) return false;
            }
            return true;
        }
    }
}
