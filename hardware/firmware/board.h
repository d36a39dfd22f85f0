/* The board without its wires: what it is, what it is told, and what it lets out. Time always comes as an argument. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "frames.h"
#include "imu.h"
#include "protocol.h"

struct servo {
    uint16_t low, high; /* half microseconds, as are the others */
    uint16_t target;    /* as commanded and clamped */
    uint16_t pulse;     /* as it goes out from the coming frame on; means nothing unless board.pulsing */
};

struct board {
    /* who it is; filled in at boot */
    uint8_t name[NAME_LENGTH];
    uint8_t unique[UNIQUE_LENGTH];
    uint16_t nonce;
    uint8_t reset_cause;
    uint8_t servos;
    bool renamed; /* the name is to be kept; whoever keeps it clears this */

    struct servo servo[MOST_SERVOS];
    uint16_t slew; /* half microseconds a frame */

    bool armed;
    bool pulsing; /* armed, and a SET has come since */
    bool holding;
    bool stopped;
    uint16_t latched; /* FLAG_HELD, FLAG_WENT_LIMP */
    uint32_t fed;     /* ms of the last SET, or of ARM before the first */

    struct imu imu;
    struct parser parser;
    uint16_t overruns;
    uint16_t repeated;

    /* the last exchange that was understood, for a host that did not hear its end */
    uint8_t asked[MOST_PAYLOAD];
    uint8_t asked_length;
    uint8_t answer[MOST_PAYLOAD];
    uint8_t answer_length;
};

/* Everything as after boot: disarmed, timid limits. The identity is left as it is. */
void board_start(struct board *board);

/* Takes one byte from the line. If a request ends with it: the length of its reply, put to `frame`; else 0. */
uint8_t board_byte(struct board *board, uint8_t byte, uint32_t now, uint8_t frame[MOST_FRAME]);

/* To be called every millisecond or so: the watchdog over the host. */
void board_tick(struct board *board, uint32_t now);

/* To be called once a servo frame, before its pulses are loaded: moves them towards their targets. */
void board_frame(struct board *board);

/* Pulses stop. */
void board_disarm(struct board *board);

/* Pulses stop, and nothing but a reset lets them come back. */
void board_stop(struct board *board);

/* The reply (payload) to a sound request (payload); in commands.c. */
uint8_t board_answer(struct board *board, const uint8_t *asked, uint8_t length, uint32_t now, uint8_t *answer);

#endif
