/* What libumo.so asks of bionic that musl has by another name or number, or not at all: for scripts/test/android alone, where musl stands in the
 * place of bionic. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <unistd.h>

int *__errno(void) { return &errno; }

/* A device without a property. */
int __system_property_get(const char *name, char *value) {
    (void)name;
    value[0] = 0;
    return 0;
}

/* Bionic's numbers of these, in its <bits/sysconf.h>. */
enum { BIONIC_PAGESIZE = 0x27, BIONIC_PAGE_SIZE = 0x28, BIONIC_NPROCESSORS_ONLN = 0x61 };

long sysconf(int name) {
    long (*musl)(int) = (long (*)(int))dlsym(RTLD_NEXT, "sysconf");
    switch (name) {
    case BIONIC_PAGESIZE:
    case BIONIC_PAGE_SIZE: return musl(_SC_PAGESIZE);
    case BIONIC_NPROCESSORS_ONLN: return musl(_SC_NPROCESSORS_ONLN);
    default: errno = EINVAL; return -1;
    }
}
