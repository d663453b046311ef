// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// A gesture of your own: the animation of any character with a human's bones, out of a .glb or .vrm file that is in the
    /// project as bytes (renamed to end with .bytes, so that Unity takes it as it is).
    /// </summary>
    [CreateAssetMenu(menuName = "umo/Gesture", fileName = "gesture")]
    public sealed class UmoGesture : ScriptableObject
    {
        [Tooltip("What PlayGesture calls it. Empty: the name of this asset.")]
        public string gestureName = "";
        [Tooltip("The .glb or .vrm file, renamed to end with .bytes.")]
        public TextAsset file;
        [Tooltip("Which of the file's animations. Empty: the first.")]
        public string animationName = "";
        [Tooltip("Seconds from its start to the stroke. -1: its middle.")]
        [Min(-1)] public float stroke = -1;
        public bool movesHead = true;
        public bool movesTrunk = true;
        public bool movesLeftArm = true;
        public bool movesRightArm = true;

        /// <summary>What PlayGesture calls it.</summary>
        public string Name { get { return string.IsNullOrEmpty(gestureName) ? name : gestureName; } }

        /// <summary>Makes sessions of an engine know it that are made from now on. Throws UmoException.</summary>
        public void AddTo(Engine engine)
        {
            if (file == null) throw new UmoException(Status.InvalidArgument, "the gesture " + Name + " has no file");
            Gesture parts = (movesHead ? Gesture.Head : 0) | (movesTrunk ? Gesture.Trunk : 0)
                | (movesLeftArm ? Gesture.LeftArm : 0) | (movesRightArm ? Gesture.RightArm : 0);
            engine.AddGestureFile(Name, file.bytes, string.IsNullOrEmpty(animationName) ? null : animationName, parts, stroke);
        }
    }
}
