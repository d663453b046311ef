/* What Rust's thread sanitizer calls and gcc's runtime does not have: its own memset and so on are watched anyway. */

#include <string.h>

void *__tsan_memset(void *to, int value, size_t size) { return memset(to, value, size); }
void *__tsan_memcpy(void *to, const void *from, size_t size) { return memcpy(to, from, size); }
void *__tsan_memmove(void *to, const void *from, size_t size) { return memmove(to, from, size); }
