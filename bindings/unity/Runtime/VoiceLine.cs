// SPDX-License-Identifier: MIT OR Apache-2.0
// Does not use engine types, so that it can be tested without Unity.

using System;
using System.Threading;

namespace Umo.Unity
{
    /// <summary>
    /// Audio thread side: passes sound to the session and outputs it with the delay of its motion. After construction
    /// it does not allocate and never waits for a lock.
    /// </summary>
    public sealed class VoiceLine
    {
        /// Maximum silence inserted at once, in seconds.
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

        /// <param name="delay">Delay of the sound in samples per channel; 0 leaves it unchanged.</param>
        /// <param name="mutes">Whether the output is muted.</param>
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

        /// <summary>Samples per channel that the session has taken.</summary>
        public long Pushed { get { return Interlocked.Read(ref pushed); } }

        /// <summary>Sample at which the next sound will be: after silence that is still to be inserted.</summary>
        public long NextPlace
        {
            get
            {
                long now = Pushed;
                return now + Math.Max(0, Math.Min(Interlocked.Read(ref next) - now, MostSilence * (long)rate));
            }
        }

        /// <summary>Result of the last push.</summary>
        public Status Status { get { return (Status)Volatile.Read(ref status); } }

        /// <summary>Channel count of the last block: if it differs from the session's, nothing is pushed.</summary>
        public int ChannelsSeen { get { return Volatile.Read(ref channelsSeen); } }

        /// <summary>Number of blocks received.</summary>
        public int Blocks { get { return Volatile.Read(ref blocks) & int.MaxValue; } }

        /// <summary>Whether the source plays. If it does not, silence does not count as speech.</summary>
        public bool Playing { get { return playing; } set { playing = value; } }

        /// <summary>Inserts silence before the next sound, so that the sound starts at this sample.</summary>
        public void StartAt(long sample) { Interlocked.Exchange(ref next, sample); }

        /// <summary>Drops the delayed sound.</summary>
        public void Clear() { Volatile.Write(ref clear, 1); }

        /// <summary>Processes a block of sound on the audio thread.</summary>
        public void Process(float[] data, int blockChannels)
        {
            Volatile.Write(ref channelsSeen, blockChannels);
            Interlocked.Increment(ref blocks);
            if (blockChannels != channels) return;
            if (playing || !IsSilent(data)) Push(data, data.Length);
            if (mutes) Array.Clear(data, 0, data.Length);
            else Delay(data);
        }

        /// <summary>Pushes sound to the session without delaying the output.</summary>
        public void Push(float[] data, int count)
        {
            // If the game thread is inserting silence at this moment, that silence replaces this block.
            if (Interlocked.CompareExchange(ref inside, 1, 0) != 0) return;
            PutSilence(NextPlace - pushed);
            Put(data, count);
            Volatile.Write(ref inside, 0);
        }

        /// <summary>Pushes silence instead of sound, on the game thread.</summary>
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
