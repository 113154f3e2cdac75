/* The witness: a bare loop on absolute deadlines, to judge a machine and other loops by.
 *
 *   witness PERIOD_US SECONDS PRIORITY OUTPUT
 *
 * Writes one line per cycle that began more than 250 us late or was missed, then a summary as JSON:
 * slots, missed, lateness p50/p99/p99.9/max in us. SCHED_FIFO, memory locked, no deep sleep. A slot
 * that has passed is skipped, as rigd does.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv)
{
    if (argc != 5) {
        fprintf(stderr, "witness PERIOD_US SECONDS PRIORITY OUTPUT\n");
        return 2;
    }
    const int64_t period = atoll(argv[1]) * 1000;
    const int64_t slots = (int64_t)(atof(argv[2]) * 1e9) / period;
    struct sched_param param = {.sched_priority = atoi(argv[3])};
    FILE *out = fopen(argv[4], "w");
    int32_t *late = calloc(slots, sizeof *late);
    if (!out || !late) {
        perror("witness");
        return 1;
    }
    memset(late, 0x7f, slots * sizeof *late); /* touch every page */
    const int32_t zero = 0;
    const int fd = open("/dev/cpu_dma_latency", O_WRONLY);
    if (fd >= 0 && write(fd, &zero, sizeof zero) < 0)
        perror("cpu_dma_latency");
    if (mlockall(MCL_CURRENT | MCL_FUTURE) || sched_setscheduler(0, SCHED_FIFO, &param))
        perror("witness runs without real time");

    const int64_t origin = now_ns() + period;
    int64_t ran = 0, missed = 0;
    for (int64_t slot = 0; slot < slots; slot++) {
        const int64_t due = origin + slot * period;
        int64_t begun = now_ns();
        if (begun >= due + period) {
            const int64_t next = (begun - origin) / period;
            missed += next - slot;
            fprintf(out, "missed %lld %lld\n", (long long)due, (long long)(begun - due));
            slot = next;
            late[ran++] = (int32_t)((begun - origin - next * period) / 1000);
            continue;
        }
        if (begun < due) {
            const struct timespec t = {due / 1000000000, due % 1000000000};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
            begun = now_ns();
        }
        late[ran++] = (int32_t)((begun - due) / 1000);
        if (begun - due > 250000)
            fprintf(out, "late %lld %lld\n", (long long)due, (long long)(begun - due));
    }
    qsort(late, ran, sizeof *late, ascending);
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    const double cpu = used.ru_utime.tv_sec + used.ru_stime.tv_sec +
                       1e-6 * (used.ru_utime.tv_usec + used.ru_stime.tv_usec);
    fclose(out);
    printf("{\"slots\": %lld, \"missed\": %lld, \"p50_us\": %d, \"p99_us\": %d, \"p999_us\": %d, "
           "\"max_us\": %d, \"cpu_us_per_cycle\": %.2f}\n",
           (long long)slots, (long long)missed, late[ran / 2], late[ran * 99 / 100],
           late[ran * 999 / 1000], late[ran - 1], cpu * 1e6 / ran);
    return 0;
}
