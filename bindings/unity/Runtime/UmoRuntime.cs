// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// One engine per model file for the whole process, as long as somebody uses it. To keep a model loaded from scene to
    /// scene, acquire it once more. For the main thread. Settings are those of engines that are made from now on; 0 is the
    /// library's default.
    /// </summary>
    public static partial class UmoRuntime
    {
        private sealed class Shared
        {
            public Engine Engine;
            public int Users;
        }

        private static readonly Dictionary<string, Shared> Engines = new Dictionary<string, Shared>();

        /// <summary>
        /// Whether engines compute on the main thread, in <see cref="Compute"/>: a player of a browser has no other threads.
        /// </summary>
        public static bool IsPolled { get { return Application.platform == RuntimePlatform.WebGLPlayer; } }

        /// <summary>Microseconds of each picture for computing, where <see cref="IsPolled"/>; one step at least is done.</summary>
        public static uint PollMicroseconds { get; set; } = 4000;

        private static int computed = -1;

        /// <summary>Computes what is due, once a picture. Avatars call it. Nothing to do where the library has threads.</summary>
        public static void Compute()
        {
            if (!IsPolled || Time.frameCount == computed) return;
            computed = Time.frameCount;
            bool more;
            // What failed its sessions say.
            foreach (Shared shared in Engines.Values) shared.Engine.Poll(PollMicroseconds, out more);
        }

        /// <summary>Whether nothing needs to be loaded for this file.</summary>
        public static bool Has(string path) { return Engines.ContainsKey(path); }

        /// <summary>The engine of a model file, or of a file's bytes where it cannot be opened. Throws UmoException.</summary>
        public static Engine Acquire(string path, byte[] bytes = null)
        {
            Shared shared;
            if (!Engines.TryGetValue(path, out shared))
            {
                Model model = bytes == null ? Model.Load(path) : Model.Load(bytes);
                try
                {
                    EngineConfig config = Engine.Defaults;
                    Configure(ref config);
                    if (IsPolled)
                    {
                        config.Mode = EngineMode.Polled;
                        config.Threads = 1;
                    }
                    shared = new Shared { Engine = new Engine(model, config) };
                }
                catch (UmoException)
                {
                    model.Dispose();
                    throw;
                }
                Engines.Add(path, shared);
            }
            shared.Users++;
            return shared.Engine;
        }

        /// <summary>Gives back what <see cref="Acquire"/> gave; after <see cref="Shutdown"/> there is nothing to give back.</summary>
        public static void Release(string path, Engine engine)
        {
            Shared shared;
            if (!Engines.TryGetValue(path, out shared) || shared.Engine != engine || --shared.Users > 0) return;
            Engines.Remove(path);
            Free(shared);
        }

        /// <summary>
        /// Frees all engines, whoever uses them: their avatars stand still. Called before code is unloaded, and when play
        /// starts in a process in which it ran before.
        /// </summary>
        [RuntimeInitializeOnLoadMethod(RuntimeInitializeLoadType.SubsystemRegistration)]
        public static void Shutdown()
        {
            foreach (Shared shared in Engines.Values) Free(shared);
            Engines.Clear();
        }

        private static void Free(Shared shared)
        {
            shared.Engine.Dispose();
            shared.Engine.Model.Dispose();
        }
    }
}
