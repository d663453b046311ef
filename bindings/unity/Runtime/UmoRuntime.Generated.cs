// SPDX-License-Identifier: MIT OR Apache-2.0
// Generated from umo-capi/src by umo-capi/header: change it there.

namespace Umo.Unity
{
    public static partial class UmoRuntime
    {
        /// <summary>
        /// Number of compute threads, 1 to 64. With EngineMode.Polled the polling thread is one of them, and the engine
        /// starts the others unless Jobs lends them.
        /// </summary>
        public static uint Threads { get; set; }

        /// <summary>Maximum number of sessions at once, 1 to 4,096.</summary>
        public static uint MaxSessions { get; set; }

        /// <summary>
        /// Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need more
        /// memory.
        /// </summary>
        public static uint MaxBatch { get; set; }

        /// <summary>
        /// Priority of the engine's own threads: one of Priority. If the system refuses it, they run at Priority.Normal,
        /// and Log gets a warning that says what would permit it.
        /// </summary>
        public static Priority Priority { get; set; }

        /// <summary>
        /// Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms,
        /// 32 avatars take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at
        /// the start of a stream, once at most half of its length is left until it would be late, or if all sessions are
        /// due. 0: no chunk waits.
        /// </summary>
        public static uint BatchWindowMs { get; set; }

        /// <summary>
        /// Kinds of cores that the engine's own threads run on if CoreCount is 0: one of CoreKinds. All but
        /// CoreKinds.System start at most as many threads as the kind has cores. No effect where all cores are of one
        /// kind.
        /// </summary>
        public static CoreKinds CoreKinds { get; set; }

        private static void Configure(ref EngineConfig config)
        {
            if (Threads != 0) config.Threads = Threads;
            if (MaxSessions != 0) config.MaxSessions = MaxSessions;
            if (MaxBatch != 0) config.MaxBatch = MaxBatch;
            if (Priority != 0) config.Priority = Priority;
            if (BatchWindowMs != 0) config.BatchWindowMs = BatchWindowMs;
            if (CoreKinds != 0) config.CoreKinds = CoreKinds;
        }
    }
}
