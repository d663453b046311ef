// SPDX-License-Identifier: MIT OR Apache-2.0

using System;

namespace Umo
{
    /// <summary>A motion that was recorded, to be played by <see cref="Session.Player"/>: the bytes of a .umo file.</summary>
    public sealed unsafe class Take : IDisposable
    {
        private readonly TakeHandle handle;

        /// <summary>Reads a take; throws where it is damaged. The bytes are copied.</summary>
        public Take(byte[] bytes)
        {
            if (bytes == null) throw new ArgumentNullException(nameof(bytes));
            Native.Require();
            IntPtr raw;
            byte none = 0;
            fixed (byte* first = bytes)
            {
                UmoException.Check(Native.umo_take_new(bytes.Length == 0 ? &none : first, (UIntPtr)bytes.Length, &raw));
            }
            handle = new TakeHandle(raw);
        }

        /// <summary>The handle, freed or not.</summary>
        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>What it says of itself.</summary>
        public Status GetInfo(out TakeInfo info)
        {
            TakeInfo found = new TakeInfo { StructSize = (uint)sizeof(TakeInfo) };
            Status status = Native.umo_take_get_info(handle.Raw, &found);
            GC.KeepAlive(this);
            info = found;
            return status;
        }

        /// <summary>Frees the take. Sessions that play it go on.</summary>
        public void Dispose()
        {
            handle.Dispose();
        }
    }
}
