/* CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xFFFF, nothing reflected; "123456789" gives 0x29B1. */
#ifndef CRC_H
#define CRC_H

#include <stdint.h>

uint16_t crc16(const uint8_t *bytes, uint8_t length);

#endif
