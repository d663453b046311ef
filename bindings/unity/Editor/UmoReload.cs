// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEditor;

namespace Umo.Unity.Editing
{
    /// <summary>Stops all engine threads before the editor unloads code and when play mode ends.</summary>
    [InitializeOnLoad]
    public static class UmoReload
    {
        static UmoReload()
        {
            AssemblyReloadEvents.beforeAssemblyReload += UmoRuntime.Shutdown;
            EditorApplication.quitting += UmoRuntime.Shutdown;
            EditorApplication.playModeStateChanged += change =>
            {
                if (change == PlayModeStateChange.EnteredEditMode) UmoRuntime.Shutdown();
            };
        }
    }
}
