#include "model.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../cobs.h"
#include "../crc.h"

uint64_t input_number;

void check(bool holds, const char *what, const char *file, int line) {
    if (holds)
        return;
    fprintf(stderr, "%s:%d: input %llu: not so: %s\n", file, line, (unsigned long long)input_number, what);
    exit(1);
}

struct seen look(const struct board *board) {
    struct seen seen = {
        .armed = board->armed,
        .pulsing = board->pulsing,
        .holding = board->holding,
        .stopped = board->stopped,
        .latched = board->latched,
        .fed = board->fed,
        .slew = board->slew,
        .crc_errors = board->parser.crc_errors,
        .framing_errors = board->parser.framing_errors,
        .repeated = board->repeated,
    };
    memcpy(seen.servo, board->servo, sizeof seen.servo);
    return seen;
}

void check_always(const struct board *board) {
    CHECK(!board->pulsing || board->armed);
    CHECK(!board->holding || board->pulsing);
    CHECK(!(board->armed && board->stopped));
    CHECK(board->slew > 0);
    for (int i = 0; i < board->servos; i++) {
        const struct servo *servo = &board->servo[i];
        CHECK(servo->low >= HARD_LOW && servo->high <= HARD_HIGH && servo->low <= servo->high);
        if (!board->pulsing)
            continue;
        CHECK(servo->target >= servo->low && servo->target <= servo->high);
        CHECK(servo->pulse >= servo->low && servo->pulse <= servo->high);
    }
}

bool understood_by(const struct board *board, const uint8_t *asked, uint8_t length) {
    unsigned n = board->servos;
    switch (asked[1]) {
    case HELLO:
        return true;
    case ARM:
        return length == 2 + 2;
    case SET:
        return length == 2 + 2 * n;
    case CONFIGURE:
        return length == 2 + 4 * n + 2;
    case NAME:
        return length == 2 + 16;
    default:
        return asked[1] > HELLO && asked[1] <= CLEAR && length == 2;
    }
}

static uint16_t word(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static uint8_t unframed(const uint8_t *frame, uint8_t length, uint8_t *payload) {
    CHECK(length >= 6 && length <= MOST_FRAME);
    CHECK(memchr(frame, 0, length) == frame + length - 1);
    memcpy(payload, frame, length);
    int decoded = cobs_decode(payload, (uint8_t)(length - 1));
    CHECK(decoded >= 4 && decoded <= MOST_PAYLOAD + 2);
    CHECK(crc16(payload, (uint8_t)(decoded - 2)) == (payload[decoded - 2] << 8 | payload[decoded - 1]));
    return (uint8_t)(decoded - 2);
}

static void check_state(const struct board *board, const uint8_t *body, uint8_t length) {
    CHECK(length == 24 + 4 * board->servos);
    uint16_t flags = word(body + 1);
    CHECK(!!(flags & FLAG_ARMED) == board->armed);
    CHECK(!!(flags & FLAG_PULSES) == board->pulsing);
    CHECK(!!(flags & FLAG_STOPPED) == board->stopped);
    CHECK((flags & (FLAG_HELD | FLAG_WENT_LIMP)) == board->latched);
    for (int i = 0; i < board->servos; i++) {
        uint16_t target = word(body + 9 + 4 * i), pulse = word(body + 11 + 4 * i);
        CHECK(board->pulsing || (target == 0 && pulse == 0));
        CHECK(!board->pulsing || (pulse >= board->servo[i].low && pulse <= board->servo[i].high));
    }
}

static bool same_pulses(const struct seen *before, const struct board *board) {
    return before->pulsing == board->pulsing && memcmp(before->servo, board->servo, sizeof before->servo) == 0;
}

static void check_set(const struct seen *before, const struct board *board, const uint8_t *body, uint8_t result,
                      uint16_t flags, uint32_t now) {
    if (result != OK) {
        CHECK(same_pulses(before, board));
        return;
    }
    CHECK(before->armed && !before->stopped && board->pulsing && board->fed == now);
    bool clamped = false;
    for (int i = 0; i < board->servos; i++) {
        uint16_t wanted = word(body + 2 * i);
        const struct servo *servo = &board->servo[i];
        bool inside = wanted >= servo->low && wanted <= servo->high;
        clamped |= !inside;
        CHECK(servo->target == (inside ? wanted : wanted < servo->low ? servo->low : servo->high));
        CHECK(servo->pulse == (before->pulsing ? before->servo[i].pulse : servo->target));
    }
    CHECK(!!(flags & FLAG_CLAMPED) == clamped);
}

static void check_effect(const struct seen *before, const struct board *board, const uint8_t *asked, uint8_t length,
                         uint8_t result, uint16_t flags, uint32_t now) {
    uint8_t type = asked[1];
    bool done = result == OK;
    CHECK(board->pulsing == before->pulsing || (done && (type == SET || type == DISARM || type == STOP)));
    CHECK(board->armed == before->armed || (done && (type == ARM || type == DISARM || type == STOP)));
    CHECK(board->stopped == before->stopped || (done && type == STOP));
    CHECK(board->fed == before->fed || (done && (type == SET || type == ARM)));
    CHECK(board->latched == before->latched || (done && type == CLEAR));
    CHECK(!(flags & FLAG_CLAMPED) || type == SET);
    if (type == SET && length == 2 + 2 * board->servos)
        check_set(before, board, asked + 2, result, flags, now);
    else if (type != CONFIGURE || !done)
        CHECK(memcmp(before->servo, board->servo, sizeof before->servo) == 0 && board->slew == before->slew);
    if (type == CONFIGURE && done)
        CHECK(!before->armed);
    if (type == ARM && done)
        CHECK(!before->armed && !before->stopped && word(asked + 2) == board->nonce && !board->pulsing);
    if (type == STOP && length == 2)
        CHECK(done && board->stopped && !board->armed);
    if (type == DISARM && length == 2)
        CHECK(done && !board->armed && !board->pulsing);
}

void check_exchange(const struct seen *before, const struct board *board, const uint8_t *asked, uint8_t asked_length,
                    bool again, const uint8_t *frame, uint8_t length, uint32_t now) {
    uint8_t payload[MOST_FRAME];
    CHECK(length > 0);
    uint8_t said = unframed(frame, length, payload);
    CHECK(payload[0] == asked[0] && payload[1] == (asked[1] | REPLY));
    CHECK(board->parser.crc_errors == before->crc_errors || asked[1] == CLEAR);
    if (again) {
        CHECK(same_pulses(before, board) && board->fed == before->fed && board->armed == before->armed);
        CHECK(board->stopped == before->stopped && board->latched == before->latched);
        CHECK(board->repeated == before->repeated + (before->repeated < UINT16_MAX));
        return;
    }
    if (asked[1] == HELLO) {
        CHECK(said == 2 + 39 + 4 * board->servos && payload[2] == PROTOCOL_VERSION);
        check_noise(before, board);
        return;
    }
    check_state(board, payload + 2, (uint8_t)(said - 2));
    CHECK(understood_by(board, asked, asked_length) == (payload[2] != BAD_LENGTH && payload[2] != UNKNOWN_TYPE));
    check_effect(before, board, asked, asked_length, payload[2], word(payload + 3), now);
}

void check_noise(const struct seen *before, const struct board *board) {
    struct seen after = look(board);
    CHECK(after.armed == before->armed && after.holding == before->holding && after.stopped == before->stopped);
    CHECK(after.latched == before->latched && after.fed == before->fed && after.slew == before->slew);
    CHECK(same_pulses(before, board) && after.repeated == before->repeated);
}

void check_tick(const struct seen *before, const struct board *board, uint32_t now) {
    uint32_t silence = now - before->fed;
    CHECK(board->armed == (before->armed && silence < LIMP_MS));
    CHECK(board->pulsing == (before->pulsing && silence < LIMP_MS));
    CHECK(board->holding == (board->pulsing && (before->holding || silence >= HOLD_MS)));
    CHECK(!board->holding || before->holding || board->latched & FLAG_HELD);
    CHECK(board->fed == before->fed && board->stopped == before->stopped);
    for (int i = 0; i < board->servos; i++) {
        CHECK(board->servo[i].pulse == before->servo[i].pulse);
        bool stays = board->holding && !before->holding;
        CHECK(board->servo[i].target == (stays ? before->servo[i].pulse : before->servo[i].target));
    }
}

void check_frame(const struct seen *before, const struct board *board) {
    for (int i = 0; i < board->servos; i++) {
        int was = before->servo[i].pulse, is = board->servo[i].pulse, goal = before->servo[i].target;
        int way = board->pulsing ? goal - was : 0;
        int step = abs(way) < before->slew ? abs(way) : before->slew;
        CHECK(is == was + (way < 0 ? -step : step) && board->servo[i].target == goal);
    }
}
