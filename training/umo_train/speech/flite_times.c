/* Speaks with flite and prints the times: reads lines
   `voice TAB stretch TAB f0 mean (0: the voice's) TAB wav TAB text`, writes each wav, and prints per line its
   segments `phone TAB end TAB stress TAB accented TAB word number TAB word` and an empty line. */
#include <flite/flite.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

cst_voice *register_cmu_us_rms(const char *);
cst_voice *register_cmu_us_slt(const char *);
cst_voice *register_cmu_us_awb(const char *);
cst_voice *register_cmu_us_kal(const char *);
cst_voice *register_cmu_us_kal16(const char *);

static cst_voice *voice_of(const char *name) {
    static struct { const char *name; cst_voice *(*make)(const char *); cst_voice *made; } voices[] = {
        {"rms", register_cmu_us_rms, NULL}, {"slt", register_cmu_us_slt, NULL}, {"awb", register_cmu_us_awb, NULL},
        {"kal", register_cmu_us_kal, NULL}, {"kal16", register_cmu_us_kal16, NULL},
    };
    for (size_t i = 0; i < sizeof voices / sizeof *voices; i++)
        if (strcmp(voices[i].name, name) == 0) {
            if (voices[i].made == NULL) voices[i].made = voices[i].make(NULL);
            return voices[i].made;
        }
    fprintf(stderr, "no flite voice %s\n", name);
    exit(2);
}

static void print_segments(cst_utterance *utterance) {
    const cst_item *word_before = NULL;
    int words = 0;
    for (cst_item *s = relation_head(utt_relation(utterance, "Segment")); s != NULL; s = item_next(s)) {
        cst_item *in_word = item_as(s, "SylStructure");
        cst_item *syllable = in_word ? item_parent(in_word) : NULL;
        cst_item *word = syllable ? item_parent(syllable) : NULL;
        int stress = 0, accented = 0;
        if (syllable != NULL) {
            stress = strcmp(ffeature_string(syllable, "stress"), "1") == 0;
            accented = strcmp(ffeature_string(syllable, "accented"), "1") == 0;
        }
        /* Each relation has its own items over shared contents. */
        const cst_item *same = word ? item_as(word, "Word") : NULL;
        if (same != NULL && same != word_before) words++;
        if (same != NULL) word_before = same;
        printf("%s\t%.5f\t%d\t%d\t%d\t%s\n", item_feat_string(s, "name"), item_feat_float(s, "end"), stress, accented,
               same ? words : 0, word ? item_feat_string(word, "name") : "");
    }
    printf("\n");
    fflush(stdout);
}

int main(void) {
    static char line[1 << 16];
    flite_init();
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *voice_name = strtok(line, "\t"), *stretch = strtok(NULL, "\t"), *f0 = strtok(NULL, "\t");
        const char *path = strtok(NULL, "\t"), *text = strtok(NULL, "\n");
        if (text == NULL) { fprintf(stderr, "a line needs five fields\n"); return 2; }
        cst_voice *voice = voice_of(voice_name);
        feat_set_float(voice->features, "duration_stretch", (float)atof(stretch));
        if (atof(f0) > 0) feat_set_float(voice->features, "int_f0_target_mean", (float)atof(f0));
        cst_utterance *utterance = flite_synth_text(text, voice);
        if (utterance == NULL || cst_wave_save_riff(utt_wave(utterance), path) != CST_OK_FORMAT) {
            fprintf(stderr, "flite cannot speak or write: %s\n", path);
            return 1;
        }
        print_segments(utterance);
        delete_utterance(utterance);
    }
    return 0;
}
