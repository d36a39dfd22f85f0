#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#define BAUD_RATE 250000UL
#define SENDING 128u /* a power of two */

/* Indices are bytes: the ring of 256 wraps by itself. One place stays free, or full would look like empty. */
static volatile uint8_t received[256];
static volatile uint8_t received_in, received_out;
static volatile uint8_t sending[SENDING];
static volatile uint8_t sending_in, sending_out;
static volatile uint8_t lost;

ISR(USART_RX_vect) {
    bool overrun = UCSR0A & _BV(DOR0); /* to be read before the byte */
    uint8_t byte = UDR0;
    uint8_t next = (uint8_t)(received_in + 1);
    if (next == received_out) {
        overrun = true;
    } else {
        received[received_in] = byte;
        received_in = next;
    }
    if (overrun && lost < UINT8_MAX)
        lost++;
}

ISR(USART_UDRE_vect) {
    if (sending_in == sending_out) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    } else {
        UDR0 = sending[sending_out];
        sending_out = (uint8_t)(sending_out + 1) % SENDING;
    }
}

void uart_start(void) {
    UBRR0 = F_CPU / 16 / BAUD_RATE - 1;
    UCSR0A = 0;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool uart_readable(void) {
    return received_in != received_out;
}

uint8_t uart_read(void) {
    uint8_t byte = received[received_out];
    received_out = (uint8_t)(received_out + 1);
    return byte;
}

bool uart_room(uint8_t length) {
    uint8_t used = (uint8_t)(sending_in - sending_out) % SENDING;
    return length < SENDING - used;
}

void uart_write(const uint8_t *bytes, uint8_t length) {
    for (uint8_t i = 0; i < length; i++) {
        sending[sending_in] = bytes[i];
        sending_in = (uint8_t)(sending_in + 1) % SENDING;
    }
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        UCSR0B |= _BV(UDRIE0);
    }
}

uint8_t uart_overruns(void) {
    uint8_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        count = lost;
        lost = 0;
    }
    return count;
}
