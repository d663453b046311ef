// SPDX-License-Identifier: MIT OR Apache-2.0
// The subset of the Unity API that the package uses, written for its tests: transforms rotate and move, meshes keep
// weights, sources play on request. Names and signatures follow Unity's documentation.

using System;
using System.Collections;
using System.Collections.Generic;
using System.Reflection;

namespace UnityEngine
{
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class CreateAssetMenuAttribute : Attribute { public string menuName { get; set; } public string fileName { get; set; } }
    [AttributeUsage(AttributeTargets.All)] public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string tooltip) { } }
    [AttributeUsage(AttributeTargets.All)] public sealed class HeaderAttribute : Attribute { public HeaderAttribute(string header) { } }
    [AttributeUsage(AttributeTargets.All)] public sealed class RangeAttribute : Attribute { public RangeAttribute(float min, float max) { } }
    [AttributeUsage(AttributeTargets.All)] public sealed class MinAttribute : Attribute { public MinAttribute(float min) { } }
    [AttributeUsage(AttributeTargets.Class)] public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string menuName) { } }
    [AttributeUsage(AttributeTargets.Class)] public sealed class DisallowMultipleComponent : Attribute { }
    [AttributeUsage(AttributeTargets.Class)] public sealed class DefaultExecutionOrder : Attribute { public DefaultExecutionOrder(int order) { } }
    [AttributeUsage(AttributeTargets.Class)] public sealed class RequireComponent : Attribute { public RequireComponent(Type required) { } }
    [AttributeUsage(AttributeTargets.Method)] public sealed class RuntimeInitializeOnLoadMethodAttribute : Attribute { public RuntimeInitializeOnLoadMethodAttribute(RuntimeInitializeLoadType loadType) { } }
    public enum RuntimeInitializeLoadType { AfterSceneLoad, BeforeSceneLoad, AfterAssembliesLoaded, BeforeSplashScreen, SubsystemRegistration }

    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 operator +(Vector3 a, Vector3 b) { return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z); }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return new Vector3(a.x - b.x, a.y - b.y, a.z - b.z); }
    }

    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion identity { get { return new Quaternion(0, 0, 0, 1); } }
        public static Quaternion Inverse(Quaternion q) { return new Quaternion(-q.x, -q.y, -q.z, q.w); }
        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(
                a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y + a.y * b.w + a.z * b.x - a.x * b.z,
                a.w * b.z + a.z * b.w + a.x * b.y - a.y * b.x, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            Quaternion turned = q * new Quaternion(v.x, v.y, v.z, 0) * Inverse(q);
            return new Vector3(turned.x, turned.y, turned.z);
        }
    }

    public static class Mathf
    {
        public static int CeilToInt(float f) { return (int)Math.Ceiling(f); }
        public static int RoundToInt(float f) { return (int)Math.Round(f); }
        public static float Clamp(float value, float min, float max) { return Math.Max(min, Math.Min(max, value)); }
    }

    public static class Debug
    {
        public static readonly List<string> Said = new List<string>();
        public static void LogError(object message, Object context) { Said.Add("error: " + message); }
        public static void LogWarning(object message, Object context) { Said.Add("warning: " + message); }
    }

    public enum RuntimePlatform { LinuxPlayer = 13, WebGLPlayer = 17 }
    public static class Application
    {
        public static string streamingAssetsPath { get; set; }
        public static RuntimePlatform platform { get; set; } = RuntimePlatform.LinuxPlayer;
    }
    public static class Time
    {
        public static float unscaledDeltaTime { get; set; }
        public static int frameCount { get; set; }
        public static int captureFramerate { get; set; }
    }

    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>() where T : ScriptableObject { return (T)System.Activator.CreateInstance(typeof(T)); }
    }

    public sealed class TextAsset : Object
    {
        public byte[] bytes { get; set; }
        public string text { get { return System.Text.Encoding.UTF8.GetString(bytes); } }
    }

    public class Object
    {
        public string name { get; set; } = "";
        public static void Destroy(Object obj) { }
    }

    public sealed class GameObject : Object
    {
        internal readonly List<Component> Components = new List<Component>();
        public Transform transform { get; }
        public GameObject(string name, GameObject parent = null)
        {
            this.name = name;
            transform = new Transform { gameObject = this };
            Components.Add(transform);
            if (parent != null) transform.SetParent(parent.transform);
        }
        public T AddComponent<T>() where T : Component, new()
        {
            T made = new T { gameObject = this };
            Components.Add(made);
            return made;
        }
        /// Calls messages as Unity does: by name, private or not.
        public static void Send(object to, string message, params object[] arguments)
        {
            MethodInfo method = to.GetType().GetMethod(message, BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic);
            if (method == null) throw new MissingMethodException(message);
            method.Invoke(to, arguments);
        }
    }

    public class Component : Object
    {
        public GameObject gameObject { get; internal set; }
        public Transform transform { get { return gameObject.transform; } }
        public T GetComponent<T>() where T : class
        {
            foreach (Component component in gameObject.Components) { if (component is T) return component as T; }
            return null;
        }
        public T[] GetComponentsInChildren<T>(bool includeInactive) where T : class
        {
            List<T> found = new List<T>();
            Collect(transform, found);
            return found.ToArray();
        }
        public T GetComponentInChildren<T>() where T : class
        {
            T[] found = GetComponentsInChildren<T>(true);
            return found.Length > 0 ? found[0] : null;
        }
        private static void Collect<T>(Transform at, List<T> found) where T : class
        {
            foreach (Component component in at.gameObject.Components) { if (component is T) found.Add(component as T); }
            foreach (Transform child in at.Children) Collect(child, found);
        }
    }

    public class Behaviour : Component { public bool enabled { get; set; } = true; }

    public class MonoBehaviour : Behaviour
    {
        public Coroutine StartCoroutine(IEnumerator routine)
        {
            while (routine.MoveNext()) { }
            return new Coroutine();
        }
        public void StopAllCoroutines() { }
    }

    public sealed class Coroutine { }

    public sealed class Transform : Component
    {
        internal readonly List<Transform> Children = new List<Transform>();
        public Transform parent { get; private set; }
        public Vector3 localPosition;
        public Quaternion localRotation = Quaternion.identity;
        public void SetParent(Transform to) { parent = to; to.Children.Add(this); }
        public Quaternion rotation
        {
            get { return parent == null ? localRotation : parent.rotation * localRotation; }
            set { localRotation = parent == null ? value : Quaternion.Inverse(parent.rotation) * value; }
        }
        public Vector3 position
        {
            get { return parent == null ? localPosition : parent.TransformPoint(localPosition); }
            set { localPosition = parent == null ? value : parent.InverseTransformPoint(value); }
        }
        public Vector3 forward { get { return rotation * new Vector3(0, 0, 1); } }
        public Vector3 TransformPoint(Vector3 point) { return position + rotation * point; }
        public Vector3 InverseTransformPoint(Vector3 point) { return Quaternion.Inverse(rotation) * (point - position); }
    }

    public enum HumanBodyBones
    {
        Hips, LeftUpperLeg, RightUpperLeg, LeftLowerLeg, RightLowerLeg, LeftFoot, RightFoot, Spine, Chest, Neck, Head,
        LeftShoulder, RightShoulder, LeftUpperArm, RightUpperArm, LeftLowerArm, RightLowerArm, LeftHand, RightHand, LeftToes,
        RightToes, LeftEye, RightEye, Jaw,
        LeftThumbProximal, LeftThumbIntermediate, LeftThumbDistal, LeftIndexProximal, LeftIndexIntermediate, LeftIndexDistal,
        LeftMiddleProximal, LeftMiddleIntermediate, LeftMiddleDistal, LeftRingProximal, LeftRingIntermediate, LeftRingDistal,
        LeftLittleProximal, LeftLittleIntermediate, LeftLittleDistal,
        RightThumbProximal, RightThumbIntermediate, RightThumbDistal, RightIndexProximal, RightIndexIntermediate, RightIndexDistal,
        RightMiddleProximal, RightMiddleIntermediate, RightMiddleDistal, RightRingProximal, RightRingIntermediate, RightRingDistal,
        RightLittleProximal, RightLittleIntermediate, RightLittleDistal, UpperChest, LastBone,
    }

    public sealed class Animator : Behaviour
    {
        public readonly Dictionary<HumanBodyBones, Transform> Bones = new Dictionary<HumanBodyBones, Transform>();
        public bool isHuman { get { return Bones.Count > 0; } }
        public Transform GetBoneTransform(HumanBodyBones bone)
        {
            Transform found;
            return Bones.TryGetValue(bone, out found) ? found : null;
        }
    }

    public sealed class Mesh : Object
    {
        public string[] Shapes = new string[0];
        public float Full = 100;
        public int blendShapeCount { get { return Shapes.Length; } }
        public string GetBlendShapeName(int shapeIndex) { return Shapes[shapeIndex]; }
        public int GetBlendShapeFrameCount(int shapeIndex) { return 1; }
        public float GetBlendShapeFrameWeight(int shapeIndex, int frameIndex) { return Full; }
        public bool isReadable { get; set; } = true;
        public Vector3[] vertices { get; set; } = new Vector3[0];
        public int[] triangles { get; set; } = new int[0];
        public BoneWeight[] boneWeights { get; set; } = new BoneWeight[0];
        public Matrix4x4[] bindposes { get; set; } = new Matrix4x4[0];
    }

    public struct BoneWeight
    {
        public float weight0 { get; set; }
        public int boneIndex0 { get; set; }
    }

    /// Only translations.
    public struct Matrix4x4
    {
        private Vector3 by;
        public static Matrix4x4 Translate(Vector3 vector) { return new Matrix4x4 { by = vector }; }
        public Vector3 MultiplyPoint3x4(Vector3 point) { return point + by; }
    }

    public sealed class MeshFilter : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public sealed class SkinnedMeshRenderer : Component
    {
        public readonly Dictionary<int, float> Weights = new Dictionary<int, float>();
        public Mesh sharedMesh { get; set; }
        public Transform[] bones { get; set; } = new Transform[0];
        public void SetBlendShapeWeight(int index, float value) { Weights[index] = value; }
    }

    public enum AudioSpeakerMode { Raw = 0, Mono = 1, Stereo = 2, Quad = 3, Surround = 4, Mode5point1 = 5, Mode7point1 = 6, Prologic = 7 }

    public static class AudioSettings
    {
        public delegate void AudioConfigurationChangeHandler(bool deviceWasChanged);
        public static event AudioConfigurationChangeHandler OnAudioConfigurationChanged;
        public static int outputSampleRate { get; set; } = 48000;
        public static AudioSpeakerMode speakerMode { get; set; } = AudioSpeakerMode.Stereo;
        public static void GetDSPBufferSize(out int bufferLength, out int numBuffers) { bufferLength = 1024; numBuffers = 4; }
        public static void Change(int rate)
        {
            outputSampleRate = rate;
            if (OnAudioConfigurationChanged != null) OnAudioConfigurationChanged(true);
        }
        public static bool HasListeners { get { return OnAudioConfigurationChanged != null; } }
    }

    public sealed class AudioClip : Object
    {
        private float[] data;
        public int samples { get; private set; }
        public int channels { get; private set; }
        public int frequency { get; private set; }
        public static AudioClip Create(string name, int lengthSamples, int channels, int frequency, bool stream)
        {
            return new AudioClip { name = name, samples = lengthSamples, channels = channels, frequency = frequency, data = new float[lengthSamples * channels] };
        }
        public bool IsReadable = true;
        public bool GetData(float[] into, int offsetSamples) { if (!IsReadable) return false; Array.Copy(data, offsetSamples * channels, into, 0, into.Length); return true; }
        public bool SetData(float[] from, int offsetSamples) { Array.Copy(from, 0, data, offsetSamples * channels, from.Length); return true; }
    }

    public sealed class AudioSource : Behaviour
    {
        public bool isPlaying { get; private set; }
        public bool loop { get; set; }
        public AudioClip clip { get; set; }
        public int timeSamples { get; set; }
        public bool IsPaused { get; private set; }
        public void Play() { isPlaying = true; IsPaused = false; }
        public void Stop() { isPlaying = IsPaused = false; timeSamples = 0; }
        public void Pause() { IsPaused = isPlaying; isPlaying = false; }
        public void UnPause() { isPlaying = isPlaying || IsPaused; IsPaused = false; }
        public void GetOutputData(float[] samples, int channel) { for (int i = 0; i < samples.Length; i++) samples[i] = 0.3f * (i % 3 - 1); }
    }

    public static class Microphone
    {
        public static string Open;
        public static int Written;
        public static AudioClip Start(string deviceName, bool loop, int lengthSec, int frequency)
        {
            Open = deviceName ?? "default";
            Written = 0;
            return deviceName == "none" ? null : AudioClip.Create("microphone", lengthSec * frequency, 1, frequency, false);
        }
        public static int GetPosition(string deviceName) { return Written; }
        public static void End(string deviceName) { Open = null; }
    }

    public static class GUILayout
    {
        public static bool Button(string text) { return false; }
        public static void Label(string text) { }
    }
}

namespace UnityEngine.Networking
{
    public sealed class DownloadHandler { public byte[] data { get; internal set; } }
    public sealed class UnityWebRequestAsyncOperation { }

    /// Supports file: only.
    public sealed class UnityWebRequest : IDisposable
    {
        private readonly string uri;
        private UnityWebRequest(string uri) { this.uri = uri; }
        public string error { get; private set; }
        public DownloadHandler downloadHandler { get; } = new DownloadHandler();
        public static UnityWebRequest Get(string uri) { return new UnityWebRequest(uri); }
        public UnityWebRequestAsyncOperation SendWebRequest()
        {
            try
            {
                downloadHandler.data = System.IO.File.ReadAllBytes(new Uri(uri).LocalPath);
            }
            catch (System.IO.IOException failure)
            {
                error = failure.Message;
            }
            return new UnityWebRequestAsyncOperation();
        }
        public void Dispose() { }
    }
}
