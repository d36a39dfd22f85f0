/* What a board may and may not do, written a second time and only from hardware/PROTOCOL.md. */
#ifndef MODEL_H
#define MODEL_H

#include "../board.h"

/* What a request may have changed, seen from outside. */
struct seen {
    bool armed, pulsing, holding, stopped;
    uint16_t latched;
    uint32_t fed;
    uint16_t slew;
    struct servo servo[MOST_SERVOS];
    uint16_t crc_errors, framing_errors, repeated;
};

struct seen look(const struct board *board);

/* All that must hold at any moment. */
void check_always(const struct board *board);

/* A request (payload) was answered with `frame` (`length` bytes; 0: not at all). */
void check_exchange(const struct seen *before, const struct board *board, const uint8_t *asked, uint8_t asked_length,
                    bool again, const uint8_t *frame, uint8_t length, uint32_t now);

/* Whether this request (payload) is of a known type and a right length. */
bool understood_by(const struct board *board, const uint8_t *asked, uint8_t length);

/* Noise changed nothing but the counters. */
void check_noise(const struct seen *before, const struct board *board);

/* Time has passed up to `now`, looked at in one step. */
void check_tick(const struct seen *before, const struct board *board, uint32_t now);

/* A frame's pulses were moved on. */
void check_frame(const struct seen *before, const struct board *board);

/* Ends the run, with the input's number, unless this holds. */
#define CHECK(holds) check(holds, #holds, __FILE__, __LINE__)
void check(bool holds, const char *what, const char *file, int line);

extern uint64_t input_number;

#endif
