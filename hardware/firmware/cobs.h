/* Consistent overhead byte stuffing: no zero inside, so a zero always ends a frame. */
#ifndef COBS_H
#define COBS_H

#include <stdint.h>

/* Both take up to 253 bytes, so one code byte and no block of full length are enough. */

/* Writes length + 1 bytes to `to`, which must not overlap; returns how many. */
uint8_t cobs_encode(const uint8_t *from, uint8_t length, uint8_t *to);

/* Decodes in place; returns the length, or -1 if these bytes are not COBS. */
int16_t cobs_decode(uint8_t *bytes, uint8_t length);

#endif
