/*
 * umo: a living avatar from speech. Samples in; face, hands, upper and lower body out, 30 frames a second.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 * This file is written by cbindgen from umo-capi/src: change it there.
 *
 * C99 or newer, or C++11 or newer.
 *
 * Everything holds everywhere that is not said otherwise:
 *
 * - A fallible call returns a umo_status: UMO_STATUS_OK (0), or below zero what went wrong. umo_status_message says what a
 *   status means and what to do; umo_last_error, and for calls on a session umo_session_last_error, says what exactly.
 *   A call that fails changes nothing and writes no result.
 * - Models, engines and sessions are handles. NULL, freed and made-up handles are errors, not crashes. What is in use on
 *   another thread is not freed: free says UMO_STATUS_BUSY.
 * - A model outlives its engines by itself, and an engine its sessions: free them in any order.
 * - Arguments come in this order: the object, what goes in, what comes out. Lengths are elements, sizes are bytes.
 * - A structure starts with struct_size: its initialiser, or sizeof, sets it. Later versions only add fields at the end.
 * - Texts are UTF-8. Times are seconds, lengths metres, angles unit quaternions x y z w, sound is full scale at 1, unless
 *   a name says otherwise.
 * - No call throws or exits, and none aborts: what a model file or a configuration makes large is allocated fallibly, and a
 *   refusal is UMO_STATUS_OUT_OF_MEMORY. What remains: pieces of some kilobytes while something is made, for which the
 *   memory is looked for before; where another thread takes it in between, the process ends, as with any Rust library.
 * - Nothing of the library runs on a thread that is not its own or in a call of it.
 * - Allocation happens in _load, _new, _free, and where a comment says so; never on the way from audio to frames.
 *
 * Threads of a session:        audio thread             any thread                    game thread
 *                              umo_session_push_audio   umo_session_interrupt, set_…   umo_session_pull_frames
 *                              umo_session_finish       umo_session_latency, stats     umo_session_sample_pose
 */
