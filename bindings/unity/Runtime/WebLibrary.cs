// SPDX-License-Identifier: MIT OR Apache-2.0

using System.Runtime.InteropServices;

namespace Umo.Unity
{
    /// <summary>
    /// The library in WebGL players: a separate module, umo.wasm, that must be fetched before the first call
    /// (WebGL/umo.jslib). On all other platforms the library is available from the start.
    /// </summary>
    public static class WebLibrary
    {
#if UNITY_WEBGL && !UNITY_EDITOR
        private const uint Ready = 2, Failed = 3;

        [DllImport(Native.Library)] private static extern void umo_web_load(string url);
        [DllImport(Native.Library)] private static extern uint umo_web_state();

        /// <summary>Starts to fetch the module unless it was already fetched.</summary>
        public static void Load(string url) { umo_web_load(url); }

        /// <summary>Whether calls can be made. Throws UmoException if the module could not be fetched.</summary>
        public static bool IsReady
        {
            get
            {
                uint state = umo_web_state();
                if (state == Failed) throw new UmoException(Status.Io, Native.Text(Native.umo_last_error()));
                return state == Ready;
            }
        }
#else
        /// <summary>Does nothing on this platform.</summary>
        public static void Load(string url) { }

        /// <summary>Always true on this platform.</summary>
        public static bool IsReady { get { return true; } }
#endif
    }
}
