/* A servo drive of CiA 402-2 and a motor that follows at once, for nodes on CANopen stacks of others.
 *
 * The stack has the objects; drive_step() is what a firmware does between two looks at them. It has nothing of rigd. Each
 * change of what the motor gets is a line on standard output: CLOCK_MONOTONIC in ns, enabled, torque in per mille, velocity in
 * counts/s; so is each loss of the connection to the master, as `lost` and a time. */
#pragma once
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

/* struct can_frame of linux/can.h, a packet of the simulated bus. */
struct frame {
    uint32_t id;
    uint8_t length, padding[3], data[8];
};

static inline int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static inline int join_bus(const char* path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strncpy(address.sun_path, path, sizeof address.sun_path - 1);
    int bus = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    if (bus < 0 || connect(bus, (struct sockaddr*)&address, sizeof address) != 0) {
        perror(path);
        exit(1);
    }
    return bus;
}

enum { NODE = 1, RATED_MILLIAMPERE = 1500, RATED_MILLINEWTONMETRE = 45, COUNTS_PER_TURN = 4096 };
enum { CST = 10, CSV = 9 };
enum { OFF = 0x250, READY = 0x231, SWITCHED_ON = 0x233, ENABLED = 0x1237, FAULT = 0x218 };

struct drive {
    uint16_t control, seen, status;
    int16_t target_torque, torque, abort_option;
    int32_t target_velocity, velocity, position;
    int8_t mode;
    double turned;
    bool was_lost;
};

/* The transitions of CiA 402-2, figure 3; `silent`: nothing is heard of the master; `operational`: so is this node. */
static inline void drive_step(struct drive* d, bool silent, bool operational, double dt) {
    bool lost = silent || !operational;
    bool before = d->status == ENABLED;
    int torque = d->torque, velocity = d->velocity;
    if (lost && !d->was_lost)
        printf("lost %lld\n", (long long)now_ns());
    if (lost && !d->was_lost && before && d->abort_option)
        d->status = FAULT;
    d->was_lost = lost;
    uint16_t risen = d->control & ~d->seen;
    d->seen = d->control;
    if (d->status == FAULT) {
        if ((risen & 0x80) && !silent)
            d->status = OFF;
    } else if (!(d->control & 0x02) || !(d->control & 0x04)) {
        d->status = OFF; /* disable voltage; a quick stop without ramp */
    } else if ((d->control & 0x07) == 0x06) {
        d->status = READY;
    } else if ((d->control & 0x0F) == 0x07 && d->status != OFF) {
        d->status = SWITCHED_ON;
    } else if ((d->control & 0x0F) == 0x0F && (d->status == SWITCHED_ON || d->status == READY)) {
        d->status = ENABLED;
    }
    bool enabled = d->status == ENABLED;
    d->torque = enabled && d->mode == CST ? d->target_torque : 0;
    d->velocity = enabled ? (d->mode == CSV ? d->target_velocity : 10 * d->torque) : 0;
    d->turned += d->velocity * dt;
    d->position = (int32_t)(int64_t)d->turned;
    if (enabled != before || d->torque != torque || d->velocity != velocity)
        printf("%lld %d %d %d\n", (long long)now_ns(), enabled, d->torque, d->velocity);
}
