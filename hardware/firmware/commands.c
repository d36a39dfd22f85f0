/* What each request does, and what every reply says. */
#include <string.h>

#include "board.h"

struct writer {
    uint8_t *to;
    uint8_t length;
};

static void put8(struct writer *writer, uint8_t value) {
    writer->to[writer->length++] = value;
}

static void put16(struct writer *writer, uint16_t value) {
    put8(writer, (uint8_t)value);
    put8(writer, (uint8_t)(value >> 8));
}

static void put32(struct writer *writer, uint32_t value) {
    put16(writer, (uint16_t)value);
    put16(writer, (uint16_t)(value >> 16));
}

static void put_bytes(struct writer *writer, const uint8_t *bytes, uint8_t length) {
    memcpy(writer->to + writer->length, bytes, length);
    writer->length += length;
}

static uint16_t get16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static void put_identity(const struct board *board, struct writer *writer) {
    put8(writer, PROTOCOL_VERSION);
    put8(writer, FIRMWARE_MAJOR);
    put8(writer, FIRMWARE_MINOR);
    put8(writer, FIRMWARE_PATCH);
    put_bytes(writer, board->name, NAME_LENGTH);
    put_bytes(writer, board->unique, UNIQUE_LENGTH);
    put16(writer, board->nonce);
    put8(writer, board->reset_cause);
    put8(writer, board->servos);
    put8(writer, board->imu.who);
    for (uint8_t i = 0; i < board->servos; i++) {
        put16(writer, board->servo[i].low);
        put16(writer, board->servo[i].high);
    }
    put16(writer, board->slew);
    put16(writer, HOLD_MS);
    put16(writer, LIMP_MS);
}

static uint16_t flags_of(const struct board *board) {
    uint16_t flags = board->latched;
    if (board->armed)
        flags |= FLAG_ARMED;
    if (board->pulsing)
        flags |= FLAG_PULSES;
    if (board->holding)
        flags |= FLAG_HOLDING;
    if (board->stopped)
        flags |= FLAG_STOPPED;
    for (uint8_t i = 0; board->pulsing && i < board->servos; i++)
        if (board->servo[i].pulse != board->servo[i].target)
            flags |= FLAG_SLEWING;
    if (imu_missing(&board->imu))
        flags |= FLAG_IMU_MISSING;
    if (imu_stuck(&board->imu))
        flags |= FLAG_IMU_STUCK;
    return flags;
}

static void put_state(const struct board *board, struct writer *writer, enum result result, bool clamped, uint32_t now) {
    put8(writer, (uint8_t)result);
    put16(writer, flags_of(board) | (clamped ? FLAG_CLAMPED : 0));
    put16(writer, board->nonce);
    put32(writer, now);
    for (uint8_t i = 0; i < board->servos; i++) {
        put16(writer, board->pulsing ? board->servo[i].target : 0);
        put16(writer, board->pulsing ? board->servo[i].pulse : 0);
    }
    int16_t mean[3];
    imu_mean(&board->imu, mean);
    for (uint8_t axis = 0; axis < 3; axis++)
        put16(writer, (uint16_t)mean[axis]);
    put8(writer, imu_age(&board->imu, now));
    put16(writer, board->parser.crc_errors);
    put16(writer, board->parser.framing_errors);
    put16(writer, board->overruns);
    put16(writer, board->repeated);
}

static enum result arm(struct board *board, const uint8_t *body, uint32_t now) {
    if (board->stopped)
        return STOPPED;
    if (board->armed)
        return ALREADY_ARMED;
    if (get16(body) != board->nonce)
        return BAD_NONCE;
    board->armed = true;
    board->fed = now;
    return OK;
}

static enum result set(struct board *board, const uint8_t *body, uint32_t now, bool *clamped) {
    if (board->stopped)
        return STOPPED;
    if (!board->armed)
        return NOT_ARMED;
    for (uint8_t i = 0; i < board->servos; i++) {
        struct servo *servo = &board->servo[i];
        uint16_t wanted = get16(body + 2 * i);
        servo->target = wanted < servo->low ? servo->low : wanted > servo->high ? servo->high : wanted;
        *clamped |= servo->target != wanted;
        if (!board->pulsing) /* nobody knows where the servo stands: there is nothing to slew from */
            servo->pulse = servo->target;
    }
    board->pulsing = true;
    board->holding = false;
    board->fed = now;
    return OK;
}

static enum result configure(struct board *board, const uint8_t *body) {
    if (board->armed)
        return ONLY_DISARMED;
    uint16_t slew = get16(body + 4 * board->servos);
    if (slew == 0)
        return BAD_VALUE;
    for (uint8_t i = 0; i < board->servos; i++) {
        uint16_t low = get16(body + 4 * i), high = get16(body + 4 * i + 2);
        if (low < HARD_LOW || high > HARD_HIGH || low > high)
            return BAD_VALUE;
    }
    for (uint8_t i = 0; i < board->servos; i++) {
        board->servo[i].low = get16(body + 4 * i);
        board->servo[i].high = get16(body + 4 * i + 2);
    }
    board->slew = slew;
    return OK;
}

static enum result rename_to(struct board *board, const uint8_t *body) {
    if (board->armed)
        return ONLY_DISARMED;
    bool ended = false;
    for (uint8_t i = 0; i < NAME_LENGTH; i++) {
        bool printable = body[i] > ' ' && body[i] < 0x7F;
        if (body[i] == 0)
            ended = true;
        else if (ended || !printable)
            return BAD_VALUE;
    }
    memcpy(board->name, body, NAME_LENGTH);
    board->renamed = true;
    return OK;
}

static enum result clear(struct board *board) {
    board->latched = 0;
    board->parser.crc_errors = board->parser.framing_errors = 0;
    board->overruns = board->repeated = 0;
    return OK;
}

/* How long a request's body must be; -1 for an unknown type. */
static int8_t length_of(const struct board *board, uint8_t type) {
    switch (type) {
    case ARM:
        return 2;
    case SET:
        return (int8_t)(2 * board->servos);
    case CONFIGURE:
        return (int8_t)(4 * board->servos + 2);
    case NAME:
        return NAME_LENGTH;
    case DISARM:
    case READ:
    case STOP:
    case CLEAR:
        return 0;
    default:
        return -1;
    }
}

uint8_t board_answer(struct board *board, const uint8_t *asked, uint8_t length, uint32_t now, uint8_t *answer) {
    struct writer writer = {.to = answer};
    uint8_t type = asked[1];
    const uint8_t *body = asked + 2;
    put8(&writer, asked[0]);
    put8(&writer, type | REPLY);
    if (type == HELLO) { /* whatever its body says: another version must be able to find out who answers */
        put_identity(board, &writer);
        return writer.length;
    }
    enum result result = OK;
    bool clamped = false;
    int8_t wanted = length_of(board, type);
    if (wanted < 0)
        result = UNKNOWN_TYPE;
    else if (length - 2 != wanted)
        result = BAD_LENGTH;
    else if (type == ARM)
        result = arm(board, body, now);
    else if (type == DISARM)
        board_disarm(board);
    else if (type == SET)
        result = set(board, body, now, &clamped);
    else if (type == STOP)
        board_stop(board);
    else if (type == CONFIGURE)
        result = configure(board, body);
    else if (type == NAME)
        result = rename_to(board, body);
    else if (type == CLEAR)
        result = clear(board);
    put_state(board, &writer, result, clamped, now);
    return writer.length;
}
