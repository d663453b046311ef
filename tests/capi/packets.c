/* Packets out of a session and into decoders: identical bits, refusals, and the effect of losses. */

#include "check.h"

enum { SAMPLES = 16000 * 5, ROOM = 1 << 20, MOST = 64, PACKET = 1024, JAW = 22 };

static float speech[SAMPLES];
static char frames[ROOM], shown[ROOM];
static char packets[MOST][PACKET];
static size_t lengths[MOST];

static void without_layers(umo_session *avatar) {
    for (uint32_t layer = UMO_PARAMETER_LAYER_GAZE; layer <= UMO_PARAMETER_LAYER_BODY; layer++) {
        OK(umo_session_set_parameter(avatar, layer, 0.0));
    }
}

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
    CHECK(config.packets == UMO_PACKETS_NONE && config.packet_history == config.target && config.reorder_window == 0);
    umo_session *sender = NULL, *plain = NULL, *decoder = NULL, *lossy = NULL;
    OK(umo_session_new(engine, &config, &plain));
    config.packets = 3;
    FAILS(INVALID_ARGUMENT, umo_session_new(engine, &config, &sender));
    config.packets = UMO_PACKETS_BESIDE_FRAMES;
    OK(umo_session_new(engine, &config, &sender));
    FAILS(INVALID_ARGUMENT, umo_decoder_new(model, &config, &decoder));
    config.packets = UMO_PACKETS_NONE;
    config.reorder_window = 5;
    FAILS(INVALID_ARGUMENT, umo_decoder_new(model, &config, &decoder));
    CHECK(strstr(umo_last_error(), "reorder_window"));
    FAILS(INVALID_HANDLE, umo_decoder_new((umo_model *)engine, NULL, &decoder));
    FAILS(NULL_POINTER, umo_decoder_new(model, NULL, NULL));
    OK(umo_decoder_new(model, NULL, &decoder));
    config.reorder_window = 1;
    OK(umo_decoder_new(model, &config, &lossy));

    size_t size = 0, count = 0, taken = 0;
    OK(umo_session_packet_size(plain, &size));
    CHECK(size == 0);
    FAILS(INVALID_ARGUMENT, umo_session_pull_packets(plain, packets, sizeof packets, lengths, MOST, &count));
    OK(umo_session_packet_size(sender, &size));
    CHECK(size > 100 && size < PACKET);
    FAILS(BUFFER_TOO_SMALL, umo_session_pull_packets(sender, packets, size - 1, lengths, MOST, &count));
    FAILS(NULL_POINTER, umo_session_pull_packets(sender, packets, size, lengths, MOST, NULL));
    FAILS(NULL_POINTER, umo_session_pull_packets(sender, NULL, size, lengths, MOST, &count));
    OK(umo_session_pull_packets(sender, packets, sizeof packets, lengths, MOST, &count));
    CHECK(count == 0);
    without_layers(sender);
    without_layers(decoder);
    without_layers(lossy);

    /* Everything pushed, and everything shown. */
    size_t said = 0, total = 0;
    for (size_t at = 0; at < SAMPLES; at += 8000) {
        OK(umo_session_push_audio(sender, speech + at, 8000, &taken));
        if (at + 8000 == SAMPLES) OK(umo_session_finish(sender));
        compute(engine);
        for (;;) {
            OK(umo_session_pull_packets(sender, packets[said], PACKET, lengths + said, 1, &count));
            if (count == 0) break;
            said++;
            CHECK(said < MOST);
        }
        OK(umo_session_pull_frames(sender, &layout, frames + total * stride, ROOM - total * stride, &count));
        total += count;
    }
    CHECK(total == 150 && said >= 10);

    umo_received stats;
    memset(&stats, 0, sizeof stats);
    FAILS(STRUCT_SIZE, umo_decoder_stats(decoder, &stats));
    stats.struct_size = sizeof stats;
    FAILS(INVALID_ARGUMENT, umo_decoder_stats(sender, &stats));
    FAILS(INVALID_ARGUMENT, umo_decoder_push_packet(sender, packets[0], lengths[0]));
    FAILS(INVALID_ARGUMENT, umo_session_push_audio(decoder, speech, 10, &taken));
    FAILS(INVALID_ARGUMENT, umo_session_finish(decoder));
    FAILS(NULL_POINTER, umo_decoder_push_packet(decoder, NULL, 10));

    size_t got = 0, lost = 0;
    for (size_t i = 0; i < said; i++) {
        FAILS(PACKET, umo_decoder_push_packet(decoder, packets[i], lengths[i] - 1));
        FAILS(PACKET, umo_decoder_push_packet(decoder, packets[i], 0));
        packets[i][0] ^= 0x40;
        FAILS(PACKET, umo_decoder_push_packet(decoder, packets[i], lengths[i]));
        packets[i][0] ^= 0x40;
        OK(umo_decoder_push_packet(decoder, packets[i], lengths[i]));
        OK(umo_session_pull_frames(decoder, &layout, shown + got * stride, ROOM - got * stride, &count));
        got += count;
    }
    char text[UMO_ERROR_SIZE];
    OK(umo_session_last_error(decoder, text, sizeof text, NULL));
    CHECK(strstr(text, "not a packet"));
    CHECK(got == total && memcmp(frames, shown, total * stride) == 0);
    uint32_t done = 0;
    OK(umo_session_is_done(decoder, &done));
    CHECK(done == 1);
    OK(umo_decoder_stats(decoder, &stats));
    CHECK(stats.packets == said && stats.late == 0 && stats.lost == 0 && stats.held == 0);

    /* Every fourth packet is lost, the others arrive twice and each second pair in the wrong order: the body is the same.
       What lost packets say of the mouth is not said again. */
    got = 0;
    for (size_t i = 0; i < said; i++) {
        if (i % 4 == 2 && i + 1 < said) {
            lost++;
            continue;
        }
        size_t now = i % 4 == 0 && i + 1 < said ? i + 1 : i % 4 == 1 ? i - 1 : i;
        for (int twice = 0; twice < 2; twice++) OK(umo_decoder_push_packet(lossy, packets[now], lengths[now]));
        OK(umo_session_pull_frames(lossy, &layout, shown + got * stride, ROOM - got * stride, &count));
        got += count;
    }
    OK(umo_decoder_stats(lossy, &stats));
    CHECK(stats.packets == said - lost && stats.late == said - lost && stats.lost == lost && stats.held == 0);
    CHECK(got > 100 && layout.rotations < layout.channels);
    for (size_t at = 0; at < got * stride; at += stride) {
        memset(frames + at + layout.rotations + JAW * 4 * sizeof(float), 0, 4 * sizeof(float));
        memset(shown + at + layout.rotations + JAW * 4 * sizeof(float), 0, 4 * sizeof(float));
        CHECK(memcmp(frames + at, shown + at, layout.channels) == 0);
    }

    OK(umo_session_free(sender));
    OK(umo_session_free(plain));
    OK(umo_session_free(decoder));
    OK(umo_session_free(lossy));
    FAILS(INVALID_HANDLE, umo_decoder_push_packet(decoder, packets[0], lengths[0]));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return 0;
}
