/* The serial line of the emulated board, with the time that bytes take. */
#ifndef SERIAL_H
#define SERIAL_H

#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <stddef.h>
#include <stdint.h>

#define BYTE_CYCLES 640 /* ten bits at 250000 baud */

struct serial {
    avr_t *avr;
    avr_uart_t *uart;
    uint8_t *incoming; /* waiting on the wire */
    size_t in, out, room;
    uint64_t next_start; /* cycle before which no byte can start */
    struct {
        uint64_t ready;
        uint8_t byte;
    } sent[32768]; /* a ring of what has left the board and was not read yet: 1.3 s of a busy line, more is lost */
    size_t sent_in, sent_out;
    uint64_t sending_until;
};

void serial_connect(struct serial *serial, avr_t *avr);
void serial_free(struct serial *serial);
void serial_write(struct serial *serial, const uint8_t *bytes, size_t length);
size_t serial_read(struct serial *serial, uint8_t *bytes, size_t room);

/* Timers are forgotten by a reset: this sets the line's again. */
void serial_resume(struct serial *serial);

/* What was under way until now meets nobody. */
void serial_pass_by(struct serial *serial, uint64_t until);

#endif
