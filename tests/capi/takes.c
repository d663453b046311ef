/* Takes: recorded while a session runs, read from memory, played with identical bits; refusals. */

#include "check.h"

enum { SAMPLES = 16000 * 3, ROOM = 1 << 20, TAKE = 1 << 14 };

static float speech[SAMPLES];
static char frames[ROOM], shown[ROOM], bytes[TAKE];

int main(int argc, char **argv) {
    CHECK(argc == 2);
    speak(speech, SAMPLES, 0);
    umo_model *model = load_model(argv[1]);
    umo_engine *engine = polled_engine(model);
    umo_frame_layout layout;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    const size_t stride = layout.frame_stride;

    umo_session_config config;
    OK(umo_session_config_init(&config, sizeof config, model));
    CHECK(config.take_bytes == 0);
    umo_session *avatar = NULL, *plain = NULL, *player = NULL;
    OK(umo_session_new(engine, &config, &plain));
    config.take_bytes = 4096;
    config.packets = UMO_PACKETS_ONLY;
    FAILS(INVALID_ARGUMENT, umo_session_new(engine, &config, &avatar));
    CHECK(strstr(umo_last_error(), "take_bytes"));
    config.packets = UMO_PACKETS_NONE;
    FAILS(INVALID_ARGUMENT, umo_decoder_new(model, &config, &avatar));
    OK(umo_session_new(engine, &config, &avatar));

    size_t size = 0, written = 0, count = 0, total = 0, taken = 0;
    FAILS(INVALID_ARGUMENT, umo_session_take_size(plain, &size));
    OK(umo_session_hint_words(avatar, "no, never", 0.4, 1.2));
    OK(umo_session_set_mood(avatar, UMO_MOOD_JOY, 0.8F));
    OK(umo_session_push_audio(avatar, speech, SAMPLES, &taken));
    OK(umo_session_finish(avatar));
    do {
        compute(engine);
        OK(umo_session_pull_frames(avatar, &layout, frames + total * stride, ROOM - total * stride, &count));
        total += count;
    } while (count > 0);
    CHECK(total == 90);

    OK(umo_session_take_size(avatar, &size));
    CHECK(size > 500 && size < 3 * 1000);
    FAILS(BUFFER_TOO_SMALL, umo_session_take(avatar, bytes, size - 1, &written));
    FAILS(NULL_POINTER, umo_session_take(avatar, bytes, sizeof bytes, NULL));
    FAILS(NULL_POINTER, umo_session_take(avatar, NULL, sizeof bytes, &written));
    OK(umo_session_take(avatar, bytes, sizeof bytes, &written));
    CHECK(written == size);

    umo_take *take = NULL;
    FAILS(NULL_POINTER, umo_take_new(bytes, size, NULL));
    FAILS(NULL_POINTER, umo_take_new(NULL, size, &take));
    FAILS(TAKE, umo_take_new(bytes, size - 1, &take));
    bytes[300] ^= 4;
    FAILS(TAKE, umo_take_new(bytes, size, &take));
    CHECK(strstr(umo_last_error(), "damaged"));
    bytes[300] ^= 4;
    OK(umo_take_new(bytes, size, &take));
    memset(bytes, 0, sizeof bytes);
    umo_take_info info;
    memset(&info, 0, sizeof info);
    FAILS(STRUCT_SIZE, umo_take_get_info(take, &info));
    info.struct_size = sizeof info;
    OK(umo_take_get_info(take, &info));
    CHECK(info.version == 5 && info.frames == 90 && info.frame_rate == 30 && info.sample_rate == 16000);
    CHECK(info.audio_samples == SAMPLES && info.packets >= 6);

    FAILS(INVALID_HANDLE, umo_decoder_new_of_take(model, (umo_take *)model, NULL, &player));
    OK(umo_decoder_new_of_take(model, take, NULL, &player));
    OK(umo_take_free(take));
    FAILS(INVALID_HANDLE, umo_take_get_info(take, &info));
    FAILS(INVALID_ARGUMENT, umo_decoder_push_take(plain, NULL));
    FAILS(INVALID_ARGUMENT, umo_decoder_push_packet(player, bytes, 40));
    for (int time = 0; time < 2; time++) {
        uint32_t more = 1, done = 0;
        for (total = 0; !done; total += count) {
            OK(umo_decoder_push_take(player, &more));
            OK(umo_session_pull_frames(player, &layout, shown + total * stride, ROOM - total * stride, &count));
            OK(umo_session_is_done(player, &done));
        }
        CHECK(total == 90 && memcmp(frames, shown, total * stride) == 0);
        OK(umo_decoder_push_take(player, &more));
        CHECK(more == 0);
        OK(umo_session_reset(player));
    }
    OK(umo_session_free(player));
    OK(umo_session_free(avatar));
    OK(umo_session_free(plain));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    OK(umo_take_free(NULL));
    return 0;
}
