/* Bytes from the line into payloads, and payloads into bytes for the line. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

struct parser {
    uint8_t bytes[MOST_FRAME - 1]; /* of the frame that is arriving; decoded in place when it ends */
    uint8_t length;
    bool overlong;
    uint16_t crc_errors;
    uint16_t framing_errors;
};

/* Takes one byte; the length of the payload (now at parser->bytes) if a sound frame ended with it, else 0. */
uint8_t parser_take(struct parser *parser, uint8_t byte);

/* Puts a payload of at most MOST_PAYLOAD bytes into a frame; `frame` has room for MOST_FRAME. Returns its length. */
uint8_t frame_of(const uint8_t *payload, uint8_t length, uint8_t *frame);

/* One more, but never round to zero: a count that has wrapped looks like a quiet line. */
void count(uint16_t *counter);

#endif
