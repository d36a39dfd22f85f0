#include "board.h"

#include <string.h>

void board_start(struct board *board) {
    for (uint8_t i = 0; i < MOST_SERVOS; i++)
        board->servo[i] = (struct servo){.low = FIRST_LOW, .high = FIRST_HIGH};
    board->slew = FIRST_SLEW;
    board->armed = board->pulsing = board->holding = board->stopped = false;
    board->latched = 0;
}

/* A damaged frame can pass for a longer one (PROTOCOL.md, "What the CRC does not see"). If it is a retry's, the request
   that was done must not be forgotten for it: the next retry would do it twice. */
static bool understood(const uint8_t *answer) {
    return answer[1] == (HELLO | REPLY) || (answer[2] != BAD_LENGTH && answer[2] != UNKNOWN_TYPE);
}

uint8_t board_byte(struct board *board, uint8_t byte, uint32_t now, uint8_t frame[MOST_FRAME]) {
    uint8_t length = parser_take(&board->parser, byte);
    if (length == 0)
        return 0;
    const uint8_t *asked = board->parser.bytes;
    bool again = length == board->asked_length && memcmp(asked, board->asked, length) == 0;
    if (again) {
        count(&board->repeated);
        return frame_of(board->answer, board->answer_length, frame);
    }
    uint8_t answer[MOST_PAYLOAD];
    uint8_t answered = board_answer(board, asked, length, now, answer);
    if (understood(answer)) {
        memcpy(board->asked, asked, length);
        board->asked_length = length;
        memcpy(board->answer, answer, answered);
        board->answer_length = answered;
    }
    return frame_of(answer, answered, frame);
}

void board_tick(struct board *board, uint32_t now) {
    if (!board->armed)
        return;
    uint32_t silence = now - board->fed;
    if (silence >= LIMP_MS) {
        board_disarm(board);
        board->latched |= FLAG_WENT_LIMP;
    } else if (silence >= HOLD_MS && board->pulsing && !board->holding) {
        board->holding = true;
        board->latched |= FLAG_HELD;
        for (uint8_t i = 0; i < board->servos; i++)
            board->servo[i].target = board->servo[i].pulse;
    }
}

void board_frame(struct board *board) {
    if (!board->pulsing)
        return;
    for (uint8_t i = 0; i < board->servos; i++) {
        struct servo *servo = &board->servo[i];
        if (servo->target > servo->pulse)
            servo->pulse += servo->target - servo->pulse > board->slew ? board->slew : servo->target - servo->pulse;
        else
            servo->pulse -= servo->pulse - servo->target > board->slew ? board->slew : servo->pulse - servo->target;
    }
}

void board_disarm(struct board *board) {
    board->armed = board->pulsing = board->holding = false;
}

void board_stop(struct board *board) {
    board_disarm(board);
    board->stopped = true;
}
