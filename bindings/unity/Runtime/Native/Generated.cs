// SPDX-License-Identifier: MIT OR Apache-2.0
// Generated from umo-capi/src by umo-capi/header: change it there.

using System;
using System.Runtime.InteropServices;

namespace Umo
{
    public static unsafe partial class Native
    {
        /// <summary>
        /// Version of this interface: major number in the upper 16 bits, minor number in the lower. A library serves
        /// programs with the same major number and at most its own minor number.
        /// </summary>
        public const uint AbiVersion = 1;
        /// <summary>Offset meaning: do not write this field.</summary>
        public const uint Absent = 4294967295;
        /// <summary>Visemes per frame.</summary>
        public const int VisemeCount = 15;
        /// <summary>Joints of every model.</summary>
        public const int JointCount = 55;
        /// <summary>The parameter takes only whole numbers.</summary>
        public const uint ParameterWhole = 1;
        /// <summary>Maximum length in bytes of a self-test's report, including its terminating zero.</summary>
        public const int SelfTestSize = 8192;
        /// <summary>Maximum length in bytes of an error's detail, including its terminating zero.</summary>
        public const int ErrorSize = 512;
        /// <summary>Upper bound on the members of a scene.</summary>
        public const int SceneMemberCount = 32;
    }

    /// <summary>Result of a call: OK, or a negative error code.</summary>
    public enum Status : int
    {
        /// <summary>Success.</summary>
        Ok = 0,
        /// <summary>A required pointer is NULL.</summary>
        NullPointer = -1,
        /// <summary>A handle is unknown, freed, or of another kind.</summary>
        InvalidHandle = -2,
        /// <summary>An argument is out of range.</summary>
        InvalidArgument = -3,
        /// <summary>Unknown struct_size: call the structure's initializer, or set it to sizeof.</summary>
        StructSize = -4,
        /// <summary>A buffer is too small for the output.</summary>
        BufferTooSmall = -5,
        /// <summary>The program was compiled with the header of an incompatible version.</summary>
        Version = -6,
        /// <summary>A file cannot be read or written.</summary>
        Io = -7,
        /// <summary>The file is not a usable model.</summary>
        Model = -8,
        /// <summary>There is not enough memory, or the host's allocator returned NULL.</summary>
        OutOfMemory = -9,
        /// <summary>No free slot: free a model, an engine or a session first.</summary>
        Full = -10,
        /// <summary>Another thread is in a call that excludes this one: call again. Nothing was done.</summary>
        Busy = -11,
        /// <summary>Audio was pushed after umo_session_finish: reset or interrupt the session first.</summary>
        Finished = -12,
        /// <summary>The session's computation failed: it gives no more frames. Free it.</summary>
        Failed = -13,
        /// <summary>The session's engine was freed: it gives no more frames. Free it.</summary>
        Closed = -14,
        /// <summary>
        /// A panic of this library was caught, without output; the session concerned cannot be used any more. Free it,
        /// and report the defect: umo_session_last_error (or umo_last_error) has the panic's message and its place in the
        /// source.
        /// </summary>
        Panic = -15,
        /// <summary>This model, processor or engine cannot do that.</summary>
        Unsupported = -16,
        /// <summary>The bytes are not a state of a session with this configuration. Nothing was changed.</summary>
        State = -17,
        /// <summary>A worker thread could not be created or pinned.</summary>
        Thread = -18,
        /// <summary>The bytes are not a packet for this decoder. Nothing was changed.</summary>
        Packet = -19,
        /// <summary>The bytes are not a take, or a damaged one.</summary>
        Take = -20,
    }

    /// <summary>Axes, handedness and unit of length.</summary>
    public enum Axes : uint
    {
        /// <summary>glTF and Godot: Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X.</summary>
        Gltf = 0,
        /// <summary>Unreal: Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.</summary>
        Unreal = 1,
        /// <summary>Unity: Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X.</summary>
        Unity = 2,
    }

    /// <summary>Threads that compute: the engine's own, or the host's.</summary>
    public enum EngineMode : uint
    {
        /// <summary>The engine computes on its own threads.</summary>
        Threads = 0,
        /// <summary>The host computes by calling umo_engine_poll.</summary>
        Polled = 1,
    }

    /// <summary>Priority of an engine's own threads.</summary>
    public enum Priority : uint
    {
        /// <summary>Default priority of the process's new threads.</summary>
        Normal = 0,
        /// <summary>
        /// Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux refuses it
        /// to most users; Windows, Android and Apple's systems grant it.
        /// </summary>
        High = 1,
        /// <summary>Priority below normal: threads use the time that others leave.</summary>
        Low = 2,
    }

    /// <summary>Kinds of cores that an engine's own threads run on.</summary>
    public enum CoreKinds : uint
    {
        /// <summary>
        /// On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together; what one
        /// slower core computes with room to spare, on that core, unless the priority is high.
        /// </summary>
        Auto = 0,
        /// <summary>Threads run wherever the system puts them.</summary>
        System = 1,
        /// <summary>The fastest kind of cores alone.</summary>
        Performance = 2,
        /// <summary>The slowest kind of cores that is not low-power, alone.</summary>
        Efficiency = 3,
    }

    /// <summary>Networks of a model to load.</summary>
    public enum ModelParts : uint
    {
        /// <summary>All networks of the model.</summary>
        All = 0,
        /// <summary>
        /// The live mouth alone, at its stored precision: a fraction of the memory. Sessions need Voice.Mouth, and
        /// engines have no threads.
        /// </summary>
        Mouth = 1,
    }

    /// <summary>Hand of a gesture.</summary>
    public enum Side : uint
    {
        /// <summary>The right hand; for a gesture with a target, the hand nearer to it.</summary>
        Auto = 0,
        /// <summary>The left hand: the whole gesture is mirrored.</summary>
        Left = 1,
        /// <summary>The right hand.</summary>
        Right = 2,
        /// <summary>Both hands if the gesture supports it, otherwise as Side.Auto.</summary>
        Both = 3,
    }

    /// <summary>Parts of the body that a gesture moves.</summary>
    [Flags]
    public enum Gesture : uint
    {
        /// <summary>Neck and head.</summary>
        Head = 1,
        /// <summary>Spine.</summary>
        Trunk = 2,
        /// <summary>Left arm, from collar to fingers.</summary>
        LeftArm = 4,
        /// <summary>Right arm, from collar to fingers.</summary>
        RightArm = 8,
    }

    /// <summary>Level of a log message.</summary>
    public enum LogLevel : uint
    {
        /// <summary>Log level: information.</summary>
        Info = 1,
        /// <summary>Log level: warning.</summary>
        Warning = 2,
        /// <summary>Log level: error.</summary>
        Error = 3,
    }

    /// <summary>Precision of a model's weights.</summary>
    public enum Precision : uint
    {
        /// <summary>Weights as stored in the file.</summary>
        Stored = 0,
        /// <summary>All products in f32.</summary>
        F32 = 1,
        /// <summary>Weights rounded to bfloat16.</summary>
        Bf16 = 2,
        /// <summary>Weights rounded to int8.</summary>
        Int8 = 3,
    }

    /// <summary>Upper bound on the instruction set.</summary>
    public enum Isa : uint
    {
        /// <summary>The fastest instruction set of the processor.</summary>
        Best = 0,
        /// <summary>Portable code.</summary>
        Scalar = 1,
        /// <summary>At most AVX2.</summary>
        Avx2 = 2,
        /// <summary>At most AVX-512 with VNNI.</summary>
        Avx512vnni = 3,
        /// <summary>At most AMX.</summary>
        Amx = 4,
        /// <summary>At most AVX-512 with VNNI and products of bfloat16.</summary>
        Avx512bf16 = 5,
        /// <summary>At most AVX2 with VNNI.</summary>
        Avxvnni = 6,
        /// <summary>At most NEON, on 64-bit Arm.</summary>
        Neon = 7,
        /// <summary>At most NEON with dot products of int8.</summary>
        NeonDotprod = 8,
        /// <summary>At most NEON with dot products and matrix products of int8.</summary>
        NeonI8mm = 9,
        /// <summary>
        /// Added to one of the others: the same bits on every processor, from the same sound. docs/packets.md says when
        /// it pays.
        /// </summary>
        Portable = 256,
    }

    /// <summary>Text of a model.</summary>
    public enum ModelText : uint
    {
        /// <summary>Name of the model.</summary>
        Name = 1,
        /// <summary>Licence of its weights.</summary>
        License = 2,
        /// <summary>Notice that must be shown to users; may be empty.</summary>
        Notice = 3,
        /// <summary>Instruction set that the model was packed for, such as avx512vnni.</summary>
        Isa = 4,
        /// <summary>Prompts that the model was trained with, one a line; empty if it has no list.</summary>
        Prompts = 5,
    }

    /// <summary>Parameter of a running session.</summary>
    public enum Parameter : uint
    {
        /// <summary>Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was tuned for.</summary>
        Temperature = 1,
        /// <summary>Top-k sampling: number of the likeliest codes to sample from; 0 for all.</summary>
        TopK = 2,
        /// <summary>Top-p sampling: samples from the likeliest codes that together reach this probability.</summary>
        TopP = 3,
        /// <summary>Idle mode, while no audio comes: one of Idle.</summary>
        Idle = 4,
        /// <summary>Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated.</summary>
        GainFace = 16,
        /// <summary>Gain of the fingers' motion.</summary>
        GainHands = 17,
        /// <summary>Gain of the motion of spine, neck, head and arms.</summary>
        GainUpper = 18,
        /// <summary>Gain of the motion of pelvis and legs, and of the body through the world.</summary>
        GainLower = 19,
        /// <summary>Attention of the avatar: one of Attention.</summary>
        Attention = 5,
        /// <summary>
        /// Delay of the output device in seconds, from playing a sound to hearing it: umo_session_sample_pose shows a
        /// pose that much earlier. 0 to 2; some 0.2 for Bluetooth.
        /// </summary>
        OutputDelay = 6,
        /// <summary>
        /// Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest, at 0
        /// hardly rise.
        /// </summary>
        Activity = 7,
        /// <summary>
        /// Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0 ignores the
        /// voice.
        /// </summary>
        Expression = 8,
        /// <summary>Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1.</summary>
        LayerGaze = 32,
        /// <summary>Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures.</summary>
        LayerIdle = 33,
        /// <summary>Strength of the asymmetry between the face's left and right.</summary>
        LayerAsymmetry = 34,
        /// <summary>Strength of nods on accents, and while listening.</summary>
        LayerNods = 35,
        /// <summary>Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood asked for.</summary>
        LayerMood = 36,
        /// <summary>Strength of planted feet, steps, and the root's return to where it stood.</summary>
        LayerFeet = 37,
        /// <summary>Strength of trunk, shoulders and legs that go with the hands.</summary>
        LayerBody = 38,
    }

    /// <summary>Attention of the avatar.</summary>
    public enum Attention : uint
    {
        /// <summary>
        /// Speaking while its own audio is heard, otherwise idle; in a scene, and after umo_session_push_other_audio,
        /// also listening.
        /// </summary>
        Auto = 0,
        /// <summary>Nothing in particular.</summary>
        Idle = 1,
        /// <summary>The one who speaks: the avatar looks there, nods, and raises its brows.</summary>
        Listening = 2,
        /// <summary>An answer to give: the avatar looks away.</summary>
        Thinking = 3,
        /// <summary>Its own speech.</summary>
        Speaking = 4,
    }

    /// <summary>Mood of face and posture.</summary>
    public enum Mood : uint
    {
        /// <summary>No mood: the model's face without its frown.</summary>
        Neutral = 0,
        /// <summary>Joy.</summary>
        Joy = 1,
        /// <summary>Sadness.</summary>
        Sad = 2,
        /// <summary>Anger.</summary>
        Angry = 3,
        /// <summary>Surprise.</summary>
        Surprised = 4,
        /// <summary>Disgust.</summary>
        Disgusted = 5,
        /// <summary>Fear.</summary>
        Afraid = 6,
    }

    /// <summary>Shape of the lips for a visible sound.</summary>
    public enum LipShape : uint
    {
        /// <summary>The lips meet: p, b, m.</summary>
        Closed = 0,
        /// <summary>The lower lip is at the upper teeth: f, v.</summary>
        Teeth = 1,
        /// <summary>The lips are rounded: w, and vowels such as that of "boot".</summary>
        Round = 2,
    }

    /// <summary>Behaviour while no audio comes.</summary>
    public enum Idle : uint
    {
        /// <summary>The last pose is held.</summary>
        Hold = 0,
        /// <summary>umo_session_sample_pose eases to the rest pose.</summary>
        Rest = 1,
        /// <summary>The model runs on silence.</summary>
        Live = 2,
    }

    /// <summary>Timing of the mouth, and whether there is a body.</summary>
    public enum Voice : uint
    {
        /// <summary>The mouth moves with the body, later than the sound by the session's latency.</summary>
        Delayed = 0,
        /// <summary>
        /// The mouth follows the sound after Latency.MouthSamples: with the default model 11 ms at 16 kHz, 18 ms at 48
        /// kHz. The body follows after the session's latency, and the stream has correspondingly more frames at its end.
        /// For a microphone, or a voice that is played as it arrives.
        /// </summary>
        Live = 1,
        /// <summary>
        /// The mouth alone, timed as with Voice.Live: no chunk is computed, and the engine has nothing to do. The body is
        /// at rest, with the layers over it: it breathes, looks, nods and gestures as asked. For voice chat; the one
        /// voice of a model loaded with ModelParts.Mouth.
        /// </summary>
        Mouth = 2,
    }

    /// <summary>Output of chunks as packets.</summary>
    public enum Packets : uint
    {
        /// <summary>Chunks are output as frames only.</summary>
        None = 0,
        /// <summary>Chunks are output as frames and as packets: pull both.</summary>
        BesideFrames = 1,
        /// <summary>Chunks are output as packets only, for a server whose avatars are shown elsewhere.</summary>
        Only = 2,
    }

    /// <summary>Parts that a scene plays of a member.</summary>
    [Flags]
    public enum ScenePart : uint
    {
        /// <summary>The member's looks: at whom, and away.</summary>
        Look = 1,
        /// <summary>Nods and raised brows of the member while it listens.</summary>
        Nod = 2,
        /// <summary>Half smiles of the member while it listens.</summary>
        Smile = 4,
        /// <summary>Lean and shifts of weight of the member, its own and those that follow another's.</summary>
        Mirror = 8,
        /// <summary>Giving way to who interrupts the member.</summary>
        Yield = 16,
    }

    /// <summary>What a member of a scene does.</summary>
    public enum Role : uint
    {
        /// <summary>Nobody speaks.</summary>
        Idle = 0,
        /// <summary>Another member speaks.</summary>
        Listening = 1,
        /// <summary>The member speaks.</summary>
        Speaking = 2,
    }

    /// <summary>Format of a file of frames.</summary>
    public enum FileFormat : uint
    {
        /// <summary>Binary glTF 2.0, .glb: a skinned figure, or the skeleton alone.</summary>
        Glb = 1,
        /// <summary>VRM Animation 1.0, .vrma, for any VRM avatar.</summary>
        Vrma = 2,
    }

    /// <summary>
    /// Submits a job. Called on the polling thread; must not wait for a job that runs on another thread, and must not
    /// throw.
    /// </summary>
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void JobsSubmit(IntPtr userdata, IntPtr job, IntPtr context);

    /// <summary>
    /// Lends the threads of the host's job system to an engine. Each umo_engine_poll calls Submit once for every
    /// compute thread except its own; the host then runs job(context) on another thread as soon as it can. The job
    /// computes until the poll is over and needs 1 MiB of stack. A job that runs late, or never, costs only speed. A
    /// job that runs after the engine was freed, or inside Submit, returns at once.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Jobs
    {
        /// <summary>Passed to Submit.</summary>
        public IntPtr Userdata;
        /// <summary>
        /// Submits a job. Called on the polling thread; must not wait for a job that runs on another thread, and must not
        /// throw. A JobsSubmit.
        /// </summary>
        public IntPtr Submit;
    }

    /// <summary>Receives one of LogLevel and a zero-terminated text, valid until it returns. Must not throw.</summary>
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void LogWrite(IntPtr userdata, LogLevel level, IntPtr message);

    /// <summary>
    /// A log callback. Called only by the functions that make and free models, engines and sessions or encode a text,
    /// on the calling thread; never by calls for the audio thread or the game thread, nor on the engine's threads.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Log
    {
        /// <summary>Passed to Write.</summary>
        public IntPtr Userdata;
        /// <summary>Receives one of LogLevel and a zero-terminated text, valid until it returns. Must not throw. A LogWrite.</summary>
        public IntPtr Write;
    }

    /// <summary>Configuration of an engine. Initialise it with umo_engine_config_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct EngineConfig
    {
        /// <summary>sizeof(EngineConfig).</summary>
        public uint StructSize;
        /// <summary>Threads that compute: one of EngineMode.</summary>
        public EngineMode Mode;
        /// <summary>
        /// Number of compute threads, 1 to 64. With EngineMode.Polled the polling thread is one of them, and the engine
        /// starts the others unless Jobs lends them.
        /// </summary>
        public uint Threads;
        /// <summary>Maximum number of sessions at once, 1 to 4,096.</summary>
        public uint MaxSessions;
        /// <summary>
        /// Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need more
        /// memory.
        /// </summary>
        public uint MaxBatch;
        /// <summary>Number of Cores, 0 to 64.</summary>
        public uint CoreCount;
        /// <summary>
        /// Processor numbers to pin the engine's own threads to, one thread each; threads beyond CoreCount are not
        /// pinned. NULL pins none. C: const uint32_t *.
        /// </summary>
        public IntPtr Cores;
        /// <summary>
        /// Lends the host's threads, which compute in place of the engine's own; or NULL. Only with EngineMode.Polled. C:
        /// const struct umo_jobs *.
        /// </summary>
        public IntPtr Jobs;
        /// <summary>Log callback for this engine and its sessions, or NULL. C: const struct umo_log *.</summary>
        public IntPtr Log;
        /// <summary>
        /// Priority of the engine's own threads: one of Priority. If the system refuses it, they run at Priority.Normal,
        /// and Log gets a warning that says what would permit it.
        /// </summary>
        public Priority Priority;
        /// <summary>
        /// Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms,
        /// 32 avatars take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at
        /// the start of a stream, once at most half of its length is left until it would be late, or if all sessions are
        /// due. 0: no chunk waits.
        /// </summary>
        public uint BatchWindowMs;
        /// <summary>
        /// Kinds of cores that the engine's own threads run on if CoreCount is 0: one of CoreKinds. All but
        /// CoreKinds.System start at most as many threads as the kind has cores. No effect where all cores are of one
        /// kind.
        /// </summary>
        public CoreKinds CoreKinds;
    }

    /// <summary>
    /// Layout of a frame in the host's memory: offsets in bytes from the frame's start. A value whose offset is
    /// Native.Absent is not written, and bytes between values are left alone, so that frames can be the host's own
    /// structures. Initialise it with umo_frame_layout_init. Offsets and strides are multiples of the values'
    /// alignment in C: 4, and for Index and Sample that of uint64_t, which then also applies to FrameStride. Values
    /// must not overlap, not even in one byte, but values of different kinds may be interleaved. A layout that breaks
    /// this is INVALID_ARGUMENT, and umo_last_error names the fields.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct FrameLayout
    {
        /// <summary>sizeof(FrameLayout).</summary>
        public uint StructSize;
        /// <summary>One of Axes.</summary>
        public Axes Axes;
        /// <summary>Bytes from one frame to the next, at least up to the end of the last value.</summary>
        public uint FrameStride;
        /// <summary>
        /// uint64_t: number of the frame since the start or the last reset; there are ModelInfo.FrameRate frames per
        /// second.
        /// </summary>
        public uint Index;
        /// <summary>uint64_t: sample of the pushed audio, counted per channel, that the frame belongs to.</summary>
        public uint Sample;
        /// <summary>
        /// float[3]: translation of the root, to be added to the first joint's offset in umo_model_get_skeleton. The
        /// floor is at 0 as in the model.
        /// </summary>
        public uint Translation;
        /// <summary>float[4] of the first joint: its rotation in its parent's frame, a unit quaternion x, y, z, w.</summary>
        public uint Rotations;
        /// <summary>Bytes from one joint's rotation to the next, at least 16.</summary>
        public uint RotationStride;
        /// <summary>float of the first face channel.</summary>
        public uint Channels;
        /// <summary>Bytes from one channel to the next, at least 4.</summary>
        public uint ChannelStride;
        /// <summary>float[UMO_VISEME_COUNT]: weights of the visemes; they sum to 1.</summary>
        public uint Visemes;
        /// <summary>Zero, as umo_frame_layout_init sets it: anything else is INVALID_ARGUMENT.</summary>
        public uint Reserved;
    }

    /// <summary>Playback options of a gesture. Initialise them with umo_gesture_options_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public unsafe partial struct GestureOptions
    {
        /// <summary>sizeof(GestureOptions).</summary>
        public uint StructSize;
        /// <summary>The hand: one of Side.</summary>
        public Side Side;
        /// <summary>Axes and units of Target: one of Axes.</summary>
        public Axes Axes;
        /// <summary>1 if Target is set, else 0.</summary>
        public uint HasTarget;
        /// <summary>
        /// Time of the stroke, in seconds of the motion; the preparation begins correspondingly earlier. Negative: as
        /// soon as no other gesture uses its parts.
        /// </summary>
        public double At;
        /// <summary>Playback speed, 0.5 to 2.</summary>
        public float Speed;
        /// <summary>Strength, 0 to 1: lower values stay closer to the model's motion.</summary>
        public float Strength;
        /// <summary>Point in the avatar's space, for pointing gestures; without one they point ahead.</summary>
        public fixed float Target[3];
        /// <summary>
        /// Variant, 0 to 255: 0 is the gesture as drawn; others go through its poses in turn, and each number has a size,
        /// height and speed of its own.
        /// </summary>
        public uint Variant;
    }

    /// <summary>A clip of the host's to make a gesture from. Initialise it with umo_gesture_clip_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct GestureClip
    {
        /// <summary>sizeof(GestureClip).</summary>
        public uint StructSize;
        /// <summary>Axes of the rotations: one of Axes.</summary>
        public Axes Axes;
        /// <summary>Parts of the body that it moves: a sum of Gesture. The position and walking of the body stay the model's.</summary>
        public Gesture Parts;
        /// <summary>Number of frames, 2 to 3,600.</summary>
        public uint FrameCount;
        /// <summary>Frames per second, 1 to 240.</summary>
        public float Rate;
        /// <summary>Seconds from the first frame to the stroke.</summary>
        public float Stroke;
        /// <summary>
        /// float[frame_count][UMO_JOINT_COUNT][4]: rotation of each joint in its parent's frame, a quaternion x, y, z, w;
        /// identity in all joints is a T-pose. Read during the call. C: const float *.
        /// </summary>
        public IntPtr Rotations;
    }

    /// <summary>Options for loading a model. Initialise them with umo_model_config_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct ModelConfig
    {
        /// <summary>sizeof(ModelConfig).</summary>
        public uint StructSize;
        /// <summary>One of Precision.</summary>
        public Precision Precision;
        /// <summary>
        /// Upper bound on the instruction set: one of Isa. Float products round differently on some of them, so a session
        /// can give other frames, unless Isa.Portable is added: docs/spec.md, section 2.9, says which give equal ones.
        /// </summary>
        public Isa Isa;
        /// <summary>Networks to load: one of ModelParts.</summary>
        public ModelParts Parts;
        /// <summary>
        /// Log callback for this model, or NULL. The structure is copied while the model is loaded. C: const struct
        /// umo_log *.
        /// </summary>
        public IntPtr Log;
    }

    /// <summary>Properties of a model. Set StructSize; umo_model_get_info writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct ModelInfo
    {
        /// <summary>sizeof(ModelInfo).</summary>
        public uint StructSize;
        /// <summary>Frames per second: 30.</summary>
        public uint FrameRate;
        /// <summary>Sample rate of the model's input in Hz; sessions take any rate and resample.</summary>
        public uint SampleRate;
        /// <summary>Joints of the body: the 55 of SMPL-X.</summary>
        public uint Joints;
        /// <summary>Face channels.</summary>
        public uint Channels;
        /// <summary>1 if face channels are the 52 ARKit blendshapes, 0 to 1; 0 if they are SMPL-X expression coefficients.</summary>
        public uint IsArkit;
        /// <summary>Frames from one keyframe to the next.</summary>
        public uint KeyframeStride;
        /// <summary>Keyframes predicted per chunk by default.</summary>
        public uint Target;
        /// <summary>Maximum number of keyframes per chunk.</summary>
        public uint MaxTarget;
        /// <summary>Frames held back by default.</summary>
        public uint Lookahead;
        /// <summary>Frames of future speech that a frame needs at most, with the default configuration.</summary>
        public uint LatencyFrames;
        /// <summary>Maximum number of ids in a prompt.</summary>
        public uint MaxPrompt;
        /// <summary>1 if texts can be prompts, so that umo_session_set_prompt works.</summary>
        public uint HasText;
        /// <summary>1 if ModelText.Notice must be shown to users: for example, that the model was never trained.</summary>
        public uint HasNotice;
        /// <summary>Size of the model file in bytes.</summary>
        public ulong FileSize;
        /// <summary>1 if the model has a mouth network, so that sessions can use Voice.Live and Voice.Mouth.</summary>
        public uint HasMouth;
        /// <summary>
        /// Upper bound on SessionConfig.Horizon: keyframes of audio behind a chunk that a session can wait for. Useful if
        /// the whole recording is available. 0 if the model does not hear ahead.
        /// </summary>
        public uint MaxHorizon;
    }

    /// <summary>Description of a parameter. Set StructSize; umo_parameter_get_info writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct ParameterInfo
    {
        /// <summary>sizeof(ParameterInfo).</summary>
        public uint StructSize;
        /// <summary>Number of the parameter, Parameter.</summary>
        public Parameter Id;
        /// <summary>Native.ParameterWhole or 0.</summary>
        public uint Flags;
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>Smallest value.</summary>
        public double Minimum;
        /// <summary>Largest value.</summary>
        public double Maximum;
        /// <summary>Name of the parameter: static. C: const char *.</summary>
        public IntPtr Name;
    }

    /// <summary>Returns size bytes aligned to alignment, a power of two, or NULL.</summary>
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate IntPtr AllocatorAllocate(IntPtr userdata, UIntPtr size, UIntPtr alignment);

    /// <summary>Releases memory from Allocate.</summary>
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate void AllocatorRelease(IntPtr userdata, IntPtr memory, UIntPtr size, UIntPtr alignment);

    /// <summary>
    /// Allocator for a session's memory. Both functions are required. They are called by umo_session_new, by
    /// umo_session_free and, if a session was freed while a chunk of it was being computed, by the next call of
    /// either or umo_engine_free; always on the thread of that call. They must not throw, nor call functions of this
    /// library.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Allocator
    {
        /// <summary>Passed to both functions.</summary>
        public IntPtr Userdata;
        /// <summary>Returns size bytes aligned to alignment, a power of two, or NULL. A AllocatorAllocate.</summary>
        public IntPtr Allocate;
        /// <summary>Releases memory from Allocate. A AllocatorRelease.</summary>
        public IntPtr Release;
    }

    /// <summary>Configuration of a session. Initialise it with umo_session_config_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct SessionConfig
    {
        /// <summary>sizeof(SessionConfig).</summary>
        public uint StructSize;
        /// <summary>Sample rate of the pushed audio in Hz, 8,000 to 192,000.</summary>
        public uint SampleRate;
        /// <summary>Interleaved channels of the pushed audio, 1 to 64; they are mixed.</summary>
        public uint Channels;
        /// <summary>
        /// Keyframes predicted per chunk, 1 to ModelInfo.MaxTarget: fewer respond sooner, more give each chunk more
        /// context.
        /// </summary>
        public uint Target;
        /// <summary>Frames held back until the next chunk, for smoother seams; they add to the latency.</summary>
        public uint Lookahead;
        /// <summary>Behaviour during silence: one of Idle.</summary>
        public Idle Idle;
        /// <summary>Milliseconds without audio after which Idle begins.</summary>
        public uint IdleAfterMs;
        /// <summary>Duration in milliseconds of the ease to rest, and of the way back.</summary>
        public uint EaseMs;
        /// <summary>Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full.</summary>
        public uint QueueFrames;
        /// <summary>Timing of the mouth, and whether there is a body: one of Voice.</summary>
        public Voice Voice;
        /// <summary>Seed of all sampling: equal seeds and audio give equal frames.</summary>
        public ulong Seed;
        /// <summary>
        /// Template of the model: NULL for audio_to_motion; text_to_motion needs no audio. For the latter, umo text uses
        /// a Guidance of 2.5 and a temperature of at most 0.7 (Parameter.Temperature); the defaults here are for speech.
        /// C: const char *.
        /// </summary>
        public IntPtr TemplateName;
        /// <summary>
        /// Allocator of the session's memory, or NULL for the system's. Read while the session is made; its functions and
        /// userdata must stay valid until the engine is freed. C: const struct umo_allocator *.
        /// </summary>
        public IntPtr Allocator;
        /// <summary>
        /// Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If Lookahead is
        /// less, it looks two standard deviations ahead, 3 frames at most.
        /// </summary>
        public float Smoothing;
        /// <summary>
        /// Strength of the prompt's guidance, 1 to 3, for models of layout frames: 1 uses the prompt alone, at half the
        /// cost of other values. Other models: 1.
        /// </summary>
        public float Guidance;
        /// <summary>
        /// Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead; they add
        /// to the latency. Otherwise 0.
        /// </summary>
        public uint Horizon;
        /// <summary>Output of chunks as packets: one of Packets.</summary>
        public Packets Packets;
        /// <summary>
        /// Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's worth of
        /// them, the loss of one packet changes nothing.
        /// </summary>
        public uint PacketHistory;
        /// <summary>Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4.</summary>
        public uint ReorderWindow;
        /// <summary>
        /// Bytes of memory for a take that is recorded while the session runs (umo_session_take), some 700 a second; 0
        /// for none. Not with Voice.Live, Voice.Mouth, Packets.Only or decoders.
        /// </summary>
        public ulong TakeBytes;
    }

    /// <summary>Range of times available to umo_session_sample_pose. Set StructSize; the call writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Sampled
    {
        /// <summary>sizeof(Sampled).</summary>
        public uint StructSize;
        /// <summary>1 if the requested time was later than the newest frame.</summary>
        public uint IsAhead;
        /// <summary>Time in seconds of the oldest frame that is still available.</summary>
        public double Oldest;
        /// <summary>Time in seconds of the newest frame that is ready.</summary>
        public double Newest;
    }

    /// <summary>Delay of motion behind speech. Set StructSize; umo_session_latency writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Latency
    {
        /// <summary>sizeof(Latency).</summary>
        public uint StructSize;
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>
        /// Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor can shorten
        /// it. It follows from the configuration's target, lookahead, smoothing, horizon and sample_rate.
        /// </summary>
        public ulong AlgorithmicSamples;
        /// <summary>
        /// Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk if that is
        /// later, to the chunk's frames.
        /// </summary>
        public double ComputeP50;
        /// <summary>99th percentile of the computing time.</summary>
        public double ComputeP99;
        /// <summary>99.9th percentile of the computing time.</summary>
        public double ComputeP999;
        /// <summary>Largest computing time.</summary>
        public double ComputeMax;
        /// <summary>
        /// Current delay of the newest frame behind the newest audio, beyond AlgorithmicSamples, in samples at the
        /// session's rate: 0 while the engine keeps up.
        /// </summary>
        public ulong BacklogSamples;
        /// <summary>The largest backlog since the session was made.</summary>
        public ulong BacklogMaxSamples;
        /// <summary>
        /// Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
        /// AlgorithmicSamples, or less with Voice.Live.
        /// </summary>
        public ulong MouthSamples;
    }

    /// <summary>Statistics of a session. Set StructSize; umo_session_stats writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Stats
    {
        /// <summary>sizeof(Stats).</summary>
        public uint StructSize;
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>Chunks computed.</summary>
        public ulong Chunks;
        /// <summary>Frames computed.</summary>
        public ulong Frames;
        /// <summary>Frames whose chunk was computed too late for real time.</summary>
        public ulong LateFrames;
        /// <summary>Frames that an interrupt or a reset dropped before they were shown.</summary>
        public ulong DroppedFrames;
        /// <summary>Samples per channel that were not taken because there was no room.</summary>
        public ulong Overruns;
        /// <summary>Samples that were NaN, infinite or beyond 1e6, and were replaced by silence.</summary>
        public ulong Silenced;
        /// <summary>Chunks whose body was held because the engine did not keep up (umo_engine_set_late_limit).</summary>
        public ulong HeldChunks;
    }

    /// <summary>Statistics of a decoder's packets. Set StructSize; umo_decoder_stats writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Received
    {
        /// <summary>sizeof(Received).</summary>
        public uint StructSize;
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>Packets accepted.</summary>
        public ulong Packets;
        /// <summary>Packets that arrived too late or a second time and were ignored.</summary>
        public ulong Late;
        /// <summary>Chunks whose packet did not arrive in time.</summary>
        public ulong Lost;
        /// <summary>Keyframes of lost chunks that no other packet repeated, so that the last pose was held.</summary>
        public ulong Held;
    }

    /// <summary>Properties of a take. Set StructSize; umo_take_get_info writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct TakeInfo
    {
        /// <summary>sizeof(TakeInfo).</summary>
        public uint StructSize;
        /// <summary>Version of its format.</summary>
        public uint Version;
        /// <summary>Frames.</summary>
        public uint Frames;
        /// <summary>Frames per second.</summary>
        public uint FrameRate;
        /// <summary>Packets.</summary>
        public uint Packets;
        /// <summary>Sample rate of the host's audio in Hz: that of a frame's sample while the take plays.</summary>
        public uint SampleRate;
        /// <summary>Seed of all sampling.</summary>
        public ulong Seed;
        /// <summary>Fingerprint of the model.</summary>
        public ulong Model;
        /// <summary>
        /// Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at the model's
        /// rate.
        /// </summary>
        public ulong Audio;
        /// <summary>Number of those samples.</summary>
        public ulong AudioSamples;
        /// <summary>Fingerprint of the word rules.</summary>
        public ulong Rules;
    }

    /// <summary>Where a member stands. Initialise it with umo_place_init.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public unsafe partial struct Place
    {
        /// <summary>sizeof(Place).</summary>
        public uint StructSize;
        /// <summary>Axes and units of the fields below: one of Axes.</summary>
        public Axes Axes;
        /// <summary>Position on the floor, in the scene's space.</summary>
        public fixed float Position[3];
        /// <summary>
        /// Direction that it faces, in radians about the upward axis: 0 is the axis along which an avatar looks, and the
        /// sign is that of a yaw in these axes: positive to the left in glTF's, to the right in Unity's and Unreal's.
        /// </summary>
        public float Facing;
        /// <summary>Height of the eyes above the position; the default is 1.6 m in glTF's axes.</summary>
        public float EyeHeight;
    }

    /// <summary>State of a member of a scene. Set StructSize; umo_scene_member writes the rest.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Member
    {
        /// <summary>sizeof(Member).</summary>
        public uint StructSize;
        /// <summary>Whether it speaks: one of Role.</summary>
        public Role Role;
        /// <summary>Whom it attends to; 0 for nobody, or for a point of the host's.</summary>
        public uint AttendsTo;
        /// <summary>1 if it looks there now, 0 if it looks past.</summary>
        public uint IsContact;
        /// <summary>Nods so far.</summary>
        public uint Nods;
        /// <summary>Brow raises so far.</summary>
        public uint Brows;
        /// <summary>Half smiles so far.</summary>
        public uint Smiles;
        /// <summary>Amount of yielding to another one that interrupts, 0 or 1.</summary>
        public float Yielding;
        /// <summary>Level of its voice, root mean square, full scale 1.</summary>
        public float Level;
    }

    /// <summary>
    /// Frames to export, with their skeleton and channels. umo_clip_init fills in the model's fields; the host sets
    /// Layout, Frames and FrameCount. The memory that it points to is read only during the call that takes the clip.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Clip
    {
        /// <summary>sizeof(Clip).</summary>
        public uint StructSize;
        /// <summary>Same as ModelInfo.IsArkit.</summary>
        public uint IsArkit;
        /// <summary>Number of face channels, at most 1,024.</summary>
        public uint ChannelCount;
        /// <summary>Number of frames in Frames.</summary>
        public uint FrameCount;
        /// <summary>Frames per second.</summary>
        public float Rate;
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>Names of the face channels, UTF-8, as from umo_model_get_channel_name. [channel_count] C: const char *const *.</summary>
        public IntPtr Channels;
        /// <summary>int32_t[UMO_JOINT_COUNT]: index of each joint's parent, as from umo_model_get_skeleton. C: const int32_t *.</summary>
        public IntPtr Parents;
        /// <summary>
        /// float[UMO_JOINT_COUNT][3]: rest position of each joint in its parent's frame, metres in Axes.Gltf, whatever
        /// the axes of the frames. C: const float *.
        /// </summary>
        public IntPtr Offsets;
        /// <summary>
        /// Layout and axes of the frames. It must have translation, rotations and channels. C: const struct
        /// umo_frame_layout *.
        /// </summary>
        public IntPtr Layout;
        /// <summary>The first frame, at second 0 of the file. C: const void *.</summary>
        public IntPtr Frames;
        /// <summary>
        /// Figure to skin in FileFormat.Glb: a name from umo_figure_name. NULL: the skeleton alone, without a face. C:
        /// const char *.
        /// </summary>
        public IntPtr Figure;
    }

    /// <summary>
    /// Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on, any other
    /// number to stop. Called on the thread that called umo_clip_write. Must not throw.
    /// </summary>
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    public delegate int OutputWrite(IntPtr userdata, IntPtr bytes, UIntPtr size);

    /// <summary>Destination of a file's bytes.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Output
    {
        /// <summary>Passed to Write.</summary>
        public IntPtr Userdata;
        /// <summary>
        /// Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on, any other
        /// number to stop. Called on the thread that called umo_clip_write. Must not throw. A OutputWrite.
        /// </summary>
        public IntPtr Write;
    }

    /// <summary>
    /// A character's skeleton at rest, and its mesh. umo_rig_init fills in the defaults. The memory that it points to
    /// is read only by umo_retarget_new. Places and rotations are in the character's space, not relative to parents,
    /// in Axes; it may face anywhere and stand in any pose between a T and an A. Scale is in the places.
    /// </summary>
    [StructLayout(LayoutKind.Sequential)]
    public unsafe partial struct Rig
    {
        /// <summary>sizeof(Rig).</summary>
        public uint StructSize;
        /// <summary>Axes of the character's space, and of the poses: one of Axes.</summary>
        public Axes Axes;
        /// <summary>Number of bones, 1 to 65,536.</summary>
        public uint BoneCount;
        /// <summary>Number of points of the mesh; 0: the body has a person's proportions.</summary>
        public uint VertexCount;
        /// <summary>Number of Indices, three for each triangle; 0: the points are spread over the surface by the host.</summary>
        public uint IndexCount;
        /// <summary>
        /// Strength of the body's volume, 0 to 1. 0: arms go through the body. At 1 they keep out of trunk, head, legs
        /// and each other, and touch where the model's do.
        /// </summary>
        public float Gain;
        /// <summary>
        /// Factors of the measured girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands, thighs: 0 to
        /// 10.
        /// </summary>
        public fixed float Girths[9];
        /// <summary>Zero.</summary>
        public uint Reserved;
        /// <summary>Names of the bones, UTF-8; NULL if Joints is given. [bone_count] C: const char *const *.</summary>
        public IntPtr Names;
        /// <summary>int32_t[bone_count]: index of each bone's parent, -1 for none. C: const int32_t *.</summary>
        public IntPtr Parents;
        /// <summary>
        /// int32_t[bone_count]: joint that each bone follows, -1 for none. Bones of the joints 3, 6 and 9 are the spine
        /// from the hips up, whatever their number, bones of joint 12 the neck. NULL: found by Names. C: const int32_t *.
        /// </summary>
        public IntPtr Joints;
        /// <summary>float[bone_count][3]: places of the bones at rest. C: const float *.</summary>
        public IntPtr Places;
        /// <summary>float[bone_count][4]: rotations of the bones at rest, quaternions x, y, z, w. C: const float *.</summary>
        public IntPtr Rotations;
        /// <summary>float[vertex_count][3]: places of the mesh's points at rest. C: const float *.</summary>
        public IntPtr Vertices;
        /// <summary>int32_t[vertex_count]: bone that has at least half of each point's weight, -1 for none. C: const int32_t *.</summary>
        public IntPtr VertexBones;
        /// <summary>uint32_t[index_count]: points of the triangles. C: const uint32_t *.</summary>
        public IntPtr Indices;
    }
}
