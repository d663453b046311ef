// SPDX-License-Identifier: MIT OR Apache-2.0

using System;

namespace Umo
{
    /// <summary>Computes sessions of one model, on threads of its own or in <see cref="Poll"/>.</summary>
    public sealed unsafe class Engine : IDisposable
    {
        private readonly EngineHandle handle;

        public Engine(Model model, EngineConfig? config = null, uint[] cores = null)
        {
            if (model == null) throw new ArgumentNullException(nameof(model));
            Model = model;
            EngineConfig used = config ?? Defaults;
            IntPtr raw;
            fixed (uint* numbers = cores)
            {
                if (cores != null)
                {
                    used.Cores = (IntPtr)numbers;
                    used.CoreCount = (uint)cores.Length;
                }
                UmoException.Check(Native.umo_engine_new(model.Raw, &used, &raw));
            }
            GC.KeepAlive(model);
            handle = new EngineHandle(raw);
        }

        /// <summary>How engines are made if nothing else is said.</summary>
        public static EngineConfig Defaults
        {
            get
            {
                EngineConfig config;
                UmoException.Check(Native.umo_engine_config_init(&config, (UIntPtr)sizeof(EngineConfig)));
                return config;
            }
        }

        /// <summary>What it was made with: disposing one leaves the other alone.</summary>
        public Model Model { get; }

        internal IntPtr Raw { get { return handle.Raw; } }

        /// <summary>Computes on this thread for so many microseconds, where the engine is polled. Allocates nothing.</summary>
        public Status Poll(uint budget, out bool more)
        {
            uint value = 0;
            Status status = Native.umo_engine_poll(Raw, budget, &value);
            GC.KeepAlive(this);
            more = value != 0;
            return status;
        }

        public void Dispose() { handle.Dispose(); }
    }
}
