/* The wire protocol, version 1, as numbers: hardware/PROTOCOL.md tells what they mean. */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#define PROTOCOL_VERSION 1
#define FIRMWARE_MAJOR 1
#define FIRMWARE_MINOR 0
#define FIRMWARE_PATCH 0

#define MOST_PAYLOAD 64 /* bytes: sequence number, type, body */
#define MOST_FRAME (MOST_PAYLOAD + 2 + 1 + 1) /* with the CRC, the COBS byte and the closing zero */

#define REPLY 0x80 /* in the type of every reply */

enum request {
    HELLO = 0x01,
    ARM = 0x02,
    DISARM = 0x03,
    SET = 0x04,
    READ = 0x05,
    STOP = 0x06,
    CONFIGURE = 0x07,
    NAME = 0x08,
    CLEAR = 0x09,
};

enum result {
    OK = 0,
    NOT_ARMED = 1,
    STOPPED = 2,
    BAD_NONCE = 3,
    BAD_LENGTH = 4,
    BAD_VALUE = 5,
    UNKNOWN_TYPE = 6,
    ONLY_DISARMED = 7,
    ALREADY_ARMED = 8,
};

enum flag {
    FLAG_ARMED = 1 << 0,
    FLAG_PULSES = 1 << 1,
    FLAG_HOLDING = 1 << 2,
    FLAG_HELD = 1 << 3,      /* latched until CLEAR */
    FLAG_WENT_LIMP = 1 << 4, /* latched until CLEAR */
    FLAG_STOPPED = 1 << 5,   /* latched until a reset */
    FLAG_CLAMPED = 1 << 6,   /* of this reply's command */
    FLAG_SLEWING = 1 << 7,
    FLAG_IMU_MISSING = 1 << 8,
    FLAG_IMU_STUCK = 1 << 9,
};

#define NAME_LENGTH 16
#define UNIQUE_LENGTH 8
#define MOST_SERVOS 2

/* Pulses are counted in half microseconds: the ticks of timer 1. */
#define HARD_LOW 1000u  /* 500 us: no hobby servo goes further */
#define HARD_HIGH 5000u /* 2500 us */

/* What holds from boot until CONFIGURE: timid on purpose. */
#define FIRST_LOW 2000u  /* 1000 us */
#define FIRST_HIGH 4000u /* 2000 us */
#define FIRST_SLEW 40u   /* 20 us a frame: about 90 degrees a second */

#define HOLD_MS 300u
#define LIMP_MS 2000u

#endif
