#include "frames.h"

#include <string.h>

#include "cobs.h"
#include "crc.h"

void count(uint16_t *counter) {
    if (*counter != UINT16_MAX)
        ++*counter;
}

static uint8_t payload_of(struct parser *parser, uint8_t length) {
    int16_t decoded = cobs_decode(parser->bytes, length);
    if (decoded < 4) { /* sequence number, type and CRC; no more than MOST_PAYLOAD + 2 had room in parser->bytes */
        count(&parser->framing_errors);
        return 0;
    }
    uint8_t payload = (uint8_t)(decoded - 2);
    uint16_t sent = (uint16_t)(parser->bytes[payload] << 8) | parser->bytes[payload + 1];
    if (crc16(parser->bytes, payload) != sent) {
        count(&parser->crc_errors);
        return 0;
    }
    if (parser->bytes[1] & REPLY) { /* an echo of our own words is nothing to answer */
        count(&parser->framing_errors);
        return 0;
    }
    return payload;
}

uint8_t parser_take(struct parser *parser, uint8_t byte) {
    if (byte != 0) {
        if (parser->length < sizeof parser->bytes)
            parser->bytes[parser->length++] = byte;
        else
            parser->overlong = true;
        return 0;
    }
    uint8_t length = parser->length;
    bool overlong = parser->overlong;
    parser->length = 0;
    parser->overlong = false;
    if (overlong) {
        count(&parser->framing_errors);
        return 0;
    }
    return length == 0 ? 0 : payload_of(parser, length); /* a host may send zeros to clear the line */
}

uint8_t frame_of(const uint8_t *payload, uint8_t length, uint8_t *frame) {
    uint8_t plain[MOST_PAYLOAD + 2];
    uint16_t crc = crc16(payload, length);
    memcpy(plain, payload, length);
    plain[length] = (uint8_t)(crc >> 8);
    plain[length + 1] = (uint8_t)crc;
    uint8_t end = cobs_encode(plain, (uint8_t)(length + 2), frame);
    frame[end] = 0;
    return (uint8_t)(end + 1);
}
