// What the NDK's crtbegin_so.o gives a shared library: the handle by which the C library knows it, the end of its life, and the
// note that says for which system it was linked.

extern void __cxa_finalize(void *);
__attribute__((visibility("hidden"))) void *__dso_handle = &__dso_handle;

__attribute__((destructor)) static void on_unload(void) { __cxa_finalize(&__dso_handle); }

// The ELF note of type 1, "Android": the API level.
__attribute__((section(".note.android.ident"), used, aligned(4))) static const struct {
    unsigned name_size, size, type;
    char name[8];
    unsigned api;
} note = {8, 4, 1, "Android", API};
