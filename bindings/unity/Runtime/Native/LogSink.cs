// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Runtime.InteropServices;

namespace Umo
{
    /// <summary>
    /// Receives messages of a model or an engine: set <see cref="Pointer"/> as the Log of a configuration. It is never
    /// freed, because engines and sessions keep it. Not for hosts that unload code while an engine is alive, such as
    /// the Unity editor.
    /// </summary>
    public sealed unsafe class LogSink
    {
        // Ahead-of-time compilers must know which methods C calls; they look for an attribute of this name.
        [AttributeUsage(AttributeTargets.Method)]
        private sealed class MonoPInvokeCallbackAttribute : Attribute
        {
            public MonoPInvokeCallbackAttribute(Type type) { Type = type; }
            public Type Type { get; }
        }

        private static readonly LogWrite Written = Write;

        private readonly Action<LogLevel, string> write;

        public LogSink(Action<LogLevel, string> write)
        {
            if (write == null) throw new ArgumentNullException(nameof(write));
            this.write = write;
            Pointer = Marshal.AllocHGlobal(sizeof(Log));
            Log* log = (Log*)Pointer;
            log->Userdata = GCHandle.ToIntPtr(GCHandle.Alloc(this));
            log->Write = Marshal.GetFunctionPointerForDelegate(Written);
        }

        /// <summary>A <see cref="Log"/>.</summary>
        public IntPtr Pointer { get; }

        [MonoPInvokeCallback(typeof(LogWrite))]
        private static void Write(IntPtr userdata, LogLevel level, IntPtr message)
        {
            try
            {
                ((LogSink)GCHandle.FromIntPtr(userdata).Target).write(level, Native.Text(message));
            }
            catch (Exception)
            {
                // Exceptions must not propagate into C.
            }
        }
    }
}
