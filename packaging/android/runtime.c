// Contents of the NDK's crtbegin_so.o for shared libraries: the handle that identifies it to the C library, its
// finalizer, and the note with the target system.

extern void __cxa_finalize(void *);
__attribute__((visibility("hidden"))) void *__dso_handle = &__dso_handle;

__attribute__((destructor)) static void on_unload(void) { __cxa_finalize(&__dso_handle); }

// The ELF note of type 1, "Android": the API level.
__attribute__((section(".note.android.ident"), used, aligned(4))) static const struct {
    unsigned name_size, size, type;
    char name[8];
    unsigned api;
} note = {8, 4, 1, "Android", API};
