/*
 * A face for Unreal's Live Link, without a plugin: `livelink MODEL speech.wav ADDRESS PORT [SUBJECT]`.
 *
 * Speaks the recording in real time and sends each frame's face and head by UDP, as the Live Link Face app does:
 * `livelink MODEL speech.wav 127.0.0.1 11111`. docs/vmc.md has the format and the settings in Unreal. C11, POSIX
 * sockets, umo.h.
 *
 *     cc -std=c11 -D_DEFAULT_SOURCE livelink.c $(pkg-config --cflags --libs umo) -lm -o livelink
 */

#include <arpa/inet.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "umo.h"

/* Samples pushed at a time: a thirtieth of a second, one frame. */
enum { RATE = 16000, FPS = 30, PIECE = RATE / FPS, SHAPES = 52, VALUES = SHAPES + 9, NECK = 12, HEAD = 15, LEFT_EYE = 23, RIGHT_EYE = 24 };

typedef struct {
    float rotations[UMO_JOINT_COUNT][4];
    float face[SHAPES];
} frame;

static void check(umo_status status, const char *what) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "livelink: %s: %s: %s\n", what, umo_status_message(status), umo_last_error());
    exit(1);
}

static void stop(const char *what) {
    fprintf(stderr, "livelink: %s\n", what);
    exit(1);
}

/* A packet under construction, big endian. */
typedef struct {
    unsigned char bytes[512];
    size_t size;
} packet;

static void put(packet *to, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) to->bytes[to->size++] = (unsigned char)(value >> shift);
}

static void put_float(packet *to, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put(to, bits);
}

static void put_text(packet *to, const char *text) {
    size_t length = strlen(text);
    put(to, (uint32_t)length);
    memcpy(to->bytes + to->size, text, length);
    to->size += length;
}

/* Yaw about Y, pitch about X and roll about Z, in radians, of a unit quaternion that equals yaw * pitch * roll. */
static void put_angles(packet *to, const float q[4]) {
    double x = q[0], y = q[1], z = q[2], w = q[3];
    double sine = 2 * (w * x - y * z);
    put_float(to, (float)atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y)));
    put_float(to, (float)asin(sine > 1 ? 1 : sine < -1 ? -1 : sine));
    put_float(to, (float)atan2(2 * (x * y + w * z), 1 - 2 * (x * x + z * z)));
}

/* `a * b`: applies `b` first, then `a`. */
static void product(const float a[4], const float b[4], float q[4]) {
    q[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
    q[1] = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2];
    q[2] = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0];
    q[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

/* Writes a frame in the app's format; the model's channels are ARKit's, in Apple's order. */
static void fill(packet *to, const char *subject, uint32_t number, const frame *shown) {
    float head[4];
    to->size = 0;
    to->bytes[to->size++] = 6;                              /* version */
    put_text(to, "756D6F00-0000-4000-8000-000000000001");   /* device: any UUID, unique per sender */
    put_text(to, subject);
    put(to, number);
    put_float(to, 0);                                       /* part of a frame */
    put(to, FPS);
    put(to, 1);
    to->bytes[to->size++] = VALUES;
    for (int i = 0; i < SHAPES; i++) put_float(to, shown->face[i]);
    product(shown->rotations[NECK], shown->rotations[HEAD], head);
    put_angles(to, head);
    put_angles(to, shown->rotations[LEFT_EYE]);
    put_angles(to, shown->rotations[RIGHT_EYE]);
}

/* Reads the 16-bit samples of a 16 kHz mono WAV file with a 44-byte header, such as this repository's speech. */
static size_t read_speech(const char *path, int16_t **samples) {
    unsigned char head[44];
    FILE *file = fopen(path, "rb");
    if (!file || fread(head, 1, 44, file) != 44 || memcmp(head, "RIFF", 4) != 0 || memcmp(head + 36, "data", 4) != 0) {
        stop("expected a WAV file of 16-bit samples, 16 kHz, mono");
    }
    size_t size = head[40] | (size_t)head[41] << 8 | (size_t)head[42] << 16 | (size_t)head[43] << 24;
    *samples = malloc(size + 2);
    if (!*samples) stop("no memory");
    size_t count = fread(*samples, 2, size / 2, file);
    fclose(file);
    return count;
}

/* A session for live speech with an ARKit face model, and its frame layout. */
static umo_session *begin(const char *path, umo_model **model, umo_engine **engine, umo_frame_layout *layout) {
    umo_session *avatar;
    umo_session_config config;
    umo_model_info info = {.struct_size = sizeof info};
    check(umo_model_load(UMO_ABI_VERSION, path, NULL, model), path);
    check(umo_model_get_info(*model, &info), path);
    if (!info.is_arkit || info.channels != SHAPES) stop("the model's face is not ARKit's");
    check(umo_engine_new(*model, NULL, engine), "engine");
    check(umo_session_config_init(&config, sizeof config, *model), "session");
    config.sample_rate = RATE;
    config.target = 1;
    if (info.has_mouth) config.voice = UMO_VOICE_LIVE;
    check(umo_session_new(*engine, &config, &avatar), "session");
    check(umo_frame_layout_init(layout, sizeof *layout, *model), "layout");
    layout->frame_stride = sizeof(frame);
    layout->index = layout->sample = layout->translation = layout->visemes = UMO_ABSENT;
    layout->rotations = 0;
    layout->channels = offsetof(frame, face);
    return avatar;
}

int main(int argc, char **argv) {
    if (argc < 5 || argc > 6) stop("usage: livelink MODEL speech.wav ADDRESS PORT [SUBJECT]");
    const char *subject = argc > 5 ? argv[5] : "umo";
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)strtoul(argv[4], NULL, 10))};
    if (inet_pton(AF_INET, argv[3], &to.sin_addr) != 1 || strlen(subject) > 64) stop("expected an address such as 127.0.0.1, and a short name");
    int udp = socket(AF_INET, SOCK_DGRAM, 0);
    if (udp < 0) stop("no socket");
    int16_t *speech;
    size_t count = read_speech(argv[2], &speech), pushed = 0;
    umo_model *model;
    umo_engine *engine;
    umo_frame_layout layout;
    umo_session *avatar = begin(argv[1], &model, &engine, &layout);

    /* Every thirtieth of a second, push the speech spoken meanwhile and send each ready frame: the mouth is in sync
       with it. */
    const struct timespec pause = {0, 1000000000 / FPS};
    uint32_t sent = 0, done = 0;
    static packet out;
    while (!done) {
        size_t taken = 0, ready = 0, piece = count - pushed < PIECE ? count - pushed : PIECE;
        if (piece > 0) {
            check(umo_session_push_audio_i16(avatar, speech + pushed, piece, &taken), "audio");
            pushed += taken;
            if (pushed == count) check(umo_session_finish(avatar), "audio");
        }
        for (;;) {
            frame shown;
            check(umo_session_pull_frames(avatar, &layout, &shown, sizeof shown, &ready), "frames");
            if (ready == 0) break;
            fill(&out, subject, sent++, &shown);
            /* Nobody may be listening yet. */
            (void)!sendto(udp, out.bytes, out.size, 0, (const struct sockaddr *)&to, sizeof to);
        }
        check(umo_session_is_done(avatar, &done), "frames");
        nanosleep(&pause, NULL);
    }
    printf("%u frames sent\n", sent);

    check(umo_session_free(avatar), "free");
    check(umo_engine_free(engine), "free");
    check(umo_model_free(model), "free");
    free(speech);
    close(udp);
    return 0;
}
