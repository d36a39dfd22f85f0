#include "crc.h"

uint16_t crc16(const uint8_t *bytes, uint8_t length) {
    uint16_t crc = 0xFFFF;
    while (length--) {
        /* All eight shifts of the bitwise division at once; no table, which the flash has better use for. */
        crc = (uint16_t)((crc >> 8) | (crc << 8));
        crc ^= *bytes++;
        crc ^= (crc & 0xFF) >> 4;
        crc ^= (uint16_t)(crc << 12);
        crc ^= (uint16_t)((crc & 0xFF) << 5);
    }
    return crc;
}
