// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// The voice in WebGL players, where no audio filter receives the output of a source: samples are read from the
    /// clip instead. A source that starts to play is paused until its motion is ready; from then on samples are read
    /// ahead of playback. Main thread only.
    /// </summary>
    public sealed class ClipVoice
    {
        /// A jump of the playback position by more than this many seconds counts as a seek.
        private const double Sought = 0.5;

        private readonly VoiceLine line;
        private readonly int rate, channels, ahead;
        private readonly float[] block;
        private AudioClip clip;
        /// The clip that `samples` was sized for. A clip that is still loading is retried each frame.
        private AudioClip tried;
        private float[] samples;
        private bool waits;
        private double left, owed;
        /// Sample of the clip to push next, and the sample heard at the last frame.
        private int at, heard;

        /// <param name="ahead">Delay between push and playback, in samples per channel.</param>
        public ClipVoice(VoiceLine line, int rate, int channels, int ahead)
        {
            this.line = line;
            this.rate = rate;
            this.channels = channels;
            this.ahead = ahead;
            block = new float[1024 * channels];
        }

        /// <summary>Whether the source is playing or waiting for its motion.</summary>
        public bool Plays { get { return clip != null; } }

        /// <summary>Whether a clip has another rate or channel count and so needs a new session.</summary>
        public bool IsOther(AudioClip other)
        {
            return other != null && (other.frequency != rate || other.channels != channels);
        }

        /// <summary>Call once per frame. False if the samples of the source's clip cannot be read.</summary>
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

        /// <summary>Stops playing.</summary>
        public void Stop()
        {
            clip = tried = null;
            samples = null;
            waits = false;
        }

        /// <summary>Restores a source that waits to its original state.</summary>
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
                // After the end of the clip, silence follows until its motion has been shown.
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
