// SPDX-License-Identifier: MIT OR Apache-2.0
// The functions of umo.h in Unity's WebGL players: each calls the function of the same name in umo.wasm, a module with
// its own memory, and copies pointer arguments to it and results back. Emscripten emits each function here separately,
// so they share only `umoModule`. ES5, as the linker of Unity 2021 requires.

var UmoLibrary = {
  $umoModule: {
    // 0: not requested, 1: loading, 2: ready, 3: failed.
    state: 0,
    exports: null,
    // Reason why loading failed, a call trapped or a call could not be made; returned by umo_last_error.
    error: "",
    trapped: false,
    // Memory of the module for pointer arguments.
    scratch: 0,
    scratchSize: 65536,
    // Copies of the module's texts in Unity's memory, by content; the last error has a separate buffer.
    texts: {},
    errorText: 0,

    // Of each function its parameters, and > T where it returns a text:
    //   v  number              l  number of 64 bits         s  text with a zero at its end
    //   S  structure that begins with its size, read         R  the same, read and written
    //   Z  structure to be written, whose size is the next argument
    //   oN N bytes, written    t  address of a text, written
    //   iN, iN*A  N bytes, as often as argument A says, read  bN, bN*A  the same, read and written
    functions: {
      umo_abi_version: "", umo_version: ">T", umo_status_message: "v>T", umo_last_error: ">T", umo_model_config_init: "Z v",
      umo_model_load: "v s S o4", umo_model_load_memory: "v i1*2 v S o4", umo_model_free: "v", umo_model_get_info: "v R",
      umo_model_get_text: "v v t", umo_model_get_channel_name: "v v t", umo_model_get_skeleton: "v v b4*4 b12*4 v",
      umo_model_encode_text: "v i1*2 v b4*4 v o4", umo_self_test: "v o4 b1*3 v", umo_joint_name: "v>T", umo_viseme_name: "v>T", umo_frame_layout_init: "Z v v",
      umo_frame_layout_check: "S v v o4", umo_engine_config_init: "Z v", umo_engine_new: "v S o4", umo_engine_free: "v",
      umo_engine_set_late_limit: "v v", umo_engine_poll: "v v o4", umo_gesture_options_init: "Z v", umo_gesture_clip_init: "Z v",
      umo_engine_add_gesture: "v s S", umo_engine_add_gesture_file: "v s s s v v",
      umo_engine_add_gesture_memory: "v s i1*3 v s v v", umo_engine_set_word_rules: "v s s", umo_engine_get_gesture_name: "v v t", umo_parameter_get_info: "v R",
      umo_session_config_init: "Z v v", umo_session_memory: "v S o4 o4", umo_session_new: "v S o4", umo_session_free: "v",
      umo_session_last_error: "v b1*2 v o4", umo_session_push_audio: "v i4*2 v o4", umo_session_push_audio_i16: "v i2*2 v o4",
      umo_session_push_other_audio: "v i4*2 v", umo_session_finish: "v", umo_session_interrupt: "v v", umo_session_reset: "v",
      umo_session_pull_frames: "v S b1*3 v o4", umo_session_ready_frames: "v o4", umo_session_is_done: "v o4", umo_session_arousal: "v o4 o4",
      umo_session_set_clock: "v v", umo_session_sample_pose: "v v S b1*4 v R", umo_session_set_prompt: "v i1*2 v",
      umo_session_set_prompt_ids: "v i4*2 v", umo_session_set_seed: "v l", umo_session_look_at: "v v i12 v",
      umo_session_set_mood: "v v v", umo_session_hint_lips: "v v v v", umo_session_hint_words: "v s v v", umo_session_play_gesture: "v s S", umo_session_set_parameter: "v v v",
      umo_session_get_parameter: "v v o8", umo_session_latency: "v R", umo_session_stats: "v R", umo_session_state_size: "v o4",
      umo_session_save: "v b1*2 v o4", umo_session_restore: "v i1*2 v", umo_session_packet_size: "v o4",
      umo_session_pull_packets: "v b1*2 v b4*4 v o4", umo_decoder_new: "v S o4", umo_decoder_push_packet: "v i1*2 v",
      umo_decoder_stats: "v R", umo_take_new: "i1*1 v o4", umo_take_free: "v", umo_take_get_info: "v R",
      umo_decoder_new_of_take: "v v S o4", umo_decoder_push_take: "v o4", umo_session_take_size: "v o4",
      umo_session_take: "v b1*2 v o4", umo_place_init: "Z v", umo_scene_new: "l o4", umo_scene_free: "v", umo_scene_add: "v v S o4",
      umo_scene_remove: "v v", umo_scene_set_place: "v v S", umo_scene_set_target: "v v v v i12", umo_scene_set_allowed: "v v v",
      umo_scene_push_audio: "v v i4*3 v", umo_scene_update: "v v", umo_scene_floor: "v o4", umo_scene_member: "v v R",
      umo_scene_state_size: "v o4", umo_scene_save: "v b1*2 v o4", umo_scene_restore: "v i1*2 v", umo_scene_last_error: "v b1*2 v o4",
      umo_recording_gains: "i4*1 v v v b4*3",
      umo_rig_init: "Z v", umo_retarget_new: "v S o4", umo_retarget_free: "v", umo_retarget_get_joints: "v v b4*1", umo_retarget_set_step: "v v",
      umo_retarget_apply: "v i880 i12 v b16*3 o12",
      // In a module without the glTF writer, these return an error that says so.
      umo_figure_name: "v>T", umo_clip_init: "Z v v", umo_clip_write: "S v S", umo_clip_write_file: "S v s",
    },

    // Pointers in structures, by the function's argument: 0 if they must be zero here, "s" for texts, a function of the
    // structure for the size of an input buffer, "t" for output texts.
    pointers: {
      umo_model_load: { 2: { 16: 0 } },
      umo_model_load_memory: { 3: { 16: 0 } },
      umo_engine_new: { 1: { 24: 0, 28: 0, 32: 0 } },
      umo_engine_add_gesture: { 2: { 24: function (at) { return 4 * 55 * 4 * HEAPU32[(at + 12) >> 2]; } } },
      umo_parameter_get_info: { 1: { 32: "t" } },
      umo_session_memory: { 1: { 48: "s", 52: 0 } },
      umo_session_new: { 1: { 48: "s", 52: 0 } },
      umo_decoder_new: { 1: { 48: "s", 52: 0 } },
      umo_decoder_new_of_take: { 2: { 48: "s", 52: 0 } },
      umo_retarget_new: {
        1: {
          64: 0,
          68: function (at) { return 4 * HEAPU32[(at + 8) >> 2]; },
          72: function (at) { return 4 * HEAPU32[(at + 8) >> 2]; },
          76: function (at) { return 12 * HEAPU32[(at + 8) >> 2]; },
          80: function (at) { return 16 * HEAPU32[(at + 8) >> 2]; },
          84: function (at) { return 12 * HEAPU32[(at + 12) >> 2]; },
          88: function (at) { return 4 * HEAPU32[(at + 12) >> 2]; },
          92: function (at) { return 4 * HEAPU32[(at + 16) >> 2]; },
        },
      },
    },

    fail: function (status, message) {
      umoModule.error = message;
      return status;
    },

    // Calls an export. A trap ends the module: it cannot continue.
    run: function (name, values) {
      try {
        return umoModule.exports[name].apply(null, values);
      } catch (error) {
        umoModule.trapped = true;
        umoModule.error = "the engine ended in " + name + ": out of memory, or a defect of umo (" + error.message + ")";
        throw error;
      }
    },

    // Length of a text in bytes without the terminator.
    length: function (memory, at) {
      var end = at;
      while (memory[end] !== 0) end++;
      return end - at;
    },

    // Address in Unity's memory of a text of the module; zero for zero.
    text: function (at) {
      if (at === 0) return 0;
      var memory = new Uint8Array(umoModule.exports.memory.buffer);
      var bytes = memory.slice(at, at + umoModule.length(memory, at));
      return umoModule.keep(String.fromCharCode.apply(null, bytes), bytes);
    },

    keep: function (key, bytes) {
      var known = "$" + key;
      if (!umoModule.texts[known]) {
        var place = _malloc(bytes.length + 1);
        HEAPU8.set(bytes, place);
        HEAPU8[place + bytes.length] = 0;
        umoModule.texts[known] = place;
      }
      return umoModule.texts[known];
    },

    // Address of the last error's text, which is overwritten by the next error.
    lastError: function (bytes) {
      if (umoModule.errorText === 0) umoModule.errorText = _malloc(513);
      bytes = bytes.slice(0, 512);
      HEAPU8.set(bytes, umoModule.errorText);
      HEAPU8[umoModule.errorText + bytes.length] = 0;
      return umoModule.errorText;
    },

    ascii: function (text) {
      var bytes = new Uint8Array(text.length);
      for (var i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i) & 127;
      return bytes;
    },

    // Arguments in the order of the signature: without 64-bit integers Emscripten passes them as two halves.
    values: function (kinds, given) {
      var values = [];
      for (var i = 0, at = 0; i < kinds.length; i++) {
        if (kinds[i] === "v") values.push(given[at++]);
        else if (kinds[i] !== "l") values.push(given[at++] >>> 0);
        else if (typeof given[at] === "bigint") values.push(given[at++]);
        else {
          values.push((BigInt(given[at + 1] >>> 0) << BigInt(32)) | BigInt(given[at] >>> 0));
          at += 2;
        }
      }
      return values;
    },

    // Size in bytes of the buffer that argument `i` points to.
    size: function (kind, values, i) {
      var address = values[i];
      if (kind === "s") return umoModule.length(HEAPU8, address) + 1;
      if (kind === "S" || kind === "R") return HEAPU32[address >> 2];
      if (kind === "Z") return values[i + 1] >>> 0;
      if (kind === "t") return 4;
      var parts = kind.slice(1).split("*");
      return Number(parts[0]) * (parts.length > 1 ? values[parts[1]] >>> 0 : 1);
    },

    // Copies `size` bytes from Unity's memory to address `to` of the module.
    copy: function (from, to, size) {
      new Uint8Array(umoModule.exports.memory.buffer, to, size).set(HEAPU8.subarray(from, from + size));
    },

    call: function (name, given) {
      var said = umoModule.functions[name].split(">"), kinds = said[0] === "" ? [] : said[0].split(" "), gives = said[1];
      if (name === "umo_last_error" && umoModule.error !== "") return umoModule.lastError(umoModule.ascii(umoModule.error));
      if (umoModule.state !== 2) return gives ? 0 : umoModule.fail(-16, "umo.wasm is not loaded: WebLibrary.Load, then wait for WebLibrary.IsReady");
      if (umoModule.trapped) return gives ? 0 : -15;
      if (!umoModule.exports[name]) return gives ? 0 : umoModule.fail(-16, name + " is not in umo.wasm");
      if (name !== "umo_last_error") umoModule.error = "";
      var values = umoModule.values(kinds, given), inside = umoModule.pointers[name] || {};
      try {
        return umoModule.marshal(name, kinds, gives, values, inside);
      } catch (error) {
        if (!umoModule.trapped) throw error;
        return gives ? 0 : -15;
      }
    },

    marshal: function (name, kinds, gives, values, inside) {
      // Memory needed at once, in 16-byte steps: buffers of pointer arguments, and those of pointers in structures.
      var total = 0, places = [], i, offset, fields, address, size;
      function reserve(from, size) {
        var place = { from: from, at: total, size: size };
        total += (size + 15) & ~15;
        return place;
      }
      for (i = 0; i < kinds.length; i++) {
        places.push(null);
        if (kinds[i] === "v" || kinds[i] === "l" || values[i] === 0) continue;
        places[i] = reserve(values[i], umoModule.size(kinds[i], values, i));
        fields = inside[i] || {};
        places[i].fields = [];
        for (offset in fields) {
          offset = Number(offset);
          if (offset + 4 > places[i].size) continue;
          address = HEAPU32[(values[i] + offset) >> 2];
          size = 0;
          if (fields[offset] === "s" && address !== 0) size = umoModule.length(HEAPU8, address) + 1;
          if (typeof fields[offset] === "function" && address !== 0) size = fields[offset](values[i]);
          places[i].fields.push({ offset: offset, kind: fields[offset], what: size > 0 ? reserve(address, size) : null });
        }
      }
      var base = umoModule.scratch, own = total > umoModule.scratchSize;
      if (own) {
        base = umoModule.run("umo_web_allocate", [total]);
        if (base === 0) return umoModule.fail(-9, "out of memory: cannot allocate " + total + " bytes for the arguments of " + name);
      }
      var handed = values.slice();
      for (i = 0; i < kinds.length; i++) {
        var place = places[i];
        if (place === null) continue;
        handed[i] = base + place.at;
        umoModule.copy(place.from, handed[i], place.size);
        for (var f = 0; f < place.fields.length; f++) {
          var field = place.fields[f];
          var pointer = new DataView(umoModule.exports.memory.buffer, handed[i] + field.offset, 4);
          pointer.setUint32(0, field.what === null ? 0 : base + field.what.at, true);
          if (field.what !== null) umoModule.copy(field.what.from, base + field.what.at, field.what.size);
        }
      }
      var result = umoModule.run(name, handed);
      for (i = 0; i < kinds.length; i++) {
        if (places[i] === null || "SRZotb".indexOf(kinds[i][0]) < 1) continue;
        umoModule.back(places[i], handed[i], kinds[i]);
      }
      if (own) umoModule.run("umo_web_free", [base, total]);
      if (gives === undefined) return result;
      if (name !== "umo_last_error" || result === 0) return umoModule.text(result);
      var memory = new Uint8Array(umoModule.exports.memory.buffer);
      return umoModule.lastError(memory.slice(result, result + umoModule.length(memory, result)));
    },

    // Copies output buffers back to Unity's memory.
    back: function (place, at, kind) {
      HEAPU8.set(new Uint8Array(umoModule.exports.memory.buffer, at, place.size), place.from);
      if (kind === "t") HEAPU32[place.from >> 2] = umoModule.text(HEAPU32[place.from >> 2]);
      for (var f = 0; f < place.fields.length; f++) {
        var to = (place.from + place.fields[f].offset) >> 2;
        if (place.fields[f].kind === "t") HEAPU32[to] = umoModule.text(HEAPU32[to]);
      }
    },
  },

  // Fetches umo.wasm, once for all callers.
  umo_web_load: function (url) {
    if (umoModule.state === 1 || umoModule.state === 2) return;
    umoModule.state = 1;
    var address = UTF8ToString(url);
    fetch(address)
      .then(function (response) {
        if (!response.ok) throw new Error("status " + response.status);
        return response.arrayBuffer();
      })
      .then(function (bytes) { return WebAssembly.instantiate(bytes, {}); })
      .then(function (made) {
        umoModule.exports = made.instance.exports;
        umoModule.scratch = umoModule.run("umo_web_allocate", [umoModule.scratchSize]);
        umoModule.state = 2;
      })
      .catch(function (error) {
        umoModule.error = address + ": " + error.message;
        umoModule.state = 3;
      });
  },
  umo_web_state: function () { return umoModule.state; },

  umo_abi_version: function () { return umoModule.call("umo_abi_version", arguments); },
  umo_version: function () { return umoModule.call("umo_version", arguments); },
  umo_status_message: function (a) { return umoModule.call("umo_status_message", arguments); },
  umo_last_error: function () { return umoModule.call("umo_last_error", arguments); },
  umo_model_config_init: function (a, b) { return umoModule.call("umo_model_config_init", arguments); },
  umo_model_load: function (a, b, c, d) { return umoModule.call("umo_model_load", arguments); },
  umo_model_load_memory: function (a, b, c, d, e) { return umoModule.call("umo_model_load_memory", arguments); },
  umo_model_free: function (a) { return umoModule.call("umo_model_free", arguments); },
  umo_model_get_info: function (a, b) { return umoModule.call("umo_model_get_info", arguments); },
  umo_model_get_text: function (a, b, c) { return umoModule.call("umo_model_get_text", arguments); },
  umo_model_get_channel_name: function (a, b, c) { return umoModule.call("umo_model_get_channel_name", arguments); },
  umo_model_get_skeleton: function (a, b, c, d, e) { return umoModule.call("umo_model_get_skeleton", arguments); },
  umo_model_encode_text: function (a, b, c, d, e, f) { return umoModule.call("umo_model_encode_text", arguments); },
  umo_self_test: function (a, b, c, d) { return umoModule.call("umo_self_test", arguments); },
  umo_joint_name: function (a) { return umoModule.call("umo_joint_name", arguments); },
  umo_viseme_name: function (a) { return umoModule.call("umo_viseme_name", arguments); },
  umo_frame_layout_init: function (a, b, c) { return umoModule.call("umo_frame_layout_init", arguments); },
  umo_frame_layout_check: function (a, b, c, d) { return umoModule.call("umo_frame_layout_check", arguments); },
  umo_engine_config_init: function (a, b) { return umoModule.call("umo_engine_config_init", arguments); },
  umo_engine_new: function (a, b, c) { return umoModule.call("umo_engine_new", arguments); },
  umo_engine_free: function (a) { return umoModule.call("umo_engine_free", arguments); },
  umo_engine_set_late_limit: function (a, b) { return umoModule.call("umo_engine_set_late_limit", arguments); },
  umo_engine_poll: function (a, b, c) { return umoModule.call("umo_engine_poll", arguments); },
  umo_gesture_options_init: function (a, b) { return umoModule.call("umo_gesture_options_init", arguments); },
  umo_gesture_clip_init: function (a, b) { return umoModule.call("umo_gesture_clip_init", arguments); },
  umo_engine_add_gesture: function (a, b, c) { return umoModule.call("umo_engine_add_gesture", arguments); },
  umo_engine_add_gesture_file: function (a, b, c, d, e, f) { return umoModule.call("umo_engine_add_gesture_file", arguments); },
  umo_engine_add_gesture_memory: function (a, b, c, d, e, f, g) { return umoModule.call("umo_engine_add_gesture_memory", arguments); },
  umo_engine_set_word_rules: function (a, b, c) { return umoModule.call("umo_engine_set_word_rules", arguments); },
  umo_engine_get_gesture_name: function (a, b, c) { return umoModule.call("umo_engine_get_gesture_name", arguments); },
  umo_recording_gains: function (a, b, c, d, e) { return umoModule.call("umo_recording_gains", arguments); },
  umo_parameter_get_info: function (a, b) { return umoModule.call("umo_parameter_get_info", arguments); },
  umo_session_config_init: function (a, b, c) { return umoModule.call("umo_session_config_init", arguments); },
  umo_session_memory: function (a, b, c, d) { return umoModule.call("umo_session_memory", arguments); },
  umo_session_new: function (a, b, c) { return umoModule.call("umo_session_new", arguments); },
  umo_session_free: function (a) { return umoModule.call("umo_session_free", arguments); },
  umo_session_last_error: function (a, b, c, d) { return umoModule.call("umo_session_last_error", arguments); },
  umo_session_push_audio: function (a, b, c, d) { return umoModule.call("umo_session_push_audio", arguments); },
  umo_session_push_audio_i16: function (a, b, c, d) { return umoModule.call("umo_session_push_audio_i16", arguments); },
  umo_session_push_other_audio: function (a, b, c) { return umoModule.call("umo_session_push_other_audio", arguments); },
  umo_session_finish: function (a) { return umoModule.call("umo_session_finish", arguments); },
  umo_session_interrupt: function (a, b) { return umoModule.call("umo_session_interrupt", arguments); },
  umo_session_reset: function (a) { return umoModule.call("umo_session_reset", arguments); },
  umo_session_pull_frames: function (a, b, c, d, e) { return umoModule.call("umo_session_pull_frames", arguments); },
  umo_session_ready_frames: function (a, b) { return umoModule.call("umo_session_ready_frames", arguments); },
  umo_session_arousal: function (a, b, c) { return umoModule.call("umo_session_arousal", arguments); },
  umo_session_is_done: function (a, b) { return umoModule.call("umo_session_is_done", arguments); },
  umo_session_set_clock: function (a, b) { return umoModule.call("umo_session_set_clock", arguments); },
  umo_session_sample_pose: function (a, b, c, d, e, f) { return umoModule.call("umo_session_sample_pose", arguments); },
  umo_session_set_prompt: function (a, b, c) { return umoModule.call("umo_session_set_prompt", arguments); },
  umo_session_set_prompt_ids: function (a, b, c) { return umoModule.call("umo_session_set_prompt_ids", arguments); },
  umo_session_set_seed: function (a, low, high) { return umoModule.call("umo_session_set_seed", arguments); },
  umo_session_look_at: function (a, b, c, d) { return umoModule.call("umo_session_look_at", arguments); },
  umo_session_set_mood: function (a, b, c) { return umoModule.call("umo_session_set_mood", arguments); },
  umo_session_hint_lips: function (a, b, c, d) { return umoModule.call("umo_session_hint_lips", arguments); },
  umo_session_hint_words: function (a, b, c, d) { return umoModule.call("umo_session_hint_words", arguments); },
  umo_session_play_gesture: function (a, b, c) { return umoModule.call("umo_session_play_gesture", arguments); },
  umo_session_set_parameter: function (a, b, c) { return umoModule.call("umo_session_set_parameter", arguments); },
  umo_session_get_parameter: function (a, b, c) { return umoModule.call("umo_session_get_parameter", arguments); },
  umo_session_latency: function (a, b) { return umoModule.call("umo_session_latency", arguments); },
  umo_session_stats: function (a, b) { return umoModule.call("umo_session_stats", arguments); },
  umo_session_state_size: function (a, b) { return umoModule.call("umo_session_state_size", arguments); },
  umo_session_save: function (a, b, c, d) { return umoModule.call("umo_session_save", arguments); },
  umo_session_restore: function (a, b, c) { return umoModule.call("umo_session_restore", arguments); },
  umo_session_packet_size: function (a, b) { return umoModule.call("umo_session_packet_size", arguments); },
  umo_session_pull_packets: function (a, b, c, d, e, f) { return umoModule.call("umo_session_pull_packets", arguments); },
  umo_decoder_new: function (a, b, c) { return umoModule.call("umo_decoder_new", arguments); },
  umo_decoder_push_packet: function (a, b, c) { return umoModule.call("umo_decoder_push_packet", arguments); },
  umo_decoder_stats: function (a, b) { return umoModule.call("umo_decoder_stats", arguments); },
  umo_take_new: function (a, b, c) { return umoModule.call("umo_take_new", arguments); },
  umo_take_free: function (a) { return umoModule.call("umo_take_free", arguments); },
  umo_take_get_info: function (a, b) { return umoModule.call("umo_take_get_info", arguments); },
  umo_decoder_new_of_take: function (a, b, c, d) { return umoModule.call("umo_decoder_new_of_take", arguments); },
  umo_decoder_push_take: function (a, b) { return umoModule.call("umo_decoder_push_take", arguments); },
  umo_session_take_size: function (a, b) { return umoModule.call("umo_session_take_size", arguments); },
  umo_session_take: function (a, b, c, d) { return umoModule.call("umo_session_take", arguments); },
  umo_place_init: function (a, b) { return umoModule.call("umo_place_init", arguments); },
  umo_scene_new: function (low, high, b) { return umoModule.call("umo_scene_new", arguments); },
  umo_scene_free: function (a) { return umoModule.call("umo_scene_free", arguments); },
  umo_scene_add: function (a, b, c, d) { return umoModule.call("umo_scene_add", arguments); },
  umo_scene_remove: function (a, b) { return umoModule.call("umo_scene_remove", arguments); },
  umo_scene_set_place: function (a, b, c) { return umoModule.call("umo_scene_set_place", arguments); },
  umo_scene_set_target: function (a, b, c, d, e) { return umoModule.call("umo_scene_set_target", arguments); },
  umo_scene_set_allowed: function (a, b, c) { return umoModule.call("umo_scene_set_allowed", arguments); },
  umo_scene_push_audio: function (a, b, c, d) { return umoModule.call("umo_scene_push_audio", arguments); },
  umo_scene_update: function (a, b) { return umoModule.call("umo_scene_update", arguments); },
  umo_scene_floor: function (a, b) { return umoModule.call("umo_scene_floor", arguments); },
  umo_scene_member: function (a, b, c) { return umoModule.call("umo_scene_member", arguments); },
  umo_scene_state_size: function (a, b) { return umoModule.call("umo_scene_state_size", arguments); },
  umo_scene_save: function (a, b, c, d) { return umoModule.call("umo_scene_save", arguments); },
  umo_scene_restore: function (a, b, c) { return umoModule.call("umo_scene_restore", arguments); },
  umo_scene_last_error: function (a, b, c, d) { return umoModule.call("umo_scene_last_error", arguments); },
  umo_rig_init: function (a, b) { return umoModule.call("umo_rig_init", arguments); },
  umo_retarget_new: function (a, b, c) { return umoModule.call("umo_retarget_new", arguments); },
  umo_retarget_free: function (a) { return umoModule.call("umo_retarget_free", arguments); },
  umo_retarget_get_joints: function (a, b, c) { return umoModule.call("umo_retarget_get_joints", arguments); },
  umo_retarget_set_step: function (a, b) { return umoModule.call("umo_retarget_set_step", arguments); },
  umo_retarget_apply: function (a, b, c, d, e, f) { return umoModule.call("umo_retarget_apply", arguments); },
  umo_figure_name: function (a) { return umoModule.call("umo_figure_name", arguments); },
  umo_clip_init: function (a, b, c) { return umoModule.call("umo_clip_init", arguments); },
  umo_clip_write: function (a, b, c) { return umoModule.call("umo_clip_write", arguments); },
  umo_clip_write_file: function (a, b, c) { return umoModule.call("umo_clip_write_file", arguments); },
};

autoAddDeps(UmoLibrary, "$umoModule");
mergeInto(LibraryManager.library, UmoLibrary);
