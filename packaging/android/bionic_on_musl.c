/* Functions of bionic used by libumo.so that musl lacks or has under another name or number: for scripts/test/android,
 * where musl stands in for bionic. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <unistd.h>

int *__errno(void) { return &errno; }

/* A device without properties. */
int __system_property_get(const char *name, char *value) {
    (void)name;
    value[0] = 0;
    return 0;
}

/* Bionic's values of these constants, from its <bits/sysconf.h>. */
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
