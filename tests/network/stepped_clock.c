/* Steps the system's clock for one process: preloaded, it adds to CLOCK_REALTIME what stands in a file.

   The file, named by MABIRDS_CLOCK_FILE, holds one int64 in nanoseconds and is mapped, so that whoever writes it steps
   the clock of all processes that have it at once. Steady clocks stay. Waits until a time of the system's clock look
   again every SLICE, as the kernel does for them when the real clock is set. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define SLICE (SECOND / 10)
#define EPOCHAL 500000000LL /* seconds: times below are of a steady clock */

static const volatile int64_t *offset;
static int (*original)(clockid_t, struct timespec *);

__attribute__((constructor)) static void begin(void) {
    const char *name = getenv("MABIRDS_CLOCK_FILE");
    int file = name ? open(name, O_RDONLY | O_CLOEXEC) : -1;
    void *found = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *offset, PROT_READ, MAP_SHARED, file, 0);
    if (found == MAP_FAILED) abort();
    close(file);
    offset = found;
    original = dlsym(RTLD_NEXT, "clock_gettime");
}

static int64_t number(const struct timespec *time) { return time->tv_sec * SECOND + time->tv_nsec; }

static struct timespec timespec(int64_t number) {
    struct timespec time = {number / SECOND, number % SECOND};
    return time;
}

static int64_t real_now(void) {
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_REALTIME, &now);
    return number(&now);
}

static int64_t stepped_now(void) { return real_now() + (offset ? *offset : 0); }

int clock_gettime(clockid_t clock, struct timespec *time) {
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) {
        *time = timespec(stepped_now());
        return 0;
    }
    return original ? original(clock, time) : (int)syscall(SYS_clock_gettime, clock, time);
}

int gettimeofday(struct timeval *restrict time, void *restrict zone) {
    int64_t now = stepped_now();
    (void)zone;
    time->tv_sec = now / SECOND;
    time->tv_usec = now % SECOND / 1000;
    return 0;
}

time_t time(time_t *place) {
    time_t now = stepped_now() / SECOND;
    if (place) *place = now;
    return now;
}

/* The end of the next slice of a wait until `deadline`, by the real clock. */
static struct timespec slice(const struct timespec *deadline) {
    int64_t end = number(deadline) - *offset, soon = real_now() + SLICE;
    return timespec(end < soon ? end : soon);
}

#define WAIT(deadline, attempt, timed_out)                                                                    \
    for (;;) {                                                                                                \
        struct timespec until = slice(deadline);                                                              \
        int result = attempt;                                                                                 \
        if (!(timed_out) || stepped_now() >= number(deadline)) return result;                                 \
    }

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict deadline) {
    if (deadline->tv_sec < EPOCHAL) return pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, deadline);
    WAIT(deadline, pthread_cond_clockwait(condition, mutex, CLOCK_REALTIME, &until), result == ETIMEDOUT)
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict mutex, const struct timespec *restrict deadline) {
    WAIT(deadline, pthread_mutex_clocklock(mutex, CLOCK_REALTIME, &until), result == ETIMEDOUT)
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict deadline) {
    WAIT(deadline, sem_clockwait(semaphore, CLOCK_REALTIME, &until), result == -1 && errno == ETIMEDOUT)
}
