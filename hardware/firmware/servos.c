/* The hardware makes the pulses: a busy processor cannot stretch one. A pulse begins when the timer passes zero.
   OCR1x is double-buffered and taken over at zero, so it may be written at any time; the outputs are connected and
   disconnected only between pulses, so no pulse is ever cut. */
#include "servos.h"

#include <avr/io.h>
#include <util/atomic.h>

#define FRAME 40000u /* ticks of half a microsecond: 20 ms */
#define OUTPUTS (_BV(COM1A1) | _BV(COM1B1))
#define QUIET_FROM (HARD_HIGH + 20u) /* the longest pulse is over */
#define QUIET_TO (FRAME - 10u)       /* too late to be sure of disconnecting before the next one */
#define LOAD_FROM (FRAME - 6000u)    /* commands of a frame's first 17 ms still count for the next */
#define LOAD_TO (FRAME - 200u)

static bool loaded; /* this frame's turn to load has been taken */

void servos_start(void) {
    PORTB &= ~(_BV(PORTB1) | _BV(PORTB2));
    DDRB |= _BV(DDB1) | _BV(DDB2); /* low while disconnected */
    TCCR1A = _BV(WGM11); /* fast PWM up to ICR1, outputs disconnected */
    TCCR1B = _BV(WGM13) | _BV(WGM12);
    ICR1 = FRAME - 1; /* cannot be written before the mode that uses it is chosen */
    TCCR1B |= _BV(CS11);
}

void servos_release(void) {
    uint16_t ticks = TCNT1;
    if (ticks >= QUIET_FROM && ticks <= QUIET_TO)
        TCCR1A &= (uint8_t)~OUTPUTS;
}

static void load(const struct board *board) {
    uint8_t outputs = _BV(COM1A1);
    OCR1A = board->servo[0].pulse - 1; /* high from 0 to OCR1A, both included */
    if (board->servos > 1) {
        OCR1B = board->servo[1].pulse - 1;
        outputs |= _BV(COM1B1);
    }
    TCCR1A |= outputs;
}

void servos_drive(struct board *board) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        uint16_t ticks = TCNT1;
        if (!board->pulsing) {
            servos_release();
            loaded = false;
        } else if (ticks < LOAD_FROM) {
            loaded = false;
        } else if (!loaded && ticks <= LOAD_TO) {
            board_frame(board);
            load(board);
            loaded = true;
        }
    }
}
