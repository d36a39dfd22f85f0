#include "pulses.h"

#include <simavr/avr_ioport.h>
#include <simavr/sim_regbit.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_PIN 1 /* OC1A is PB1, OC1B is PB2 */

/* simavr moves a pin when the instruction under way has ended, a few cycles after the timer did. */
#define LATENESS 64

static uint64_t exact(uint64_t now, uint64_t timer) {
    return now >= timer && now - timer < LATENESS ? timer : now;
}

/* The real timer takes its compare value over when a pulse begins. simavr takes it when its low byte is written and
   does not see a change of the high byte alone. It is asked for the end of a pulse just after the pin has risen. */
static void take_over(avr_timer_t *timer, int channel, avr_t *avr) {
    avr_timer_comp_t *comp = &timer->comp[channel];
    uint32_t ticks = avr->data[comp->r_ocr] | (uint32_t)avr->data[comp->r_ocrh] << 8;
    comp->comp_cycles = (ticks + 1) * timer->cs_div_value;
}

static void ended(struct pulses *pulses, struct channel *channel, uint64_t fall, bool cut) {
    if (pulses->count == pulses->room) {
        pulses->room = 2 * pulses->room + 64;
        pulses->ended = realloc(pulses->ended, pulses->room * sizeof *pulses->ended);
    }
    pulses->ended[pulses->count++] = (struct pulse){
        .rise = channel->rise, .width = (uint32_t)(fall - channel->rise), .channel = channel->number, .cut = cut};
    channel->high = false;
}

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct channel *channel = param;
    struct pulses *pulses = channel->all;
    avr_timer_t *timer = pulses->timer;
    uint64_t now = pulses->avr->cycle;
    bool high = value & 0xFF;
    if (high == channel->high)
        return;
    if (!high) {
        ended(pulses, channel, exact(now, timer->tov_base + timer->comp[channel->number].comp_cycles), false);
        return;
    }
    channel->high = true;
    channel->rise = exact(now, timer->tov_base);
    if (avr_regbit_get(pulses->avr, timer->comp[channel->number].com))
        take_over(timer, channel->number, pulses->avr);
}

/* An output that is disconnected falls back to its port's bit at once; simavr leaves the pin as it is. */
static void on_control(avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param) {
    (void)addr, (void)value;
    struct pulses *pulses = param;
    for (int i = 0; i < CHANNELS; i++) {
        struct channel *channel = &pulses->channels[i];
        if (!channel->high || avr_regbit_get(avr, pulses->timer->comp[i].com))
            continue;
        ended(pulses, channel, avr->cycle, true);
        avr_raise_irq(pulses->pins[i], 0);
    }
}

void pulses_cut(struct pulses *pulses) {
    for (int i = 0; i < CHANNELS; i++) {
        if (pulses->channels[i].high)
            ended(pulses, &pulses->channels[i], pulses->avr->cycle, true);
        avr_raise_irq(pulses->pins[i], 0);
    }
}

size_t pulses_take(struct pulses *pulses, struct pulse *to, size_t room) {
    size_t taken = pulses->count < room ? pulses->count : room;
    if (taken == 0)
        return 0;
    memcpy(to, pulses->ended, taken * sizeof *to);
    memmove(pulses->ended, pulses->ended + taken, (pulses->count - taken) * sizeof *to);
    pulses->count -= taken;
    return taken;
}

void pulses_connect(struct pulses *pulses, avr_t *avr) {
    pulses->avr = avr;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (strcmp(io->kind, "timer") == 0 && ((avr_timer_t *)io)->name == '1')
            pulses->timer = (avr_timer_t *)io;
    for (int i = 0; i < CHANNELS; i++) {
        pulses->channels[i] = (struct channel){.all = pulses, .number = (uint8_t)i};
        pulses->pins[i] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), FIRST_PIN + i);
        avr_irq_register_notify(pulses->pins[i], on_pin, &pulses->channels[i]);
    }
    avr_register_io_write(avr, pulses->timer->wgm[0].reg, on_control, pulses);
}

void pulses_free(struct pulses *pulses) {
    free(pulses->ended);
}
