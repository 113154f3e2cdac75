/* lely SOCKET EDS: a drive at node 1 on lely-core, on the simulated bus at SOCKET, with the objects of the file EDS. */
#include <poll.h>

#include <lely/can/net.h>
#include <lely/co/dcf.h>
#include <lely/co/dev.h>
#include <lely/co/nmt.h>

#include "drive.h"

static struct drive motor = {.status = OFF, .abort_option = 1};
static bool silent;
static int bus;

static int to_bus(const struct can_msg* message, void* data) {
    (void)data;
    struct frame frame = {.id = message->id, .length = message->len};
    memcpy(frame.data, message->data, 8);
    return send(bus, &frame, sizeof frame, 0) == sizeof frame ? 0 : -1;
}

static void heard(co_nmt_t* nmt, co_unsigned8_t id, int state, int reason, void* data) {
    (void)data;
    if (reason == CO_NMT_EC_TIMEOUT)
        silent = state == CO_NMT_EC_OCCURRED;
    co_nmt_on_hb(nmt, id, state, reason); /* as the stack does it: emergency, and object 1029 */
}

static void look(co_dev_t* device, co_nmt_t* nmt, double dt) {
    motor.control = co_dev_get_val_u16(device, 0x6040, 0);
    motor.mode = co_dev_get_val_i8(device, 0x6060, 0);
    motor.target_torque = co_dev_get_val_i16(device, 0x6071, 0);
    motor.target_velocity = co_dev_get_val_i32(device, 0x60FF, 0);
    motor.abort_option = co_dev_get_val_i16(device, 0x6007, 0);
    drive_step(&motor, silent, co_nmt_get_st(nmt) == CO_NMT_ST_START, dt);
    co_dev_set_val_u16(device, 0x6041, 0, motor.status);
    co_dev_set_val_i8(device, 0x6061, 0, motor.mode);
    co_dev_set_val_i32(device, 0x6064, 0, motor.position);
    co_dev_set_val_i32(device, 0x606C, 0, motor.velocity);
    co_dev_set_val_i16(device, 0x6077, 0, motor.torque);
}

int main(int count, char** arguments) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (count != 3)
        return 2;
    bus = join_bus(arguments[1]);
    can_net_t* net = can_net_create();
    can_net_set_send_func(net, to_bus, NULL);
    co_dev_t* device = co_dev_create_from_dcf_file(arguments[2]);
    if (device == NULL || co_dev_set_id(device, NODE) != 0) {
        fprintf(stderr, "the stack refuses %s\n", arguments[2]);
        return 1;
    }
    co_dev_set_val_u32(device, 0x6075, 0, RATED_MILLIAMPERE);
    co_dev_set_val_u32(device, 0x6076, 0, RATED_MILLINEWTONMETRE);
    co_dev_set_val_u16(device, 0x6073, 0, 1333);
    co_dev_set_val_u32(device, 0x6502, 0, 1u << (CST - 1) | 1u << (CSV - 1));
    co_dev_set_val_u32(device, 0x60A9, 0, 0); /* it does not state the unit of its velocities */
    co_dev_set_val_u32(device, 0x608F, 1, COUNTS_PER_TURN);
    co_dev_set_val_u32(device, 0x608F, 2, 1);
    co_nmt_t* nmt = co_nmt_create(net, device);
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    can_net_set_time(net, &now);
    co_nmt_set_hb_ind(nmt, heard, NULL);
    co_nmt_cs_ind(nmt, CO_NMT_CS_RESET_NODE);
    for (int64_t last = now_ns();;) {
        struct pollfd ready = {.fd = bus, .events = POLLIN};
        poll(&ready, 1, 1);
        clock_gettime(CLOCK_MONOTONIC, &now);
        can_net_set_time(net, &now);
        struct frame frame;
        for (ssize_t size; (size = recv(bus, &frame, sizeof frame, MSG_DONTWAIT)) >= 0;) {
            if (size == 0)
                return 0; /* the bus is gone */
            struct can_msg message = {.id = frame.id, .len = frame.length};
            memcpy(message.data, frame.data, 8);
            can_net_recv(net, &message);
            int64_t at = now_ns();
            look(device, nmt, (at - last) * 1e-9);
            last = at;
        }
        int64_t at = now_ns();
        look(device, nmt, (at - last) * 1e-9);
        last = at;
    }
}
