/* Preloaded by scripts/at_day: moves the clock of the calendar by RIGD_AT_DAY seconds, and no other.
 *
 * libfaketime does more, and too much: before 0.9.11 it moves times of the monotonic clock until
 * which Python sleeps, although told to leave that clock alone, and its waits on conditions make a
 * run in virtual time take three times the CPU seconds (Debian 12, 0.9.10, measured).
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static time_t moved;
static int (*real_clock_gettime)(clockid_t, struct timespec *);

__attribute__((constructor)) static void begin(void)
{
    const char *given = getenv("RIGD_AT_DAY");
    real_clock_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    moved = given ? atoll(given) : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int failed = real_clock_gettime ? real_clock_gettime(clock, now)
                                    : (int)syscall(SYS_clock_gettime, clock, now);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        now->tv_sec += moved;
    return failed;
}

int timespec_get(struct timespec *now, int base)
{
    return base == TIME_UTC && clock_gettime(CLOCK_REALTIME, now) == 0 ? base : 0;
}

int gettimeofday(struct timeval *now, void *zone)
{
    struct timespec exact;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *where)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return where ? (*where = now.tv_sec) : now.tv_sec;
}

/* The locks of multiprocessing wait until a time of this clock. */
int sem_timedwait(sem_t *semaphore, const struct timespec *until)
{
    static int (*real)(sem_t *, const struct timespec *);
    struct timespec moved_back = {until->tv_sec - moved, until->tv_nsec};
    if (!real)
        real = dlsym(RTLD_NEXT, "sem_timedwait");
    return real(semaphore, &moved_back);
}
