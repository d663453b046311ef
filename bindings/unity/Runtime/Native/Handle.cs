// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Runtime.InteropServices;
using System.Threading;

namespace Umo
{
    /// <summary>
    /// Frees a library handle exactly once, by Dispose or by the garbage collector. The library detects freed handles
    /// and does not free an object while another thread is in a call on it, so calls need no reference counting.
    /// </summary>
    internal abstract class Handle : SafeHandle
    {
        /// Number of attempts to free while another thread is in a call, one millisecond apart.
        private const int Tries = 2000;

        protected Handle(IntPtr raw) : base(IntPtr.Zero, true)
        {
            SetHandle(raw);
        }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        /// <summary>The handle, freed or not.</summary>
        internal IntPtr Raw { get { return handle; } }

        protected abstract Status Free(IntPtr raw);

        protected override bool ReleaseHandle()
        {
            Status status = Free(handle);
            for (int i = 0; status == Status.Busy && i < Tries; i++)
            {
                Thread.Sleep(1);
                status = Free(handle);
            }
            return status == Status.Ok;
        }
    }

    internal sealed class ModelHandle : Handle
    {
        internal ModelHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_model_free(raw); }
    }

    internal sealed class EngineHandle : Handle
    {
        internal EngineHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_engine_free(raw); }
    }

    internal sealed class SessionHandle : Handle
    {
        internal SessionHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_session_free(raw); }
    }

    internal sealed class TakeHandle : Handle
    {
        internal TakeHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_take_free(raw); }
    }

    internal sealed class SceneHandle : Handle
    {
        internal SceneHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_scene_free(raw); }
    }

    internal sealed class RetargetHandle : Handle
    {
        internal RetargetHandle(IntPtr raw) : base(raw) { }
        protected override Status Free(IntPtr raw) { return Native.umo_retarget_free(raw); }
    }
}
