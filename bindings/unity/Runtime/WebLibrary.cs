// SPDX-License-Identifier: MIT OR Apache-2.0

using System.Runtime.InteropServices;

namespace Umo.Unity
{
    /// <summary>
    /// The library in a player of a browser: a module of its own, umo.wasm, which has to be fetched before the first call
    /// (WebGL/umo.jslib). Everywhere else the library is there from the beginning.
    /// </summary>
    public static class WebLibrary
    {
#if UNITY_WEBGL && !UNITY_EDITOR
        private const uint Ready = 2, Failed = 3;

        [DllImport(Native.Library)] private static extern void umo_web_load(string url);
        [DllImport(Native.Library)] private static extern uint umo_web_state();

        /// <summary>Begins to fetch the module, if that is still to be done.</summary>
        public static void Load(string url) { umo_web_load(url); }

        /// <summary>Whether calls can be made. Throws UmoException where the module could not be fetched.</summary>
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
        /// <summary>Begins to fetch the module, if that is still to be done.</summary>
        public static void Load(string url) { }

        /// <summary>Whether calls can be made. Throws UmoException where the module could not be fetched.</summary>
        public static bool IsReady { get { return true; } }
#endif
    }
}
