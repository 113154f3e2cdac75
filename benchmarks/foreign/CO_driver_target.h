/* What CANopenNode asks of a target, for a little-endian Linux with one thread (301/CO_driver.h says what each is). */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CO_LITTLE_ENDIAN
#define CO_SWAP_16(x) x
#define CO_SWAP_32(x) x
#define CO_SWAP_64(x) x
#define CO_CONFIG_STORAGE 0
#define CO_CONFIG_LEDS 0
#define CO_CONFIG_LSS 0
/* RPDOs that time out are an error of CiA 301; the rest is as the stack has it. */
#define CO_CONFIG_PDO                                                                                                  \
    (CO_CONFIG_RPDO_ENABLE | CO_CONFIG_TPDO_ENABLE | CO_CONFIG_RPDO_TIMERS_ENABLE | CO_CONFIG_TPDO_TIMERS_ENABLE        \
     | CO_CONFIG_PDO_SYNC_ENABLE | CO_CONFIG_PDO_OD_IO_ACCESS | CO_CONFIG_FLAG_OD_DYNAMIC)

typedef uint_fast8_t bool_t;
typedef float float32_t;
typedef double float64_t;

typedef struct {
    uint16_t id;
    uint8_t length, data[8];
} received_t;
#define CO_CANrxMsg_readIdent(message) (((received_t*)(message))->id)
#define CO_CANrxMsg_readDLC(message)   (((received_t*)(message))->length)
#define CO_CANrxMsg_readData(message)  ((const uint8_t*)((received_t*)(message))->data)

typedef struct {
    uint16_t ident, mask;
    void* object;
    void (*CANrx_callback)(void* object, void* message);
} CO_CANrx_t;
typedef struct {
    uint32_t ident;
    uint8_t DLC, data[8];
    volatile bool_t bufferFull, syncFlag;
} CO_CANtx_t;
typedef struct {
    void* CANptr;
    CO_CANrx_t* rxArray;
    uint16_t rxSize;
    CO_CANtx_t* txArray;
    uint16_t txSize, CANerrorStatus;
    volatile bool_t CANnormal, bufferInhibitFlag, firstCANtxMessage;
    volatile uint16_t CANtxCount;
} CO_CANmodule_t;
typedef struct {
    void* addr;
    size_t len;
    uint8_t subIndexOD, attr;
} CO_storage_entry_t;

#define CO_LOCK_CAN_SEND(module)
#define CO_UNLOCK_CAN_SEND(module)
#define CO_LOCK_EMCY(module)
#define CO_UNLOCK_EMCY(module)
#define CO_LOCK_OD(module)
#define CO_UNLOCK_OD(module)
#define CO_MemoryBarrier()
#define CO_FLAG_READ(flag)  ((flag) != NULL)
#define CO_FLAG_SET(flag)   ((flag) = (void*)1)
#define CO_FLAG_CLEAR(flag) ((flag) = NULL)
