// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEngine;

namespace Umo.Unity.Samples
{
    /// <summary>Buttons to speak a clip, interrupt it, and use the microphone.</summary>
    [RequireComponent(typeof(UmoAvatar))]
    public sealed class Talk : MonoBehaviour
    {
        public AudioClip clip;

        private void OnGUI()
        {
            UmoAvatar avatar = GetComponent<UmoAvatar>();
            if (GUILayout.Button("Speak")) avatar.Speak(clip);
            if (GUILayout.Button("Interrupt")) avatar.Interrupt();
            if (GUILayout.Button("Microphone")) avatar.UseMicrophone();
            if (GUILayout.Button("No microphone")) avatar.StopMicrophone();
            if (avatar.Error.Length > 0) GUILayout.Label(avatar.Error);
        }
    }
}
