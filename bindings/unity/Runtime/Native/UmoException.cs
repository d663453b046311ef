// SPDX-License-Identifier: MIT OR Apache-2.0

using System;

namespace Umo
{
    /// <summary>A call that sets something up failed. Calls of the audio and the game thread return a status instead.</summary>
    public sealed class UmoException : Exception
    {
        public Status Status { get; }

        public UmoException(Status status, string detail)
            : base(string.IsNullOrEmpty(detail) ? Describe(status) : Describe(status) + ": " + detail)
        {
            Status = status;
        }

        /// <summary>What a status means, and what to do about it.</summary>
        public static string Describe(Status status)
        {
            // A player of a browser may have no library to ask yet.
            return Native.Text(Native.umo_status_message(status)) ?? status.ToString();
        }

        /// <summary>Throws where the last call on this thread, one that names no session, failed.</summary>
        internal static void Check(Status status)
        {
            if (status != Status.Ok) throw new UmoException(status, Native.Text(Native.umo_last_error()));
        }
    }
}
