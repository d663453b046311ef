// SPDX-License-Identifier: MIT OR Apache-2.0
// The constants and structures of umo.h, with its names in C# spelling; see umo.h for their meaning. The tests compare
// every value and field offset with what a C compiler reports.

using System;
using System.Runtime.InteropServices;

namespace Umo
{
    /// <summary>Result of a call: Ok, or a negative error code.</summary>
    public enum Status : int
    {
        Ok = 0,
        NullPointer = -1,
        InvalidHandle = -2,
        InvalidArgument = -3,
        StructSize = -4,
        BufferTooSmall = -5,
        Version = -6,
        Io = -7,
        Model = -8,
        OutOfMemory = -9,
        Full = -10,
        Busy = -11,
        Finished = -12,
        Failed = -13,
        Closed = -14,
        Panic = -15,
        Unsupported = -16,
        State = -17,
        Thread = -18,
        Packet = -19,
    }

    /// <summary>Coordinate conventions: up axis, handedness and units.</summary>
    public enum Axes : uint { Gltf = 0, Unreal = 1, Unity = 2 }

    /// <summary>File formats of <see cref="Frames.WriteFile"/>.</summary>
    public enum FileFormat : uint { Glb = 1, Vrma = 2 }

    /// <summary>Computing threads: the engine's own, or the caller of Poll.</summary>
    public enum EngineMode : uint { Threads = 0, Polled = 1 }

    /// <summary>Priority of the engine's own threads. Falls back to Normal if the system refuses it.</summary>
    public enum Priority : uint { Normal = 0, High = 1, Low = 2 }

    public enum LogLevel : uint { Info = 1, Warning = 2, Error = 3 }

    public enum Precision : uint { Stored = 0, F32 = 1, Bf16 = 2, Int8 = 3 }

    /// <summary>Upper limit of the instruction set.</summary>
    public enum Isa : uint
    {
        Best = 0, Scalar = 1, Avx2 = 2, Avx512vnni = 3, Amx = 4, Avx512bf16 = 5, Avxvnni = 6,
        Neon = 7, NeonDotprod = 8, NeonI8mm = 9
    }

    /// <summary>Texts of a model.</summary>
    public enum ModelText : uint { Name = 1, License = 2, Notice = 3, Isa = 4 }

    /// <summary>Behaviour while no audio arrives.</summary>
    public enum Idle : uint { Hold = 0, Rest = 1, Live = 2 }

    /// <summary>Settings that can change while a session runs.</summary>
    public enum Parameter : uint
    {
        Temperature = 1,
        TopK = 2,
        TopP = 3,
        Idle = 4,
        Attention = 5,
        OutputDelay = 6,
        GainFace = 16,
        GainHands = 17,
        GainUpper = 18,
        GainLower = 19,
        LayerGaze = 32,
        LayerIdle = 33,
        LayerAsymmetry = 34,
        LayerNods = 35,
        LayerMood = 36,
        LayerFeet = 37,
    }

    /// <summary>Focus of the avatar's attention.</summary>
    public enum Attention : uint { Auto = 0, Idle = 1, Listening = 2, Thinking = 3, Speaking = 4 }

    /// <summary>The mood of face and posture.</summary>
    public enum Mood : uint { Neutral = 0, Joy = 1, Sad = 2, Angry = 3, Surprised = 4, Disgusted = 5, Afraid = 6 }

    /// <summary>A sound that is visible on the lips: p, b, m; f, v; w and rounded vowels.</summary>
    public enum LipShape : uint { Closed = 0, Teeth = 1, Round = 2 }

    /// <summary>When the mouth moves: together with the body, or as the sound is heard.</summary>
    public enum Voice : uint { Delayed = 0, Live = 1 }

    /// <summary>Whether chunks are output as packets, frames or both.</summary>
    public enum Packets : uint { None = 0, BesideFrames = 1, Only = 2 }

    /// <summary>The hand that performs a gesture.</summary>
    public enum Side : uint { Auto = 0, Left = 1, Right = 2, Both = 3 }

    /// <summary>Parts that a gesture moves.</summary>
    [Flags]
    public enum Gesture : uint { Head = 1, Trunk = 2, LeftArm = 4, RightArm = 8 }

    [StructLayout(LayoutKind.Sequential)]
    public struct Jobs
    {
        public IntPtr Userdata;
        /// <summary>A <see cref="JobsSubmit"/>.</summary>
        public IntPtr Submit;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Log
    {
        public IntPtr Userdata;
        /// <summary>A <see cref="LogWrite"/>.</summary>
        public IntPtr Write;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Allocator
    {
        public IntPtr Userdata;
        /// <summary>An <see cref="AllocatorAllocate"/>.</summary>
        public IntPtr Allocate;
        /// <summary>An <see cref="AllocatorRelease"/>.</summary>
        public IntPtr Release;
    }

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void JobsSubmit(IntPtr userdata, IntPtr job, IntPtr context);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void LogWrite(IntPtr userdata, LogLevel level, IntPtr message);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate IntPtr AllocatorAllocate(IntPtr userdata, UIntPtr size, UIntPtr alignment);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void AllocatorRelease(IntPtr userdata, IntPtr memory, UIntPtr size, UIntPtr alignment);

    /// <summary>Settings for loading a model. Start with <see cref="Model.Defaults"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ModelConfig
    {
        public uint StructSize;
        public Precision Precision;
        public Isa Isa;
        public uint Reserved;
        /// <summary>A <see cref="Umo.Log"/>, or zero.</summary>
        public IntPtr Log;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ModelInfo
    {
        public uint StructSize;
        public uint FrameRate;
        public uint SampleRate;
        public uint Joints;
        public uint Channels;
        public uint IsArkit;
        public uint KeyframeStride;
        public uint Target;
        public uint MaxTarget;
        public uint Lookahead;
        public uint LatencyFrames;
        public uint MaxPrompt;
        public uint HasText;
        public uint HasNotice;
        public ulong FileSize;
        public uint HasMouth;
        public uint MaxHorizon;
    }

    /// <summary>Settings of an engine. Start with <see cref="Engine.Defaults"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct EngineConfig
    {
        public uint StructSize;
        public EngineMode Mode;
        public uint Threads;
        public uint MaxSessions;
        public uint MaxBatch;
        public uint CoreCount;
        /// <summary>uint[CoreCount], or zero.</summary>
        public IntPtr Cores;
        /// <summary>A <see cref="Umo.Jobs"/>, or zero.</summary>
        public IntPtr Jobs;
        /// <summary>A <see cref="Umo.Log"/>, or zero.</summary>
        public IntPtr Log;
        public Priority Priority;
        /// <summary>
        /// Batching window: the longest time that a chunk waits for others to be computed with it, milliseconds; 0
        /// disables batching delays.
        /// </summary>
        public uint GatherMs;
    }

    /// <summary>Settings of a session. Start with <see cref="Session.Defaults"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SessionConfig
    {
        public uint StructSize;
        public uint SampleRate;
        public uint Channels;
        public uint Target;
        public uint Lookahead;
        public Idle Idle;
        public uint IdleAfterMs;
        public uint EaseMs;
        public uint QueueFrames;
        public Voice Voice;
        public ulong Seed;
        /// <summary>UTF-8 with a terminating zero byte, or zero. The session's constructor takes a string instead.</summary>
        public IntPtr TemplateName;
        /// <summary>An <see cref="Umo.Allocator"/>, or zero.</summary>
        public IntPtr Allocator;
        /// <summary>Low-pass filter of the body's motion, standard deviation in frames, 0 to 1.5; 0 leaves the motion unfiltered.</summary>
        public float Smoothing;
        /// <summary>Guidance strength of the prompt, 1 to 3, for models of layout `frames`; else 1.</summary>
        public float Guidance;
        /// <summary>Keyframes of audio beyond a chunk's end that it waits for, for models with lookahead audio; else 0.</summary>
        public uint Horizon;
        public Packets Packets;
        /// <summary>Keyframes before its chunk that a packet repeats.</summary>
        public uint PacketHistory;
        /// <summary>For decoders: number of later packets that may arrive before a missing one counts as lost, 0 to 4.</summary>
        public uint Patience;
    }

    /// <summary>Layout of the values of a frame. Start with <see cref="Model.Layout"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct FrameLayout
    {
        public uint StructSize;
        public Axes Axes;
        public uint FrameStride;
        public uint Index;
        public uint Sample;
        public uint Translation;
        public uint Rotations;
        public uint RotationStride;
        public uint Channels;
        public uint ChannelStride;
        public uint Visemes;
        public uint Reserved;
    }

    /// <summary>Options of a gesture. Start with <see cref="Session.GestureDefaults"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct GestureOptions
    {
        public uint StructSize;
        public Side Side;
        public Axes Axes;
        public uint HasTarget;
        /// <summary>Motion time of the stroke in seconds; negative: as soon as possible.</summary>
        public double At;
        public float Speed;
        public float Strength;
        /// <summary>x, y, z.</summary>
        public fixed float Target[3];
        public uint Reserved;

        /// <summary>Sets the point that the gesture points at.</summary>
        public void PointAt(Axes axes, float x, float y, float z)
        {
            Axes = axes;
            HasTarget = 1;
            fixed (float* target = Target)
            {
                target[0] = x;
                target[1] = y;
                target[2] = z;
            }
        }
    }

    /// <summary>Clip to add as a gesture: <see cref="Engine.AddGesture"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct GestureClip
    {
        public uint StructSize;
        public Axes Axes;
        public Gesture Parts;
        public uint FrameCount;
        public float Rate;
        public float Stroke;
        /// <summary>float[FrameCount][JointCount][4].</summary>
        public IntPtr Rotations;
    }

    /// <summary>Frames to write as a file: <see cref="Frames.WriteFile"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Clip
    {
        public uint StructSize;
        public uint IsArkit;
        public uint ChannelCount;
        public uint FrameCount;
        public float Rate;
        public uint Reserved;
        /// <summary>UTF-8 texts, one per channel.</summary>
        public IntPtr Channels;
        /// <summary>int[JointCount].</summary>
        public IntPtr Parents;
        /// <summary>float[JointCount][3].</summary>
        public IntPtr Offsets;
        /// <summary>A <see cref="FrameLayout"/>.</summary>
        public IntPtr Layout;
        public IntPtr Frames;
        /// <summary>UTF-8; null for bones without a mesh.</summary>
        public IntPtr Figure;
    }

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public unsafe delegate int OutputWrite(IntPtr userdata, void* bytes, UIntPtr size);

    [StructLayout(LayoutKind.Sequential)]
    public struct Output
    {
        public IntPtr Userdata;
        /// <summary>An <see cref="OutputWrite"/>.</summary>
        public IntPtr Write;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ParameterInfo
    {
        public uint StructSize;
        public Parameter Id;
        public uint Flags;
        public uint Reserved;
        public double Minimum;
        public double Maximum;
        /// <summary>Static UTF-8: <see cref="Native.Text"/>.</summary>
        public IntPtr Name;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Sampled
    {
        public uint StructSize;
        public uint IsAhead;
        public double Oldest;
        public double Newest;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Latency
    {
        public uint StructSize;
        public uint Reserved;
        public ulong AlgorithmicSamples;
        public double ComputeP50;
        public double ComputeP99;
        public double ComputeP999;
        public double ComputeMax;
        public ulong BacklogSamples;
        public ulong BacklogMaxSamples;
        public ulong MouthSamples;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Stats
    {
        public uint StructSize;
        public uint Reserved;
        public ulong Chunks;
        public ulong Frames;
        public ulong LateFrames;
        public ulong DroppedFrames;
        public ulong Overruns;
        public ulong Silenced;
        public ulong HeldChunks;
    }

    /// <summary>Statistics of a decoder's packets.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Received
    {
        public uint StructSize;
        public uint Reserved;
        public ulong Packets;
        public ulong Late;
        public ulong Lost;
        public ulong Held;
    }
}
