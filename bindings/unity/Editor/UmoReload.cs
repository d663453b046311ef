// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEditor;

namespace Umo.Unity.Editing
{
    /// <summary>No thread of an engine's runs while the editor unloads code, and none outlives play.</summary>
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
