#include "cobs.h"

uint8_t cobs_encode(const uint8_t *from, uint8_t length, uint8_t *to) {
    uint8_t code = 0; /* where the distance to the next zero belongs */
    uint8_t end = 1;
    for (uint8_t i = 0; i < length; i++) {
        if (from[i] == 0) {
            to[code] = end - code;
            code = end++;
        } else {
            to[end++] = from[i];
        }
    }
    to[code] = end - code;
    return end;
}

int16_t cobs_decode(uint8_t *bytes, uint8_t length) {
    uint8_t in = 0;
    uint8_t out = 0;
    while (in < length) {
        uint8_t code = bytes[in];
        if (code == 0 || code > length - in)
            return -1;
        for (uint8_t i = 1; i < code; i++) {
            if (bytes[in + i] == 0)
                return -1;
            bytes[out++] = bytes[in + i];
        }
        in += code;
        if (in < length)
            bytes[out++] = 0;
    }
    return length == 0 ? -1 : out;
}
