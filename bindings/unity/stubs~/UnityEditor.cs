// SPDX-License-Identifier: MIT OR Apache-2.0
// The subset of the editor's API that the package uses.

using System;

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Class)] public sealed class CustomEditor : Attribute { public CustomEditor(Type inspectedType) { } }
    [AttributeUsage(AttributeTargets.Class)] public sealed class InitializeOnLoadAttribute : Attribute { }
    public enum MessageType { None, Info, Warning, Error }
    public enum PlayModeStateChange { EnteredEditMode, ExitingEditMode, EnteredPlayMode, ExitingPlayMode }

    public class Editor
    {
        public UnityEngine.Object target { get; set; }
        public virtual void OnInspectorGUI() { }
        public virtual bool RequiresConstantRepaint() { return false; }
        public bool DrawDefaultInspector() { return false; }
    }

    public static class EditorGUILayout
    {
        public static readonly System.Collections.Generic.List<string> Shown = new System.Collections.Generic.List<string>();
        public static void HelpBox(string message, MessageType type) { Shown.Add(type + ": " + message); }
    }

    public static class EditorApplication
    {
        public static bool isPlaying { get; set; }
        public static event Action quitting;
        public static event Action<PlayModeStateChange> playModeStateChanged;
        public static void Raise(PlayModeStateChange change) { playModeStateChanged(change); }
        public static void Quit() { quitting(); }
    }

    public static class AssemblyReloadEvents
    {
        public delegate void AssemblyReloadCallback();
        public static event AssemblyReloadCallback beforeAssemblyReload;
        public static void Raise() { beforeAssemblyReload(); }
    }
}
