/*
 * A crowd over a network: `crowd MODEL speech.wav [AVATARS] [VIEWERS] [LOSS]`.
 *
 * A server animates AVATARS (64) and sends packets; VIEWERS (8) decode all of them, of which a share LOSS (0.1) does
 * not arrive. Prints the bytes a second compared with poses, the processor time of both sides, and the losses. C11 and
 * umo.h only.
 *
 *     cc -std=c11 crowd.c $(pkg-config --cflags --libs umo) -lm -o crowd
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "umo.h"

/* Samples pushed to every avatar at a time: a tenth of a second. */
enum { RATE = 16000, PIECE = RATE / 10, PACKETS = 8 };

static void check(umo_status status, const char *what) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "crowd: %s: %s: %s\n", what, umo_status_message(status), umo_last_error());
    exit(1);
}

static void *room(size_t size) {
    void *memory = calloc(1, size);
    if (!memory) exit(1);
    return memory;
}

/* Reads the 16-bit samples of a 16 kHz mono WAV file with a 44-byte header, such as this repository's speech. */
static size_t read_speech(const char *path, int16_t **samples) {
    unsigned char head[44];
    FILE *file = fopen(path, "rb");
    if (!file || fread(head, 1, 44, file) != 44 || memcmp(head, "RIFF", 4) != 0 || memcmp(head + 36, "data", 4) != 0) {
        fprintf(stderr, "crowd: %s is not a WAV file of 16-bit samples, 16 kHz, mono\n", path);
        exit(1);
    }
    size_t size = head[40] | (size_t)head[41] << 8 | (size_t)head[42] << 16 | (size_t)head[43] << 24;
    *samples = room(size + 2);
    size_t count = fread(*samples, 2, size / 2, file);
    fclose(file);
    return count;
}

/* Whether a packet arrives: the same ones in every run. */
static int arrives(double loss) {
    static uint64_t state = 1;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 40) / (double)(1u << 24) >= loss;
}

static double processor_seconds(void) { return (double)clock() / CLOCKS_PER_SEC; }

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "crowd MODEL speech.wav [AVATARS] [VIEWERS] [LOSS]\n");
        return 1;
    }
    const size_t avatars = argc > 3 ? (size_t)atoi(argv[3]) : 64, viewers = argc > 4 ? (size_t)atoi(argv[4]) : 8;
    const double loss = argc > 5 ? atof(argv[5]) : 0.1;
    int16_t *speech;
    const size_t samples = read_speech(argv[2], &speech);

    umo_model *model;
    umo_engine *engine;
    umo_engine_config engine_config;
    umo_session_config config;
    umo_frame_layout layout;
    check(umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &model), "the model");
    check(umo_frame_layout_init(&layout, sizeof layout, model), "the layout");
    check(umo_engine_config_init(&engine_config, sizeof engine_config), "the engine");
    engine_config.mode = UMO_ENGINE_POLLED;
    engine_config.threads = 1;
    engine_config.max_sessions = (uint32_t)avatars;
    check(umo_engine_new(model, &engine_config, &engine), "the engine");
    check(umo_session_config_init(&config, sizeof config, model), "the configuration");

    /* The server's avatars output packets only; every viewer has a decoder for each of them. */
    umo_session **senders = room(avatars * sizeof *senders), **decoders = room(avatars * viewers * sizeof *decoders);
    for (size_t i = 0; i < avatars; i++) {
        config.seed = i;
        config.packets = UMO_PACKETS_ONLY;
        check(umo_session_new(engine, &config, &senders[i]), "a session");
        config.packets = UMO_PACKETS_NONE;
        for (size_t viewer = 0; viewer < viewers; viewer++) {
            check(umo_decoder_new(model, &config, &decoders[viewer * avatars + i]), "a decoder");
        }
    }

    size_t size = 0, packets = 0, bytes = 0, shown = 0, lengths[PACKETS];
    check(umo_session_packet_size(senders[0], &size), "the size of packets");
    char *buffer = room(PACKETS * size), *pose = room(layout.frame_stride);
    double computing = 0.0, decoding = 0.0, showing = 0.0;
    for (size_t at = 0; at < samples; at += PIECE) {
        const size_t piece = samples - at < PIECE ? samples - at : PIECE;
        double start = processor_seconds();
        for (size_t i = 0; i < avatars; i++) {
            size_t taken;
            check(umo_session_push_audio_i16(senders[i], speech + at, piece, &taken), "audio");
            if (at + piece == samples) check(umo_session_finish(senders[i]), "the end");
        }
        uint32_t more = 1;
        while (more) check(umo_engine_poll(engine, 1000000, &more), "computing");
        computing += processor_seconds() - start;
        for (size_t i = 0; i < avatars; i++) {
            size_t count = 0;
            check(umo_session_pull_packets(senders[i], buffer, PACKETS * size, lengths, PACKETS, &count), "packets");
            start = processor_seconds();
            for (size_t packet = 0, from = 0; packet < count; from += lengths[packet++]) {
                packets++;
                bytes += lengths[packet];
                for (size_t viewer = 0; viewer < viewers; viewer++) {
                    if (!arrives(loss)) continue;
                    check(umo_decoder_push_packet(decoders[viewer * avatars + i], buffer + from, lengths[packet]), "a packet");
                }
            }
            decoding += processor_seconds() - start;
        }
        /* Three frames per block, of every avatar at every viewer, half a second behind the newest frame. */
        start = processor_seconds();
        for (size_t i = 0; i < avatars * viewers; i++) {
            for (int picture = 0; picture < 3; picture++) {
                const double time = (double)at / RATE + picture / 30.0 - 1.5;
                check(umo_session_sample_pose(decoders[i], time > 0.0 ? time : 0.0, &layout, pose, layout.frame_stride, NULL), "a pose");
                shown++;
            }
        }
        showing += processor_seconds() - start;
    }

    umo_received all = {0};
    for (size_t i = 0; i < avatars * viewers; i++) {
        umo_received stats = {0};
        stats.struct_size = sizeof stats;
        check(umo_decoder_stats(decoders[i], &stats), "what came");
        all.packets += stats.packets;
        all.lost += stats.lost;
        all.held += stats.held;
        check(umo_session_free(decoders[i]), "a decoder");
    }
    const double seconds = (double)samples / RATE, each = (double)bytes / seconds / (double)avatars;
    umo_model_info info = {0};
    info.struct_size = sizeof info;
    check(umo_model_get_info(model, &info), "the model");
    const double poses = (double)info.frame_rate * 4.0 * (3 + 4 * UMO_JOINT_COUNT + info.channels);
    printf("%zu avatars, %zu viewers, %.1f s of speech, %.0f %% lost\n", avatars, viewers, seconds, 100.0 * loss);
    printf("one avatar:    %.0f bytes/s in packets of %.0f, %.0f bytes/s as poses: 1/%.0f\n", each, (double)bytes / (double)packets, poses, poses / each);
    printf("one viewer:    %.1f kB/s in packets, %.1f kB/s as poses\n", each * (double)avatars / 1e3, poses * (double)avatars / 1e3);
    printf("the server:    %.1f kB/s in packets, %.1f kB/s as poses\n", each * (double)(avatars * viewers) / 1e3, poses * (double)(avatars * viewers) / 1e3);
    const double made = computing / (double)avatars / seconds, decoded = decoding / (double)(avatars * viewers) / seconds;
    printf("processor:     %.2f ms a second to animate an avatar, %.3f ms to decode one: 1/%.0f\n", 1e3 * made, 1e3 * decoded, made / decoded);
    printf("layers:        %.3f ms a second and avatar for %zu poses\n", 1e3 * showing / (double)(avatars * viewers) / seconds, shown / avatars / viewers);
    printf("lost packets:  %llu of %llu chunks, %llu keyframes held\n", (unsigned long long)all.lost, (unsigned long long)(all.packets + all.lost),
           (unsigned long long)all.held);

    for (size_t i = 0; i < avatars; i++) check(umo_session_free(senders[i]), "a session");
    check(umo_engine_free(engine), "the engine");
    check(umo_model_free(model), "the model");
    free(senders);
    free(decoders);
    free(buffer);
    free(pose);
    free(speech);
    return 0;
}
