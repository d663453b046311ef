// SPDX-License-Identifier: MIT OR Apache-2.0
// No type of the engine: this half is tested without it.

using System;

namespace Umo.Unity
{
    /// <summary>
    /// The time of the motion that belongs to the sound that is heard. Sound is known in blocks of some 20 ms; the clock runs
    /// with the game's frames, follows the sound, and never goes back.
    /// </summary>
    public sealed class MotionClock
    {
        private const double FrameRate = 30;
        /// Behind the sound by more than this, it jumps; ahead by more than that, it waits.
        private const double Behind = 0.15, Ahead = 0.05;
        /// Share of the difference that is made up per second.
        private const double Pull = 5;

        private readonly double rate;
        /// Time of the motion of the stream's sample 0.
        private double origin;
        private double easeEnd;
        private ulong firstFrame;

        public MotionClock(int sampleRate)
        {
            rate = sampleRate;
        }

        /// <summary>Seconds of the motion, for Session.SamplePose.</summary>
        public double Time { get; private set; }

        /// <summary>A frame of the game has passed, and this sample is heard now, before 0 where none is yet.</summary>
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

        /// <summary>Time passes though nothing is heard: an ease to rest runs.</summary>
        public void Rest(double seconds)
        {
            Time += seconds;
        }

        /// <summary>The first sample whose motion is not in the past already.</summary>
        public long NextSample { get { return (long)Math.Ceiling((Math.Max(Time, easeEnd) - origin) * rate); } }

        /// <summary>The session was interrupted when frame <paramref name="shown"/>, or none, had been shown and so many samples pushed.</summary>
        public void Interrupt(ulong shown, bool any, uint easeMs, long pushed)
        {
            firstFrame = any ? shown + 1 + (ulong)Math.Ceiling(easeMs * FrameRate / 1000) : 0;
            easeEnd = firstFrame / FrameRate;
            origin = easeEnd - pushed / rate;
        }

        /// <summary>What a frame says of itself: keeps frames and samples together, whatever was dropped.</summary>
        public void Follow(ulong index, ulong sample)
        {
            double found = index / FrameRate - sample / rate;
            // A sample's number is a whole one.
            if (index >= firstFrame && Math.Abs(found - origin) > 2 / rate) origin = found;
        }
    }
}
