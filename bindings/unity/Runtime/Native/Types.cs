// SPDX-License-Identifier: MIT OR Apache-2.0
// The constants and structures of umo.h, under their own names in C#'s spelling: umo.h says what each means.
// tests/ holds every number and every field's place to what a C compiler makes of umo.h.

using System;
using System.Runtime.InteropServices;

namespace Umo
{
    /// <summary>What a call came to: Ok, or below zero what went wrong.</summary>
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

    /// <summary>Which way is up, which hand, how long a unit is.</summary>
    public enum Axes : uint { Gltf = 0, Unreal = 1, Unity = 2 }

    /// <summary>Files of frames: <see cref="Frames.WriteFile"/>.</summary>
    public enum FileFormat : uint { Glb = 1, Vrma = 2 }

    /// <summary>Who computes: the engine's own threads, or whoever calls Poll.</summary>
    public enum EngineMode : uint { Threads = 0, Polled = 1 }

    /// <summary>Priority of an engine's own threads. Where the system refuses it they are Normal.</summary>
    public enum Priority : uint { Normal = 0, High = 1, Low = 2 }

    public enum LogLevel : uint { Info = 1, Warning = 2, Error = 3 }

    public enum Precision : uint { Stored = 0, F32 = 1, Bf16 = 2, Int8 = 3 }

    /// <summary>The fastest instructions that may be used.</summary>
    public enum Isa : uint
    {
        Best = 0, Scalar = 1, Avx2 = 2, Avx512vnni = 3, Amx = 4, Avx512bf16 = 5, Avxvnni = 6,
        Neon = 7, NeonDotprod = 8, NeonI8mm = 9
    }

    /// <summary>A text that a model has.</summary>
    public enum ModelText : uint { Name = 1, License = 2, Notice = 3, Isa = 4 }

    /// <summary>What is shown while no audio comes.</summary>
    public enum Idle : uint { Hold = 0, Rest = 1, Live = 2 }

    /// <summary>What can be set while a session runs.</summary>
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

    /// <summary>What the avatar attends to.</summary>
    public enum Attention : uint { Auto = 0, Idle = 1, Listening = 2, Thinking = 3, Speaking = 4 }

    /// <summary>The mood of face and posture.</summary>
    public enum Mood : uint { Neutral = 0, Joy = 1, Sad = 2, Angry = 3, Surprised = 4, Disgusted = 5, Afraid = 6 }

    /// <summary>A sound that one sees on the lips: p, b, m; f, v; w and rounded vowels.</summary>
    public enum LipShape : uint { Closed = 0, Teeth = 1, Round = 2 }

    /// <summary>When the mouth moves: with the body, or as the sound is heard.</summary>
    public enum Voice : uint { Delayed = 0, Live = 1 }

    /// <summary>Whether chunks are given as packets, and as frames.</summary>
    public enum Packets : uint { None = 0, BesideFrames = 1, Only = 2 }

    /// <summary>Which hand does a gesture.</summary>
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

    /// <summary>How a model is loaded. Start with <see cref="Model.Defaults"/>.</summary>
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

    /// <summary>What an engine is made with. Start with <see cref="Engine.Defaults"/>.</summary>
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
        /// <summary>The longest that a chunk waits for others, to be computed together, milliseconds; 0: none waits.</summary>
        public uint GatherMs;
    }

    /// <summary>What a session is made with. Start with <see cref="Session.Defaults"/>.</summary>
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
        /// <summary>UTF-8 that ends with a zero byte, or zero: the session's constructor takes a string.</summary>
        public IntPtr TemplateName;
        /// <summary>An <see cref="Umo.Allocator"/>, or zero.</summary>
        public IntPtr Allocator;
        /// <summary>Low-pass of the body's motion, standard deviation in frames, 0 to 1.5; 0 is the model's own motion.</summary>
        public float Smoothing;
        /// <summary>How strongly the prompt steers, 1 to 3, for models of layout `frames`; else 1.</summary>
        public float Guidance;
        /// <summary>Keyframes of audio behind a chunk that it waits for, for models that hear ahead; else 0.</summary>
        public uint Horizon;
        public Packets Packets;
        /// <summary>Keyframes before those of its chunk that a packet says again.</summary>
        public uint PacketHistory;
        /// <summary>Of a decoder: packets that may come before one that is missing counts as lost, 0 to 4.</summary>
        public uint Patience;
    }

    /// <summary>Where a frame's values go. Start with <see cref="Model.Layout"/>.</summary>
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

    /// <summary>How a gesture is played. Start with <see cref="Session.GestureDefaults"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct GestureOptions
    {
        public uint StructSize;
        public Side Side;
        public Axes Axes;
        public uint HasTarget;
        /// <summary>Seconds of the motion at which the stroke falls; negative: as soon as possible.</summary>
        public double At;
        public float Speed;
        public float Strength;
        /// <summary>x, y, z.</summary>
        public fixed float Target[3];
        public uint Reserved;

        /// <summary>Gives the gesture a place to point at.</summary>
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

    /// <summary>A clip that becomes a gesture: <see cref="Engine.AddGesture"/>.</summary>
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

    /// <summary>Frames that become a file: <see cref="Frames.WriteFile"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Clip
    {
        public uint StructSize;
        public uint IsArkit;
        public uint ChannelCount;
        public uint FrameCount;
        public float Rate;
        public uint Reserved;
        /// <summary>UTF-8 texts, one a channel.</summary>
        public IntPtr Channels;
        /// <summary>int[JointCount].</summary>
        public IntPtr Parents;
        /// <summary>float[JointCount][3].</summary>
        public IntPtr Offsets;
        /// <summary>A <see cref="FrameLayout"/>.</summary>
        public IntPtr Layout;
        public IntPtr Frames;
        /// <summary>UTF-8; null: the bones alone.</summary>
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

    /// <summary>What came of a decoder's packets.</summary>
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
