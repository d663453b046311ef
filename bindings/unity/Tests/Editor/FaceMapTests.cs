// SPDX-License-Identifier: MIT OR Apache-2.0

using NUnit.Framework;

namespace Umo.Unity.Tests
{
    public sealed class FaceMapTests
    {
        private static readonly string[] Names = { "jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "mouthLeft", "mouthRight", "mouthSmileLeft", "tongueOut" };

        [Test]
        public void shapes_are_found_by_the_usual_spellings()
        {
            FaceMap map = new FaceMap(Names);
            foreach (string shape in new[] { "jawOpen", "JawOpen", "jaw_open", "JAW_OPEN", "blendShape1.jawOpen", "Face|jawOpen", "rig:Head.jawOpen", "ARKit_jawOpen", "head_BS_JawOpen", "jaw open" })
            {
                Assert.AreEqual(0, map.Find(shape), shape);
            }
            foreach (string shape in new[] { "eyeBlinkLeft", "eyeBlink_L", "EyeBlink_Left", "blendShape2.eye_blink_l", "eyeBlinkLEFT" }) Assert.AreEqual(1, map.Find(shape), shape);
            Assert.AreEqual(2, map.Find("eyeBlink_R"));
            Assert.AreEqual(3, map.Find("mouth_L"));
            Assert.AreEqual(4, map.Find("mouthRight"));
        }

        [Test]
        public void other_shapes_are_left_alone()
        {
            FaceMap map = new FaceMap(Names);
            foreach (string shape in new[] { "", "jaw", "jawOpenWide", "open", "eyeBlink", "Smile", "_", ".", "a.b" }) Assert.AreEqual(-1, map.Find(shape), shape);
        }
    }
}
