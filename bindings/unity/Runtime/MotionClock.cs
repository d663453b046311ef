// SPDX-License-Identifier: MIT OR Apache-2.0
// Does not use engine types, so that it can be tested without Unity.

using System;

namespace Umo.Unity
{
    /// <summary>
    /// Motion time that belongs to the sound being heard. The position of the sound is known in blocks of about 20 ms;
    /// the clock advances with the game's frames, follows the sound, and never goes back.
    /// </summary>
    public sealed class MotionClock
    {
        private const double FrameRate = 30;
        /// Maximum lag behind the sound before the clock jumps, and maximum lead before it waits, in seconds.
        private const double Behind = 0.15, Ahead = 0.05;
        /// Share of the difference corrected per second.
        private const double Pull = 5;

        private readonly double rate;
        /// Motion time of the stream's sample 0.
        private double origin;
        private double easeEnd;
        private ulong firstFrame;

        public MotionClock(int sampleRate)
        {
            rate = sampleRate;
        }

        /// <summary>Seconds of the motion, for Session.SamplePose.</summary>
        public double Time { get; private set; }

        /// <summary>Advances by one game frame. `heard` is the sample being heard, or negative if none is yet.</summary>
        public void Advance(double seconds, double heard)
        {
            if (Time < easeEnd)
            {
                Time = Math.Min(Time + seconds, easeEnd);
                return;
            }
            double target = origin + heard / rate;
            double error = target - (Time + seconds);
            if (error > Behind) Time = target;
            else if (error > -Ahead) Time += Math.Max(0, seconds + error * Math.Min(1, Pull * seconds));
        }

        /// <summary>Advances while nothing is heard, such as during an ease to rest.</summary>
        public void Rest(double seconds)
        {
            Time += seconds;
        }

        /// <summary>First sample whose motion is not already in the past.</summary>
        public long NextSample { get { return (long)Math.Ceiling((Math.Max(Time, easeEnd) - origin) * rate); } }

        /// <summary>
        /// The session was interrupted after frame <paramref name="shown"/> (if any) was shown and <paramref
        /// name="pushed"/> samples were pushed.
        /// </summary>
        public void Interrupt(ulong shown, bool any, uint easeMs, long pushed)
        {
            firstFrame = any ? shown + 1 + (ulong)Math.Ceiling(easeMs * FrameRate / 1000) : 0;
            easeEnd = firstFrame / FrameRate;
            origin = easeEnd - pushed / rate;
        }

        /// <summary>Synchronises with a frame's own index and sample, so that dropped frames cause no drift.</summary>
        public void Follow(ulong index, ulong sample)
        {
            double found = index / FrameRate - sample / rate;
            // Samples are whole numbers: ignore differences from rounding.
            if (index >= firstFrame && Math.Abs(found - origin) > 2 / rate) origin = found;
        }
    }
}
