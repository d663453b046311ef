// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// One engine per model file for the whole process, while it has users. Acquire it once more to keep a model loaded
    /// between scenes. Main thread only.
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
        /// Whether engines compute on the main thread, in <see cref="Compute"/>, as in WebGL players, which have no
        /// other threads.
        /// </summary>
        public static bool IsPolled { get { return Application.platform == RuntimePlatform.WebGLPlayer; } }

        /// <summary>Computing time per frame in microseconds, if <see cref="IsPolled"/>; at least one step is done.</summary>
        public static uint PollMicroseconds { get; set; } = 4000;

        private static int computed = -1;

        /// <summary>Computes due work once per frame; called by avatars. Does nothing if the library has threads.</summary>
        public static void Compute()
        {
            if (!IsPolled || Time.frameCount == computed) return;
            computed = Time.frameCount;
            bool more;
            // Sessions report failures themselves.
            foreach (Shared shared in Engines.Values) shared.Engine.Poll(PollMicroseconds, out more);
        }

        /// <summary>Whether the model file is already loaded.</summary>
        public static bool Has(string path) { return Engines.ContainsKey(path); }

        /// <summary>
        /// Returns the engine of a model file, or of its bytes if the file cannot be opened by path. Throws
        /// UmoException.
        /// </summary>
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

        /// <summary>Releases an engine from <see cref="Acquire"/>; no-op after <see cref="Shutdown"/>.</summary>
        public static void Release(string path, Engine engine)
        {
            Shared shared;
            if (!Engines.TryGetValue(path, out shared) || shared.Engine != engine || --shared.Users > 0) return;
            Engines.Remove(path);
            Free(shared);
        }

        /// <summary>
        /// Frees all engines even if in use: their avatars stop moving. Called before code is unloaded, and when play
        /// starts in a process that has already played.
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
