/*
 * umo: real-time full-body animation from speech. Samples in; poses of face, hands, upper and lower body out, 30 a second.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 * This file is written by cbindgen from umo-capi/src: change it there.
 *
 * C99 or newer, or C++11 or newer.
 *
 * Unless stated otherwise:
 *
 * - A fallible call returns a umo_status: UMO_STATUS_OK (0), or a negative error code. umo_status_message describes a
 *   status and what to do about it; umo_last_error, and for calls on a session umo_session_last_error, give the details.
 *   A call that fails changes nothing and writes no result.
 * - Models, engines and sessions are handles. NULL, freed and invalid handles are errors, not crashes. An object in use on
 *   another thread is not freed: its free function returns UMO_STATUS_BUSY.
 * - Models, engines and sessions may be freed in any order.
 * - Order of arguments: the object, inputs, outputs. Lengths are in elements, sizes in bytes.
 * - A structure starts with struct_size: its initialiser, or sizeof, sets it. Later versions only add fields at the end.
 * - Texts are UTF-8. Times are seconds, lengths metres, angles unit quaternions x y z w, sound is full scale at 1, unless
 *   a name says otherwise.
 * - No call throws or exits, and none aborts: an allocation that fails, of any size, is UMO_STATUS_OUT_OF_MEMORY. A small
 *   one is served from a reserve until its call ends with that status. That the system has memory for a thread's start is
 *   checked first.
 * - The library runs only on its own threads and inside calls.
 * - Everything is computed in the default floating-point environment: rounding to nearest, no traps, denormals kept. A
 *   call restores its caller's environment, exception flags included. The host's callbacks are called in the default one.
 * - _load, _new and _free allocate, and functions whose comment says so; the path from audio to frames never does.
 *
 * Threads of a session:        audio thread             any thread                    game thread
 *                              umo_session_push_audio   umo_session_interrupt, set_…   umo_session_pull_frames
 *                              umo_session_finish       umo_session_latency, stats     umo_session_sample_pose
 */
