// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using NUnit.Framework;

namespace Umo.Unity.Tests
{
    public sealed class MotionClockTests
    {
        private const int Rate = 48000;

        /// Plays blocks of 1,024 samples, heard `lag` later, with the game's frames.
        private static void Play(MotionClock clock, double from, double to, double frame, Action<double> each, double lag = 0)
        {
            for (double time = from; time < to; time += frame)
            {
                long pushed = (long)(time * Rate / 1024) * 1024;
                clock.Advance(frame, pushed - lag * Rate);
                each(time);
            }
        }

        [Test]
        public void it_follows_the_sound_smoothly_and_never_goes_back()
        {
            foreach (double frame in new[] { 1 / 240.0, 1 / 60.0, 1 / 30.0, 1 / 17.0 })
            {
                MotionClock clock = new MotionClock(Rate);
                double last = 0;
                Play(clock, 0, 10, frame, time =>
                {
                    Assert.IsTrue(clock.Time >= last, "it went back");
                    if (time > 2)
                    {
                        Assert.AreEqual(time, clock.Time, 0.035, "at " + frame);
                        Assert.AreEqual(frame, clock.Time - last, 0.2 * frame, "a step at " + frame);
                    }
                    last = clock.Time;
                });
            }
        }

        [Test]
        public void it_waits_until_the_first_sound_is_heard()
        {
            MotionClock clock = new MotionClock(Rate);
            Play(clock, 0, 0.6, 1 / 60.0, time => Assert.IsTrue(clock.Time <= Math.Max(0.05, time - 0.7 + 0.05), "at " + time + " " + clock.Time), 0.7);
            Play(clock, 0.6, 3, 1 / 60.0, time => { }, 0.7);
            Assert.AreEqual(2.3, clock.Time, 0.035);
        }

        [Test]
        public void it_stands_when_the_sound_does_and_jumps_when_it_was_away()
        {
            MotionClock clock = new MotionClock(Rate);
            for (int i = 0; i < 600; i++) clock.Advance(1 / 60.0, Rate);
            Assert.AreEqual(1, clock.Time, 0.08);
            clock.Advance(1 / 60.0, 5 * Rate);
            Assert.AreEqual(5, clock.Time, 1e-9);
        }

        [Test]
        public void an_interrupt_shows_its_ease_and_then_what_is_said_next()
        {
            MotionClock clock = new MotionClock(Rate);
            Play(clock, 0, 2, 1 / 60.0, time => { }, 0.5);
            // Frame 45 is shown at 1.5 s; 300 ms are 9 frames, so the next speech starts with frame 55.
            long pushed = 2 * Rate;
            clock.Interrupt(45, true, 300, pushed);
            double start = clock.Time;
            for (int i = 1; i <= 15; i++)
            {
                clock.Advance(1 / 60.0, pushed - 0.5 * Rate);
                Assert.AreEqual(Math.Min(start + i / 60.0, 55 / 30.0), clock.Time, 1e-9, "in the ease");
            }
            Assert.IsTrue(clock.NextSample <= pushed + 1, "no silence is needed");
            // Samples pushed from now on are heard half a second later, when their first frame is shown.
            for (int i = 1; i <= 60; i++) clock.Advance(1 / 60.0, pushed + i * 800 - 0.5 * Rate);
            Assert.AreEqual(55 / 30.0 + 0.5, clock.Time, 0.03);
        }

        [Test]
        public void frames_say_where_their_stream_begins()
        {
            MotionClock clock = new MotionClock(Rate);
            clock.Interrupt(0, false, 0, 0);
            // Frame 60 belongs to second 1, not 2: the stream was dropped and restarted.
            clock.Follow(60, Rate);
            clock.Advance(1 / 60.0, 3 * Rate);
            Assert.AreEqual(4, clock.Time, 1e-9);
        }

        [Test]
        public void silence_makes_up_for_a_rest()
        {
            MotionClock clock = new MotionClock(Rate);
            Play(clock, 0, 2, 1 / 60.0, time => { });
            for (int i = 0; i < 60; i++) clock.Rest(1 / 60.0);
            Assert.AreEqual(3, clock.Time, 0.035);
            Assert.AreEqual(clock.Time * Rate, clock.NextSample, 1.0);
        }
    }
}
