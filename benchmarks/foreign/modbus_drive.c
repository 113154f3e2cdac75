/* modbus_drive PORT: a drive on a server of libmodbus that looks at its command word every 2 ms; registers of an Altivar 320
 * (NVE41308, NVE41316). Each change of its speed is a line on standard output: CLOCK_MONOTONIC in ns, enabled, speed in rpm. */
#include <errno.h>
#include <modbus.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { CMD = 8501, ETA = 3201, LFRD = 8602, RFRD = 8604, SLL = 7010, TTO = 6005, LFT = 7121, LAST = 10000 };
enum { READY = 0x231, SWITCHED_ON = 0x233, ENABLED = 0x237, DISABLED = 0x250, FAULT = 0x218, LOST = 5, CLIENTS = 8 };

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static void scan(uint16_t* words, int64_t heard) {
    static uint16_t seen;
    uint16_t command = words[CMD], risen = command & ~seen, state = words[ETA];
    int speed = (int16_t)words[RFRD];
    seen = command;
    if (state == FAULT)
        state = risen & 0x80 ? DISABLED : FAULT;
    else if (heard && words[SLL] && now_ns() - heard > words[TTO] * 100000000LL) {
        words[LFT] = LOST;
        state = FAULT;
    } else if ((command & 0xF) == 0x6)
        state = READY;
    else if ((command & 0xF) == 0x7 && (state == READY || state == ENABLED))
        state = SWITCHED_ON;
    else if ((command & 0xF) == 0xF && state == SWITCHED_ON)
        state = ENABLED;
    else if (!(command & 0x2))
        state = DISABLED;
    int enabled = state == ENABLED, turns = enabled ? (int16_t)words[LFRD] : 0;
    if (turns != speed || enabled != (words[ETA] == ENABLED))
        printf("%lld %d %d\n", (long long)now_ns(), enabled, turns);
    words[ETA] = state;
    words[RFRD] = (uint16_t)turns;
}

int main(int count, char** arguments) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (count != 2)
        return 2;
    modbus_t* server = modbus_new_tcp("127.0.0.1", atoi(arguments[1]));
    modbus_mapping_t* map = modbus_mapping_new(0, 0, LAST, 0);
    int listening = modbus_tcp_listen(server, CLIENTS);
    if (listening < 0) {
        perror("modbus_tcp_listen");
        return 1;
    }
    uint16_t* words = map->tab_registers;
    words[ETA] = DISABLED;
    words[TTO] = 100;
    struct pollfd sockets[CLIENTS + 1] = {{.fd = listening, .events = POLLIN}};
    for (int i = 1; i <= CLIENTS; i++)
        sockets[i] = (struct pollfd){.fd = -1, .events = POLLIN};
    int drives = 0; /* who wrote last commands the drive: its requests feed the watchdog */
    for (int64_t heard = 0;;) {
        poll(sockets, CLIENTS + 1, 2);
        for (int i = 0; i <= CLIENTS; i++) {
            if (sockets[i].fd < 0 || !sockets[i].revents)
                continue;
            if (i == 0) {
                int client = accept(listening, NULL, NULL);
                for (int free = 1; free <= CLIENTS && client >= 0; free++)
                    if (sockets[free].fd < 0) {
                        sockets[free].fd = client;
                        client = -1;
                    }
                if (client >= 0)
                    close(client);
                continue;
            }
            uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
            modbus_set_socket(server, sockets[i].fd);
            int size = modbus_receive(server, request);
            if (size < 0) {
                close(sockets[i].fd);
                sockets[i].fd = -1;
                continue;
            }
            if (size > 7 && (request[7] == 6 || request[7] == 16))
                drives = i;
            if (i == drives)
                heard = now_ns();
            modbus_reply(server, request, size, map);
        }
        scan(words, heard);
    }
}
