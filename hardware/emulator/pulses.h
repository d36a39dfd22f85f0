/* Servo pulses as they come out of the pins D9 and D10. */
#ifndef PULSES_H
#define PULSES_H

#include <simavr/avr_timer.h>
#include <simavr/sim_avr.h>
#include <stdbool.h>

#include "board.h"

#define CHANNELS 2

struct pulses {
    avr_t *avr;
    avr_timer_t *timer;
    avr_irq_t *pins[CHANNELS];
    struct channel {
        struct pulses *all;
        uint8_t number;
        bool high;
        uint64_t rise;
    } channels[CHANNELS];
    struct pulse *ended;
    size_t count, room;
};

void pulses_connect(struct pulses *pulses, avr_t *avr);
void pulses_free(struct pulses *pulses);
size_t pulses_take(struct pulses *pulses, struct pulse *to, size_t room);

/* The pins let go, as they do at a reset: a pulse under way is cut short. */
void pulses_cut(struct pulses *pulses);

#endif
