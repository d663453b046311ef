// SPDX-License-Identifier: MIT OR Apache-2.0
// Every function of umo.h with its C signature. See umo.h for threads and pointer requirements.

using System;
using System.Collections.Generic;
using System.IO;
using System.Runtime.InteropServices;
using System.Text;

namespace Umo
{
    /// <summary>libumo, bare. <see cref="Model"/>, <see cref="Engine"/>, <see cref="Session"/>, <see cref="Scene"/> and <see cref="RigRetarget"/> are safe to use.</summary>
    public static unsafe partial class Native
    {
        // On these platforms native code is linked statically, so there is no library to load.
#if (UNITY_IOS || UNITY_TVOS || UNITY_VISIONOS || UNITY_WEBGL) && !UNITY_EDITOR
        public const string Library = "__Internal";
#else
        public const string Library = "umo";
#endif
        private const CallingConvention C = CallingConvention.Cdecl;

        [DllImport(Library, CallingConvention = C)] public static extern uint umo_abi_version();
        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_version();
        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_status_message(Status status);
        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_last_error();

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_config_init(ModelConfig* config, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_load(uint abi, byte* path, ModelConfig* config, IntPtr* model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_load_memory(uint abi, void* data, UIntPtr size, ModelConfig* config, IntPtr* model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_free(IntPtr model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_get_info(IntPtr model, ModelInfo* info);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_get_text(IntPtr model, ModelText which, IntPtr* text);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_get_channel_name(IntPtr model, uint index, IntPtr* name);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_get_skeleton(IntPtr model, Axes which, int* parents, float* offsets, UIntPtr joints);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_model_encode_text(IntPtr model, byte* text, UIntPtr length, uint* ids, UIntPtr capacity, UIntPtr* count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_self_test(IntPtr model, uint* passed, byte* report, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_joint_name(uint index);
        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_viseme_name(uint index);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_frame_layout_init(FrameLayout* layout, UIntPtr size, IntPtr model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_frame_layout_check(FrameLayout* layout, IntPtr model, UIntPtr size, UIntPtr* frames);

        [DllImport(Library, CallingConvention = C)] public static extern IntPtr umo_figure_name(uint index);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_clip_init(Clip* clip, UIntPtr size, IntPtr model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_clip_write(Clip* clip, FileFormat format, Output* output);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_clip_write_file(Clip* clip, FileFormat format, byte* path);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_rig_init(Rig* rig, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_retarget_new(IntPtr model, Rig* rig, IntPtr* retarget);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_retarget_free(IntPtr retarget);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_retarget_get_joints(IntPtr retarget, uint boneCount, int* joints);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_retarget_set_step(IntPtr retarget, float seconds);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_retarget_apply(IntPtr retarget, float* poseRotations, float* poseTranslation, uint boneCount, float* rotations, float* place);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_config_init(EngineConfig* config, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_new(IntPtr model, EngineConfig* config, IntPtr* engine);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_free(IntPtr engine);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_set_late_limit(IntPtr engine, double seconds);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_poll(IntPtr engine, uint budget, uint* more);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_gesture_options_init(GestureOptions* options, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_gesture_clip_init(GestureClip* clip, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_add_gesture(IntPtr engine, byte* name, GestureClip* clip);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_add_gesture_file(IntPtr engine, byte* name, byte* path, byte* animation, Gesture parts, float stroke);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_add_gesture_memory(IntPtr engine, byte* name, void* data, UIntPtr size, byte* animation, Gesture parts, float stroke);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_set_word_rules(IntPtr engine, byte* language, byte* toml);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_engine_get_gesture_name(IntPtr engine, uint index, IntPtr* name);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_recording_gains(float* samples, UIntPtr count, uint sampleRate, uint channels, float* gains);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_parameter_get_info(uint index, ParameterInfo* info);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_config_init(SessionConfig* config, UIntPtr size, IntPtr model);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_memory(IntPtr engine, SessionConfig* config, UIntPtr* size, UIntPtr* alignment);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_new(IntPtr engine, SessionConfig* config, IntPtr* session);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_free(IntPtr session);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_last_error(IntPtr session, byte* buffer, UIntPtr size, UIntPtr* length);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_push_audio(IntPtr session, float* samples, UIntPtr count, UIntPtr* taken);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_push_audio_i16(IntPtr session, short* samples, UIntPtr count, UIntPtr* taken);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_push_other_audio(IntPtr session, float* samples, UIntPtr count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_finish(IntPtr session);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_interrupt(IntPtr session, uint easeMs);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_reset(IntPtr session);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_pull_frames(IntPtr session, FrameLayout* layout, void* frames, UIntPtr size, UIntPtr* count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_ready_frames(IntPtr session, UIntPtr* count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_arousal(IntPtr session, float* arousal, float* trend);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_is_done(IntPtr session, uint* done);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_clock(IntPtr session, double seconds);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_sample_pose(IntPtr session, double seconds, FrameLayout* layout, void* frame, UIntPtr size, Sampled* sampled);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_prompt(IntPtr session, byte* text, UIntPtr length);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_prompt_ids(IntPtr session, uint* ids, UIntPtr count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_seed(IntPtr session, ulong seed);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_look_at(IntPtr session, Axes axes, float* point, float strength);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_mood(IntPtr session, Mood mood, float strength);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_hint_lips(IntPtr session, LipShape shape, double start, double duration);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_hint_words(IntPtr session, byte* text, double start, double end);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_play_gesture(IntPtr session, byte* name, GestureOptions* options);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_set_parameter(IntPtr session, Parameter parameter, double value);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_get_parameter(IntPtr session, Parameter parameter, double* value);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_latency(IntPtr session, Latency* latency);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_stats(IntPtr session, Stats* stats);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_state_size(IntPtr session, UIntPtr* size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_save(IntPtr session, void* state, UIntPtr size, UIntPtr* written);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_restore(IntPtr session, void* state, UIntPtr size);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_packet_size(IntPtr session, UIntPtr* size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_pull_packets(IntPtr session, void* bytes, UIntPtr size, UIntPtr* lengths, UIntPtr most, UIntPtr* count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_decoder_new(IntPtr model, SessionConfig* config, IntPtr* decoder);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_decoder_push_packet(IntPtr decoder, void* packet, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_decoder_stats(IntPtr decoder, Received* stats);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_take_new(void* bytes, UIntPtr size, IntPtr* take);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_take_free(IntPtr take);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_take_get_info(IntPtr take, TakeInfo* info);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_decoder_new_of_take(IntPtr model, IntPtr take, SessionConfig* config, IntPtr* decoder);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_decoder_push_take(IntPtr decoder, uint* more);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_take_size(IntPtr session, UIntPtr* size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_session_take(IntPtr session, void* take, UIntPtr size, UIntPtr* written);

        [DllImport(Library, CallingConvention = C)] public static extern Status umo_place_init(Place* place, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_new(ulong seed, IntPtr* scene);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_free(IntPtr scene);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_add(IntPtr scene, IntPtr session, Place* place, uint* member);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_remove(IntPtr scene, uint member);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_set_place(IntPtr scene, uint member, Place* place);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_set_target(IntPtr scene, uint member, uint other, Axes axes, float* point);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_set_allowed(IntPtr scene, uint member, ScenePart parts);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_push_audio(IntPtr scene, uint member, float* samples, UIntPtr count);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_update(IntPtr scene, double seconds);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_floor(IntPtr scene, uint* member);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_member(IntPtr scene, uint member, Member* info);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_state_size(IntPtr scene, UIntPtr* size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_save(IntPtr scene, void* state, UIntPtr size, UIntPtr* written);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_restore(IntPtr scene, void* state, UIntPtr size);
        [DllImport(Library, CallingConvention = C)] public static extern Status umo_scene_last_error(IntPtr scene, byte* buffer, UIntPtr size, UIntPtr* length);

        /// <summary>Throws if libumo cannot be loaded, listing the places searched.</summary>
        internal static void Require()
        {
            try
            {
                umo_abi_version();
            }
            catch (DllNotFoundException error)
            {
                throw new DllNotFoundException(Missing() + " (" + error.Message + ")", error);
            }
        }

        private static string Missing()
        {
            bool isWindows = Path.DirectorySeparatorChar == '\\', isMac = Directory.Exists("/System/Library");
            string name = isWindows ? "umo.dll" : isMac ? "libumo.dylib" : "libumo.so";
            string variable = isWindows ? "PATH" : isMac ? "DYLD_LIBRARY_PATH" : "LD_LIBRARY_PATH";
            List<string> folders = new List<string> { AppDomain.CurrentDomain.BaseDirectory };
            // .NET lists package folders here; Mono and Unity do not.
            string ofPackages = AppDomain.CurrentDomain.GetData("NATIVE_DLL_SEARCH_DIRECTORIES") as string ?? "";
            folders.AddRange(ofPackages.Split(new[] { Path.PathSeparator }, StringSplitOptions.RemoveEmptyEntries));
            string present = folders.Find(folder => File.Exists(Path.Combine(folder, name)));
            if (present != null)
            {
                return name + " is in " + present + ", but cannot be loaded: it is for another processor or system, or a dependency is missing";
            }
            return name + " was not found in " + string.Join(", ", folders) + ", in the folders of " + variable + " ("
                + (Environment.GetEnvironmentVariable(variable) ?? "not set") + ") and the system's: put it beside the program, or add its folder to "
                + variable;
        }

        /// <summary>Converts a library text to a string; null for a null pointer.</summary>
        public static string Text(IntPtr text)
        {
            if (text == IntPtr.Zero) return null;
            byte* bytes = (byte*)text;
            int length = 0;
            while (bytes[length] != 0) length++;
            return Encoding.UTF8.GetString(bytes, length);
        }

        /// <summary>UTF-8 with a terminating zero byte.</summary>
        internal static byte[] Bytes(string text)
        {
            byte[] bytes = new byte[Encoding.UTF8.GetByteCount(text) + 1];
            Encoding.UTF8.GetBytes(text, 0, text.Length, bytes, 0);
            return bytes;
        }
    }
}
