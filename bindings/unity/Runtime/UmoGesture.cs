// SPDX-License-Identifier: MIT OR Apache-2.0

using UnityEngine;

namespace Umo.Unity
{
    /// <summary>
    /// A custom gesture: the animation of any humanoid character from a .glb or .vrm file, stored in the project as raw
    /// bytes (rename it to end with .bytes so that Unity does not import it).
    /// </summary>
    [CreateAssetMenu(menuName = "umo/Gesture", fileName = "gesture")]
    public sealed class UmoGesture : ScriptableObject
    {
        [Tooltip("Name for PlayGesture. Empty: the name of this asset.")]
        public string gestureName = "";
        [Tooltip("The .glb or .vrm file, renamed to end with .bytes.")]
        public TextAsset file;
        [Tooltip("Name of the animation in the file. Empty: the first.")]
        public string animationName = "";
        [Tooltip("Seconds from its start to the stroke. -1: its middle.")]
        [Min(-1)] public float stroke = -1;
        public bool movesHead = true;
        public bool movesTrunk = true;
        public bool movesLeftArm = true;
        public bool movesRightArm = true;

        /// <summary>Name for PlayGesture.</summary>
        public string Name { get { return string.IsNullOrEmpty(gestureName) ? name : gestureName; } }

        /// <summary>Adds the gesture to an engine, for sessions created from now on. Throws UmoException.</summary>
        public void AddTo(Engine engine)
        {
            if (file == null) throw new UmoException(Status.InvalidArgument, "the gesture " + Name + " has no file");
            Gesture parts = (movesHead ? Gesture.Head : 0) | (movesTrunk ? Gesture.Trunk : 0)
                | (movesLeftArm ? Gesture.LeftArm : 0) | (movesRightArm ? Gesture.RightArm : 0);
            engine.AddGestureFile(Name, file.bytes, string.IsNullOrEmpty(animationName) ? null : animationName, parts, stroke);
        }
    }
}
