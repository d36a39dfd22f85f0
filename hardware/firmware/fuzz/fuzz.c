/* Throws inputs at the board's logic and watches it: sound requests, mutated ones, random bytes, jumps of time.
   The same count and seed do the same again. An input is one of them; most are a frame of some ten bytes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define AN_EPISODE 300 /* inputs until the board boots anew: it may be stopped for good by then */

static uint64_t state;

static uint32_t chance(void) { /* xorshift64* */
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)(state * 0x2545F4914F6CDD1Du >> 32);
}

static uint32_t below(uint32_t limit) {
    return chance() % limit;
}

static struct board board;
static uint32_t now;
static uint64_t answered, accepted_sets;
static uint8_t sequence;

/* Where the line stands, kept apart from the board's own parser. */
static uint8_t line[256];
static unsigned line_length;

/* The last request that was understood. */
static uint8_t last[MOST_PAYLOAD];
static unsigned last_length;

static void boot(void) {
    memset(&board, 0, sizeof board);
    board_start(&board);
    board.servos = (uint8_t)(1 + below(MOST_SERVOS));
    board.nonce = (uint16_t)chance();
    now = chance(); /* also where the milliseconds wrap */
    line_length = last_length = 0;
}

/* Whether the line's bytes up to now are a sound request; written against the document, not the parser. */
static uint8_t sound(uint8_t *payload) {
    unsigned in = 0, out = 0;
    if (line_length == 0 || line_length > MOST_FRAME - 1)
        return 0;
    while (in < line_length) {
        unsigned code = line[in++];
        if (in + code - 1 > line_length)
            return 0;
        for (unsigned i = 1; i < code; i++)
            payload[out++] = line[in++];
        if (in < line_length)
            payload[out++] = 0;
    }
    if (out < 4 || out > MOST_PAYLOAD + 2 || payload[1] & REPLY)
        return 0;
    unsigned crc = 0xFFFF;
    for (unsigned i = 0; i < out - 2; i++)
        for (unsigned bit = 0; bit < 8; bit++)
            crc = (crc << 1 ^ ((crc >> 15 ^ payload[i] >> (7 - bit)) & 1 ? 0x1021 : 0)) & 0xFFFF;
    return crc == (unsigned)(payload[out - 2] << 8 | payload[out - 1]) ? (uint8_t)(out - 2) : 0;
}

static void send_byte(uint8_t byte) {
    uint8_t frame[MOST_FRAME], payload[256];
    struct seen before = look(&board);
    uint8_t asked = byte == 0 ? sound(payload) : 0;
    bool again = asked && asked == last_length && memcmp(payload, last, asked) == 0;
    uint8_t length = board_byte(&board, byte, now, frame);
    if (asked) {
        check_exchange(&before, &board, payload, asked, again, frame, length, now);
        answered++;
        if (understood_by(&board, payload, asked)) {
            memcpy(last, payload, asked);
            last_length = asked;
        }
        accepted_sets += payload[1] == SET && board.fed == now && board.pulsing;
    } else {
        CHECK(length == 0);
        check_noise(&before, &board);
    }
    check_always(&board);
    if (byte == 0)
        line_length = 0;
    else if (line_length < sizeof line)
        line[line_length++] = byte;
}

static uint8_t request(uint8_t *payload) {
    static const uint8_t often[] = {SET, SET, SET, SET, ARM, ARM, CONFIGURE, READ, HELLO, DISARM, CLEAR, NAME, STOP};
    uint8_t type = often[below(below(20) ? sizeof often - 1 : sizeof often)];
    uint8_t length = 2;
    if (below(8)) /* else the last one again, if the body is the same */
        sequence++;
    payload[0] = sequence;
    payload[1] = type;
    if (type == ARM) {
        uint16_t nonce = below(8) ? board.nonce : (uint16_t)chance();
        payload[length++] = (uint8_t)nonce;
        payload[length++] = (uint8_t)(nonce >> 8);
    }
    unsigned words = type == SET ? board.servos : type == CONFIGURE ? 2u * board.servos + 1 : 0;
    for (unsigned i = 0; i < words; i++) {
        uint32_t value = below(4) ? (i % 2 ? 3000 : 1000) + below(2001) : chance();
        if (type == CONFIGURE && i == words - 1)
            value = 1 + below(200);
        payload[length++] = (uint8_t)value;
        payload[length++] = (uint8_t)(value >> 8);
    }
    if (type == NAME)
        for (int i = 0; i < NAME_LENGTH; i++)
            payload[length++] = (uint8_t)(below(16) ? '!' + below(94) : 0);
    if (type == HELLO)
        payload[length++] = (uint8_t)below(3);
    while (below(24) == 0 && length < MOST_PAYLOAD) /* of a wrong length */
        payload[length++] = (uint8_t)chance();
    if (below(40) == 0)
        payload[1] = (uint8_t)chance();
    return length;
}

static void mutate(uint8_t *frame, unsigned *length, unsigned room) {
    for (unsigned times = 1 + below(3); times--;) {
        unsigned at = below(*length);
        switch (below(5)) {
        case 0: /* a bit flips */
            frame[at] ^= (uint8_t)(1u << below(8));
            break;
        case 1: /* a byte is lost */
            if (*length > 1)
                memmove(frame + at, frame + at + 1, --*length - at);
            break;
        case 2: /* one comes twice */
            if (*length < room) {
                memmove(frame + at + 1, frame + at, *length - at);
                ++*length;
            }
            break;
        case 3: /* another one comes */
            frame[at] = (uint8_t)chance();
            break;
        default: /* it is cut */
            *length = at + 1;
        }
    }
}

/* A retry, or one whose closing zero was damaged: it is one byte longer and its CRC is right. */
static void send_again(void) {
    uint8_t frame[MOST_FRAME];
    unsigned length = frame_of(last, (uint8_t)last_length, frame);
    bool damaged = below(3) == 0;
    for (unsigned i = 0; i < length; i++)
        send_byte(damaged && i == length - 1 ? 1 : frame[i]);
    if (damaged)
        send_byte(0);
}

static void send_frame(bool mutated) {
    uint8_t payload[MOST_PAYLOAD], frame[MOST_FRAME + 8];
    unsigned length = frame_of(payload, request(payload), frame);
    if (mutated)
        mutate(frame, &length, sizeof frame);
    for (unsigned i = 0; i < length; i++)
        send_byte(frame[i]);
}

static void pass_time(void) {
    struct seen before = look(&board);
    static const uint16_t edges[] = {HOLD_MS - 1, HOLD_MS, LIMP_MS - 1, LIMP_MS};
    uint32_t edge = board.fed + edges[below(4)]; /* just before and just when the watchdog barks */
    if (below(8) == 0 && edge - now < LIMP_MS)
        now = edge;
    else
        now += below(3) ? below(40) : below(20) ? below(700) : below(5000);
    board_tick(&board, now);
    check_tick(&before, &board, now);
    check_always(&board);
    before = look(&board);
    board_frame(&board);
    check_frame(&before, &board);
    check_always(&board);
    int16_t raw[3] = {(int16_t)chance(), (int16_t)chance(), (int16_t)chance()};
    if (below(4))
        imu_reading(&board.imu, raw, now);
    else
        imu_failure(&board.imu);
}

int main(int argc, char **argv) {
    uint64_t inputs = argc > 1 ? strtoull(argv[1], NULL, 10) : 100000;
    uint64_t seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    state = seed * 0x9E3779B97F4A7C15u + 1;
    for (input_number = 0; input_number < inputs; input_number++) {
        if (input_number % AN_EPISODE == 0)
            boot();
        uint32_t kind = below(16);
        if (kind == 0 && last_length)
            send_again();
        else if (kind < 7)
            send_frame(false);
        else if (kind < 11)
            send_frame(true);
        else if (kind < 13)
            for (uint32_t bytes = 1 + below(below(20) ? 12 : 300); bytes--;)
                send_byte((uint8_t)chance());
        else
            pass_time();
    }
    printf("%llu inputs, %llu requests answered, %llu pulses set, nothing found\n", (unsigned long long)inputs,
           (unsigned long long)answered, (unsigned long long)accepted_sets);
    return 0;
}
