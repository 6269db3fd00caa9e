/* Preloaded into a command: reads of files return a part of the bytes, and every fifth read is interrupted. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include <unistd.h>

static atomic_uint calls;

/* Returns a shorter length, or 0 for an interrupted call. Pipes and devices have their own rules. */
static size_t shorter(int fd, size_t length) {
    struct stat facts;
    if (length < 2 || fstat(fd, &facts) != 0 || !S_ISREG(facts.st_mode)) return length;
    unsigned call = atomic_fetch_add(&calls, 1);
    if (call % 5 == 4) return 0;
    return call % 2 ? 1 : 1 + length / 3;
}

ssize_t read(int fd, void *to, size_t length) {
    ssize_t (*next)(int, void *, size_t) = dlsym(RTLD_NEXT, "read");
    size_t part = shorter(fd, length);
    if (part == 0 && length > 0) return errno = EINTR, -1;
    return next(fd, to, part);
}

ssize_t pread64(int fd, void *to, size_t length, off64_t offset) {
    ssize_t (*next)(int, void *, size_t, off64_t) = dlsym(RTLD_NEXT, "pread64");
    size_t part = shorter(fd, length);
    if (part == 0 && length > 0) return errno = EINTR, -1;
    return next(fd, to, part, offset);
}
