// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEditor;

namespace Umo.Unity.Editing
{
    /// <summary>Shows errors and statistics of the avatar in the inspector.</summary>
    [CustomEditor(typeof(UmoAvatar))]
    public sealed class UmoAvatarInspector : Editor
    {
        public override bool RequiresConstantRepaint()
        {
            return EditorApplication.isPlaying;
        }

        public override void OnInspectorGUI()
        {
            DrawDefaultInspector();
            UmoAvatar avatar = (UmoAvatar)target;
            if (avatar.Error.Length > 0) EditorGUILayout.HelpBox(avatar.Error, MessageType.Error);
            if (avatar.Notice.Length > 0) EditorGUILayout.HelpBox(avatar.Notice, MessageType.Warning);
            if (avatar.Session == null) return;
            Stats stats;
            Latency latency;
            if (avatar.Session.GetStats(out stats) != Status.Ok || avatar.Session.GetLatency(out latency) != Status.Ok) return;
            EditorGUILayout.HelpBox(
                avatar.BoneCount + " bones, " + avatar.ShapeCount + " blend shapes\n"
                + "behind by " + avatar.Delay.ToString("0.00") + " s, computing takes " + (1000 * latency.ComputeP99).ToString("0") + " ms\n"
                + stats.Frames + " frames, " + stats.LateFrames + " late",
                MessageType.Info);
        }
    }
}
