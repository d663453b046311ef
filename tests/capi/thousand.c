/* A thousand sessions, a hundred engines, ten models, created and freed in every order: for valgrind. */

#include "check.h"

int main(int argc, char **argv) {
    CHECK(argc == 2);
    static float speech[20000];
    speak(speech, 20000, 0);
    for (int m = 0; m < 10; m++) {
        umo_model *model = load_model(argv[1]);
        for (int e = 0; e < 10; e++) {
            umo_engine *engine = polled_engine(model);
            umo_session *avatars[10];
            for (int s = 0; s < 10; s++) {
                OK(umo_session_new(engine, NULL, &avatars[s]));
                OK(umo_session_push_audio(avatars[s], speech, 1000, NULL));
            }
            /* One of them in the middle of a chunk. */
            if (e == 0) {
                OK(umo_session_push_audio(avatars[3], speech, 20000, NULL));
                OK(umo_engine_poll(engine, 0, NULL));
                OK(umo_engine_poll(engine, 0, NULL));
            }
            if (e % 2) OK(umo_engine_free(engine));
            for (int s = 0; s < 10; s++) OK(umo_session_free(avatars[e % 3 ? s : 9 - s]));
            if (e % 2 == 0) OK(umo_engine_free(engine));
        }
        OK(umo_model_free(model));
    }
    return 0;
}
