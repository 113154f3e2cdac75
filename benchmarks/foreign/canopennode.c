/* canopennode SOCKET [epos4]: a drive at node 1 on CANopenNode, on the simulated bus at SOCKET.
 *
 * With `epos4` its ratings are those of a maxon EPOS4: 3001 in place of 6075, and 6076 in uN m (its EDS and firmware
 * specification).
 * The objects of communication are those of the stack's example (example/OD.c, DS301); those of the drive are added here. */
#define OD_DEFINITION
#include <poll.h>

#include "301/CO_ODinterface.h"
#include "CANopen.h"
#include "OD.h"
#include "drive.h"

static struct drive motor = {.status = OFF, .abort_option = 1};
static uint8_t shown_mode;
static uint32_t rated_current = RATED_MILLIAMPERE, rated_torque = RATED_MILLINEWTONMETRE, outputs,
                modes = 1u << (CST - 1) | 1u << (CSV - 1), resolution[2] = {COUNTS_PER_TURN, 1};
static uint16_t max_current = 1333;
static uint8_t two = 2, one = 1;

#define VAR(index, variable, access)                                                                                   \
    static OD_obj_var_t o_##index = {&variable, (access) | (sizeof variable > 1 ? ODA_MB : 0), sizeof variable}
VAR(0x6007, motor.abort_option, ODA_SDO_RW);
VAR(0x6040, motor.control, ODA_SDO_RW | ODA_TRPDO);
VAR(0x6041, motor.status, ODA_SDO_R | ODA_TPDO);
VAR(0x6060, motor.mode, ODA_SDO_RW | ODA_TRPDO);
VAR(0x6061, shown_mode, ODA_SDO_R | ODA_TPDO);
VAR(0x6064, motor.position, ODA_SDO_R | ODA_TPDO);
VAR(0x606C, motor.velocity, ODA_SDO_R | ODA_TPDO);
VAR(0x6071, motor.target_torque, ODA_SDO_RW | ODA_TRPDO);
VAR(0x6073, max_current, ODA_SDO_RW);
VAR(0x6075, rated_current, ODA_SDO_R);
VAR(0x6076, rated_torque, ODA_SDO_R);
VAR(0x6077, motor.torque, ODA_SDO_R | ODA_TPDO);
VAR(0x60FF, motor.target_velocity, ODA_SDO_RW | ODA_TRPDO);
VAR(0x6502, modes, ODA_SDO_R);
static uint8_t five = 5;
static uint32_t motor_data[] = {RATED_MILLIAMPERE, 0, 0, 0, RATED_MILLINEWTONMETRE * 1000000 / RATED_MILLIAMPERE};
#define MOTOR(sub) {&motor_data[sub - 1], sub, ODA_SDO_R | ODA_MB, 4}
static OD_obj_record_t o_0x3001[] = {{&five, 0, ODA_SDO_R, 1}, MOTOR(1), MOTOR(2), MOTOR(3), MOTOR(4), MOTOR(5)};
static OD_obj_record_t o_0x608F[] = {{&two, 0, ODA_SDO_R, 1},
                                     {&resolution[0], 1, ODA_SDO_R | ODA_MB, 4},
                                     {&resolution[1], 2, ODA_SDO_R | ODA_MB, 4}};
static OD_obj_record_t o_0x60FE[] = {{&one, 0, ODA_SDO_R, 1}, {&outputs, 1, ODA_SDO_RW | ODA_TRPDO | ODA_MB, 4}};
#define ENTRY(index) {index, 1, ODT_VAR, &o_##index, NULL}
static OD_entry_t own[] = {
    ENTRY(0x6007), ENTRY(0x6040), ENTRY(0x6041), ENTRY(0x6060), ENTRY(0x6061),
    ENTRY(0x6064), ENTRY(0x606C), ENTRY(0x6071), ENTRY(0x6073), ENTRY(0x6075), ENTRY(0x6076),
    ENTRY(0x6077), {0x608F, 3, ODT_REC, o_0x608F, NULL}, {0x60FE, 2, ODT_REC, o_0x60FE, NULL},
    ENTRY(0x60FF), ENTRY(0x6502), {0x3001, 6, ODT_REC, o_0x3001, NULL},
};

/* Of the two kinds of ratings only one is there: the other becomes an object that no master asks for. */
static void hide(uint16_t index, uint16_t place) {
    for (size_t i = 0; i < sizeof own / sizeof *own; i++)
        if (own[i].index == index)
            own[i].index = place;
}

static int by_index(const void* a, const void* b) {
    return ((const OD_entry_t*)a)->index - ((const OD_entry_t*)b)->index;
}

/* Adds them behind those of the example: the stack knows the places of these. */
static void complete(OD_t* dictionary) {
    size_t ours = sizeof own / sizeof *own, all = dictionary->size + ours;
    OD_entry_t* list = calloc(all + 1, sizeof *list);
    qsort(own, ours, sizeof *own, by_index);
    memcpy(list, dictionary->list, dictionary->size * sizeof *list);
    memcpy(list + dictionary->size, own, sizeof own);
    *dictionary = (OD_t){.size = all, .list = list};
}

/* -- what the stack asks of its CAN driver ------------------------------------------------------------------------------ */

static int bus;

void CO_CANsetConfigurationMode(void* pointer) { (void)pointer; }
void CO_CANsetNormalMode(CO_CANmodule_t* module) { module->CANnormal = true; }
void CO_CANmodule_disable(CO_CANmodule_t* module) { (void)module; }
void CO_CANmodule_process(CO_CANmodule_t* module) { (void)module; }
void CO_CANclearPendingSyncPDOs(CO_CANmodule_t* module) { (void)module; }

CO_ReturnError_t CO_CANmodule_init(CO_CANmodule_t* module, void* pointer, CO_CANrx_t rx[], uint16_t rx_size, CO_CANtx_t tx[],
                                   uint16_t tx_size, uint16_t rate) {
    (void)rate;
    memset(rx, 0, rx_size * sizeof *rx);
    memset(tx, 0, tx_size * sizeof *tx);
    *module = (CO_CANmodule_t){.CANptr = pointer, .rxArray = rx, .rxSize = rx_size, .txArray = tx, .txSize = tx_size};
    return CO_ERROR_NO;
}

CO_ReturnError_t CO_CANrxBufferInit(CO_CANmodule_t* module, uint16_t index, uint16_t ident, uint16_t mask, bool_t rtr,
                                    void* object, void (*callback)(void*, void*)) {
    (void)rtr; /* the bus carries no remote frames */
    if (index >= module->rxSize || callback == NULL)
        return CO_ERROR_ILLEGAL_ARGUMENT;
    module->rxArray[index] = (CO_CANrx_t){ident & 0x7FF, mask & 0x7FF, object, callback};
    return CO_ERROR_NO;
}

CO_CANtx_t* CO_CANtxBufferInit(CO_CANmodule_t* module, uint16_t index, uint16_t ident, bool_t rtr, uint8_t length,
                               bool_t synchronous) {
    (void)rtr;
    if (index >= module->txSize)
        return NULL;
    module->txArray[index] = (CO_CANtx_t){.ident = ident & 0x7FF, .DLC = length, .syncFlag = synchronous};
    return &module->txArray[index];
}

CO_ReturnError_t CO_CANsend(CO_CANmodule_t* module, CO_CANtx_t* buffer) {
    struct frame frame = {.id = buffer->ident, .length = buffer->DLC};
    memcpy(frame.data, buffer->data, 8);
    module->firstCANtxMessage = false;
    return send(bus, &frame, sizeof frame, 0) == sizeof frame ? CO_ERROR_NO : CO_ERROR_TX_OVERFLOW;
}

static void receive(CO_CANmodule_t* module, const struct frame* frame) {
    received_t message = {.id = frame->id, .length = frame->length};
    memcpy(message.data, frame->data, 8);
    for (int i = 0; i < module->rxSize; i++) {
        CO_CANrx_t* rx = &module->rxArray[i];
        if (rx->CANrx_callback && !((message.id ^ rx->ident) & rx->mask)) {
            rx->CANrx_callback(rx->object, &message);
            return;
        }
    }
}

/* -- the node ----------------------------------------------------------------------------------------------------------- */

static CO_NMT_reset_cmd_t turn(CO_t* co) {
    static int64_t last;
    int64_t now = now_ns();
    uint32_t passed_us = last ? (uint32_t)((now - last) / 1000) : 0;
    last += last ? passed_us * 1000LL : now;
    CO_NMT_reset_cmd_t reset = CO_process(co, false, passed_us, NULL);
    bool sync = CO_process_SYNC(co, passed_us, NULL);
    CO_process_RPDO(co, sync, passed_us, NULL);
    bool silent = CO_isError(co->em, CO_EM_HEARTBEAT_CONSUMER) || CO_isError(co->em, CO_EM_RPDO_TIME_OUT);
    drive_step(&motor, silent, CO_NMT_getInternalState(co->NMT) == CO_NMT_OPERATIONAL, passed_us * 1e-6);
    shown_mode = motor.mode;
    CO_process_TPDO(co, sync, passed_us, NULL);
    return reset;
}

int main(int count, char** arguments) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (count < 2)
        return 2;
    bool epos4 = count > 2 && !strcmp(arguments[2], "epos4");
    hide(epos4 ? 0x6075 : 0x3001, 0x5FFF);
    if (epos4)
        rated_torque *= 1000;
    bus = join_bus(arguments[1]);
    uint32_t heap, fault;
    CO_t* co = CO_new(NULL, &heap);
    complete(OD);
    OD_set_u32(OD_find(OD, 0x1000), 0, 0x20192, true);
    OD_set_u32(OD_find(OD, 0x1018), 1, epos4 ? 0xFB : 0x1234, true);
    for (CO_NMT_reset_cmd_t reset = CO_RESET_COMM; reset != CO_RESET_QUIT;) {
        motor.status = OFF;
        co->CANmodule->CANnormal = false;
        if (CO_CANinit(co, &bus, 1000) != CO_ERROR_NO
            || CO_CANopenInit(co, NULL, NULL, OD, NULL, CO_NMT_ERR_ON_ERR_REG | CO_ERR_REG_COMMUNICATION, 100,
                              1000, 500, false, NODE, &fault)
                   != CO_ERROR_NO
            || CO_CANopenInitPDO(co, co->em, OD, NODE, &fault) != CO_ERROR_NO) {
            fprintf(stderr, "the stack refuses object 0x%X\n", fault);
            return 1;
        }
        CO_CANsetNormalMode(co->CANmodule);
        do {
            struct pollfd ready = {.fd = bus, .events = POLLIN};
            poll(&ready, 1, 1);
            struct frame frame;
            for (ssize_t size; (size = recv(bus, &frame, sizeof frame, MSG_DONTWAIT)) >= 0;) {
                if (size == 0)
                    return 0; /* the bus is gone */
                receive(co->CANmodule, &frame);
                if (frame.id == 0x80 && frame.length <= 1)
                    break; /* heed a SYNC before what comes after it */
            }
            reset = turn(co);
        } while (reset == CO_RESET_NOT);
    }
    return 0;
}
