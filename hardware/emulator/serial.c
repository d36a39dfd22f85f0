#include "serial.h"

#include <simavr/sim_regbit.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define SENT (sizeof((struct serial *)0)->sent / sizeof((struct serial *)0)->sent[0])
#define HELD 3 /* bytes that the receiver holds: two, and one in its shift register */

static unsigned unread(const avr_uart_t *uart) {
    return (unsigned)(uart->input.write - uart->input.read) % uart_fifo_fifo_size;
}

/* A byte's start bit: simavr hands it to the firmware a byte's time later. */
static avr_cycle_count_t byte_starts(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct serial *serial = param;
    if (serial->in == serial->out)
        return 0;
    uint8_t byte = serial->incoming[serial->out++];
    serial->uart->cycles_per_byte = BYTE_CYCLES; /* simavr's own has a parity bit in it */
    if (avr_regbit_get(avr, serial->uart->rxen)) {
        if (unread(serial->uart) >= HELD)
            avr_regbit_set(avr, serial->uart->dor); /* simavr's receiver would hold 64 */
        avr_raise_irq(serial->uart->io.irq + UART_IRQ_INPUT, byte);
    }
    serial->next_start = when + BYTE_CYCLES;
    return serial->in == serial->out ? 0 : serial->next_start;
}

void serial_resume(struct serial *serial) {
    if (serial->in == serial->out)
        return;
    uint64_t now = serial->avr->cycle;
    uint64_t start = serial->next_start > now ? serial->next_start : now;
    avr_cycle_timer_register(serial->avr, start - now, byte_starts, serial);
}

void serial_write(struct serial *serial, const uint8_t *bytes, size_t length) {
    bool idle = serial->in == serial->out;
    if (serial->out && (idle || serial->out > serial->room / 2)) {
        memmove(serial->incoming, serial->incoming + serial->out, serial->in - serial->out);
        serial->in -= serial->out;
        serial->out = 0;
    }
    if (serial->in + length > serial->room) {
        serial->room = 2 * (serial->in + length);
        serial->incoming = realloc(serial->incoming, serial->room);
    }
    memcpy(serial->incoming + serial->in, bytes, length);
    serial->in += length;
    if (idle)
        serial_resume(serial);
}

void serial_pass_by(struct serial *serial, uint64_t until) {
    while (serial->in != serial->out && serial->next_start < until) {
        serial->out++;
        serial->next_start += BYTE_CYCLES;
    }
}

static void on_sent(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct serial *serial = param;
    uint64_t now = serial->avr->cycle;
    serial->uart->cycles_per_byte = BYTE_CYCLES;
    serial->sending_until = (serial->sending_until > now ? serial->sending_until : now) + BYTE_CYCLES;
    size_t next = (serial->sent_in + 1) % SENT;
    if (next == serial->sent_out)
        return;
    serial->sent[serial->sent_in].ready = serial->sending_until;
    serial->sent[serial->sent_in].byte = (uint8_t)value;
    serial->sent_in = next;
}

size_t serial_read(struct serial *serial, uint8_t *bytes, size_t room) {
    size_t length = 0;
    while (length < room && serial->sent_out != serial->sent_in &&
           serial->sent[serial->sent_out].ready <= serial->avr->cycle) {
        bytes[length++] = serial->sent[serial->sent_out].byte;
        serial->sent_out = (serial->sent_out + 1) % SENT;
    }
    return length;
}

void serial_connect(struct serial *serial, avr_t *avr) {
    serial->avr = avr;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (strcmp(io->kind, "uart") == 0)
            serial->uart = (avr_uart_t *)io;
    serial->uart->flags = 0; /* neither print what is sent nor sleep while nothing comes */
    avr_irq_register_notify(serial->uart->io.irq + UART_IRQ_OUTPUT, on_sent, serial);
}

void serial_free(struct serial *serial) {
    free(serial->incoming);
}
