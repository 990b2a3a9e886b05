/* Loaded before the C library: lets the FAULT_AT-th call that changes files fail or end the process.
 *
 * FAULT_HOW is "before" or "after" (the process is killed there) or the number of an error that the call
 * returns. FAULT_COUNT names a file that is given a line for each call. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static long calls;

static long fault_at(void) {
    const char *at = getenv("FAULT_AT");
    return at ? atol(at) : -1;
}

static void end(void) { kill(getpid(), SIGKILL); }

/* Whether this call, the n-th, is to fail. */
static int fails(const char *name, long *n) {
    const char *how = getenv("FAULT_HOW"), *count = getenv("FAULT_COUNT");
    *n = __sync_add_and_fetch(&calls, 1);
    if (count) {
        FILE *file = fopen(count, "a");
        if (file) { fprintf(file, "%s\n", name); fclose(file); }
    }
    if (*n != fault_at() || !how) return 0;
    if (!strcmp(how, "before")) end();
    if (!strcmp(how, "after")) return 0;
    errno = atoi(how);
    return 1;
}

static void after(long n) {
    const char *how = getenv("FAULT_HOW");
    if (n == fault_at() && how && !strcmp(how, "after")) end();
}

#define CALL(type, name, parameters, arguments)                          \
    type name parameters {                                               \
        static type (*real) parameters;                                  \
        if (!real) real = (type (*) parameters)dlsym(RTLD_NEXT, #name);  \
        long n;                                                          \
        if (fails(#name, &n)) return -1;                                 \
        type result = real arguments;                                    \
        int kept = errno;                                                \
        after(n);                                                        \
        errno = kept;                                                    \
        return result;                                                   \
    }

CALL(int, rename, (const char *from, const char *to), (from, to))
CALL(int, renameat2, (int f, const char *from, int t, const char *to, unsigned flags), (f, from, t, to, flags))
CALL(int, mkdir, (const char *path, mode_t mode), (path, mode))
CALL(int, fsync, (int file), (file))
CALL(int, unlink, (const char *path), (path))
CALL(int, unlinkat, (int folder, const char *path, int flags), (folder, path, flags))
CALL(int, rmdir, (const char *path), (path))
CALL(int, link, (const char *from, const char *to), (from, to))
CALL(int, linkat, (int f, const char *from, int t, const char *to, int flags), (f, from, t, to, flags))
CALL(int, ftruncate64, (int file, off64_t length), (file, length))
CALL(ssize_t, pwrite64, (int file, const void *bytes, size_t count, off64_t at), (file, bytes, count, at))
CALL(ssize_t, copy_file_range, (int f, off64_t *a, int t, off64_t *b, size_t count, unsigned flags), (f, a, t, b, count, flags))

ssize_t write(int file, const void *bytes, size_t count) {
    static ssize_t (*real)(int, const void *, size_t);
    if (!real) real = (ssize_t(*)(int, const void *, size_t))dlsym(RTLD_NEXT, "write");
    struct stat status;
    /* Messages and what threads tell each other are no files. */
    if (file <= 2 || fstat(file, &status) || !S_ISREG(status.st_mode)) return real(file, bytes, count);
    long n;
    if (fails("write", &n)) return -1;
    ssize_t result = real(file, bytes, count);
    after(n);
    return result;
}

/* Opening counts where it may make a file. */
#define OPEN(name)                                                                                  \
    int name(const char *path, int flags, ...) {                                                   \
        static int (*real)(const char *, int, ...);                                                \
        if (!real) real = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, #name);                \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode_t mode = va_arg(rest, int);                                                           \
        va_end(rest);                                                                              \
        long n = 0;                                                                                \
        if (flags & O_CREAT && fails(#name, &n)) return -1;                                        \
        int result = real(path, flags, mode);                                                      \
        int kept = errno;                                                                          \
        if (flags & O_CREAT) after(n);                                                             \
        errno = kept;                                                                              \
        return result;                                                                             \
    }

OPEN(open64)
/* SQLite's. */
OPEN(open)
