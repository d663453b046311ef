// SPDX-License-Identifier: MIT OR Apache-2.0

using System;

namespace Umo
{
    /// <summary>A failed set-up call. Calls of the audio and the game thread return a status instead.</summary>
    public sealed class UmoException : Exception
    {
        public Status Status { get; }

        public UmoException(Status status, string detail)
            : base(string.IsNullOrEmpty(detail) ? Describe(status) : Describe(status) + ": " + detail)
        {
            Status = status;
        }

        /// <summary>Description of a status and how to react to it.</summary>
        public static string Describe(Status status)
        {
            // In WebGL players the library may not be loaded yet.
            return Native.Text(Native.umo_status_message(status)) ?? status.ToString();
        }

        /// <summary>Throws if the last call on this thread that has no session argument failed.</summary>
        internal static void Check(Status status)
        {
            if (status != Status.Ok) throw new UmoException(status, Native.Text(Native.umo_last_error()));
        }
    }
}
