#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "servos.h"

static volatile uint32_t milliseconds;
static volatile uint8_t unheard;

ISR(TIMER0_COMPA_vect) {
    milliseconds++;
    if (unheard < DEAF_MS)
        unheard++;
    else
        servos_release();
}

void clock_start(void) {
    OCR0A = F_CPU / 64 / 1000 - 1;
    TCCR0A = _BV(WGM01);
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
}

uint32_t clock_now(void) {
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        now = milliseconds;
    }
    return now;
}

void clock_alive(void) {
    unheard = 0;
}
