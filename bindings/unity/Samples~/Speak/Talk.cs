// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEngine;

namespace Umo.Unity.Samples
{
    /// <summary>Two buttons: says a clip, and is interrupted.</summary>
    [RequireComponent(typeof(UmoAvatar))]
    public sealed class Talk : MonoBehaviour
    {
        public AudioClip clip;

        private void OnGUI()
        {
            UmoAvatar avatar = GetComponent<UmoAvatar>();
            if (GUILayout.Button("Speak")) avatar.Speak(clip);
            if (GUILayout.Button("Interrupt")) avatar.Interrupt();
            if (avatar.Error.Length > 0) GUILayout.Label(avatar.Error);
        }
    }
}
