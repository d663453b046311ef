// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// The voice in a player of a browser, where no filter gets what a source plays: its samples are read out of the clip.
    /// What has begun to play is paused until its motion is there, and read ahead of what is heard from then on. For the main
    /// thread.
    /// </summary>
    public sealed class ClipVoice
    {
        /// Whoever moves the place in a clip by more than this, seconds, has sought.
        private const double Sought = 0.5;

        private readonly VoiceLine line;
        private readonly int rate, channels, ahead;
        private readonly float[] block;
        private AudioClip clip;
        /// The clip that `samples` have room for: one that is still being loaded is tried again at every picture.
        private AudioClip tried;
        private float[] samples;
        private bool waits;
        private double left, owed;
        /// The clip's sample that is pushed next, and the one that was heard at the last picture.
        private int at, heard;

        /// <param name="ahead">Samples of each channel by which it is heard later than it is pushed.</param>
        public ClipVoice(VoiceLine line, int rate, int channels, int ahead)
        {
            this.line = line;
            this.rate = rate;
            this.channels = channels;
            this.ahead = ahead;
            block = new float[1024 * channels];
        }

        /// <summary>Whether the source plays, or waits for its motion.</summary>
        public bool Plays { get { return clip != null; } }

        /// <summary>Whether a clip has another rate or other channels, so that it needs a session of its own.</summary>
        public bool IsOther(AudioClip other)
        {
            return other != null && (other.frequency != rate || other.channels != channels);
        }

        /// <summary>A picture has passed. False where the samples of the source's clip cannot be read.</summary>
        public bool Follow(AudioSource source, double seconds)
        {
            if (clip != null && source.clip != clip) Stop();
            if (clip == null)
            {
                if (!source.isPlaying || source.clip == null) return true;
                if (tried != source.clip)
                {
                    tried = source.clip;
                    samples = new float[tried.samples * channels];
                }
                if (!tried.GetData(samples, 0)) return false;
                clip = tried;
                at = heard = source.timeSamples;
                owed = 0;
                left = ahead / (double)rate;
                waits = ahead > 0;
                if (waits) source.Pause();
                return true;
            }
            if (waits)
            {
                owed += Math.Min(seconds, left) * rate;
                left -= seconds;
                if (left <= 0)
                {
                    waits = false;
                    source.UnPause();
                }
            }
            else if (!source.isPlaying)
            {
                Stop();
                return true;
            }
            else
            {
                int now = source.timeSamples, step = now - heard;
                if (step < 0 && source.loop) step += clip.samples;
                if (step < 0 || step > Sought * rate)
                {
                    at = now + ahead;
                    step = 0;
                }
                heard = now;
                owed += step;
            }
            int count = (int)Math.Round(owed);
            owed -= count;
            Push(count, source.loop);
            return true;
        }

        /// <summary>Plays no more.</summary>
        public void Stop()
        {
            clip = tried = null;
            samples = null;
            waits = false;
        }

        /// <summary>A source that waits is left as it was found.</summary>
        public void Release(AudioSource source)
        {
            if (waits) source.UnPause();
            Stop();
        }

        private void Push(int count, bool loops)
        {
            while (count > 0)
            {
                if (loops) at %= clip.samples;
                int some = Math.Min(count, block.Length / channels);
                // After the clip's end its motion is still to be heard out.
                int there = Math.Max(0, Math.Min(some, clip.samples - at));
                if (loops) some = there;
                if (there > 0) Array.Copy(samples, at * channels, block, 0, there * channels);
                Array.Clear(block, there * channels, (some - there) * channels);
                line.Push(block, some * channels);
                at += some;
                count -= some;
            }
        }
    }
}
