// A disk without locks, links or syncs below paths that contain "poor-disk": POOR_DISK_FLOCK, POOR_DISK_LINK and POOR_DISK_SYNC are the
// numbers of the errors; POOR_DISK_SYNC is that of folders alone unless POOR_DISK_SYNC_FILES is set.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static int number(const char *name) {
    const char *value = getenv(name);
    return value ? atoi(value) : 0;
}

static int is_below(int fd) {
    char link[64], path[4096];
    ssize_t length;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, sizeof path - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    return strstr(path, "poor-disk") != NULL;
}

static int fail(int error) {
    errno = error;
    return -1;
}

int flock(int fd, int operation) {
    static int (*next)(int, int);
    if (!next) next = (int (*)(int, int))dlsym(RTLD_NEXT, "flock");
    int error = number("POOR_DISK_FLOCK");
    return error && is_below(fd) ? fail(error) : next(fd, operation);
}

int linkat(int from_folder, const char *from, int to_folder, const char *to, int flags) {
    static int (*next)(int, const char *, int, const char *, int);
    if (!next) next = (int (*)(int, const char *, int, const char *, int))dlsym(RTLD_NEXT, "linkat");
    int error = number("POOR_DISK_LINK");
    return error && strstr(to, "poor-disk") ? fail(error) : next(from_folder, from, to_folder, to, flags);
}

int link(const char *from, const char *to) {
    static int (*next)(const char *, const char *);
    if (!next) next = (int (*)(const char *, const char *))dlsym(RTLD_NEXT, "link");
    int error = number("POOR_DISK_LINK");
    return error && strstr(to, "poor-disk") ? fail(error) : next(from, to);
}

int fsync(int fd) {
    static int (*next)(int);
    struct stat found;
    if (!next) next = (int (*)(int))dlsym(RTLD_NEXT, "fsync");
    int error = number("POOR_DISK_SYNC");
    int is_meant = !fstat(fd, &found) && (S_ISDIR(found.st_mode) || number("POOR_DISK_SYNC_FILES"));
    return error && is_meant && is_below(fd) ? fail(error) : next(fd);
}
