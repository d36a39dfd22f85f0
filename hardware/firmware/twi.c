#include "twi.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>
#include <util/delay.h>
#include <util/twi.h>

#define BUS_HZ 400000UL
#define GO (_BV(TWINT) | _BV(TWEN) | _BV(TWIE))
#define SDA _BV(PORTC4)
#define SCL _BV(PORTC5)

static volatile enum twi state;
static uint8_t device, wanted, got, written;
static uint8_t outgoing[2];
static uint8_t bytes[TWI_MOST];

static void stop(enum twi end) {
    state = end;
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
}

static void wrote(void) {
    if (written < (wanted ? 1 : 2)) {
        TWDR = outgoing[written++];
        TWCR = GO;
    } else if (wanted) {
        TWCR = GO | _BV(TWSTA);
    } else {
        stop(TWI_DONE);
    }
}

ISR(TWI_vect) {
    switch (TW_STATUS) {
    case TW_START:
        TWDR = (uint8_t)(device << 1);
        TWCR = GO;
        break;
    case TW_REP_START:
        TWDR = (uint8_t)(device << 1) | 1;
        TWCR = GO;
        break;
    case TW_MT_SLA_ACK:
    case TW_MT_DATA_ACK:
        wrote();
        break;
    case TW_MR_DATA_ACK:
        bytes[got++] = TWDR;
        TWCR = got + 1 < wanted ? GO | _BV(TWEA) : GO;
        break;
    case TW_MR_SLA_ACK:
        TWCR = wanted > 1 ? GO | _BV(TWEA) : GO; /* the last byte is not acknowledged */
        break;
    case TW_MR_DATA_NACK:
        bytes[got++] = TWDR;
        stop(TWI_DONE);
        break;
    default: /* nobody there, or noise on the bus */
        stop(TWI_FAILED);
    }
}

void twi_start(void) {
    PORTC |= SDA | SCL; /* weak pull-ups beside those of the sensor's board: without a sensor the bus must not float */
    TWBR = (F_CPU / BUS_HZ - 16) / 2;
    TWCR = _BV(TWEN);
    state = TWI_IDLE;
}

void twi_exchange(uint8_t to, uint8_t reg, uint8_t value, uint8_t length) {
    device = to;
    outgoing[0] = reg;
    outgoing[1] = value;
    wanted = length;
    got = written = 0;
    state = TWI_BUSY;
    for (uint8_t i = 0; i < 255 && TWCR & _BV(TWSTO); i++) /* the last stop condition takes some microseconds */
        ;
    TWCR = GO | _BV(TWSTA);
}

enum twi twi_state(void) {
    return state;
}

const uint8_t *twi_bytes(void) {
    return bytes;
}

void twi_finish(void) {
    state = TWI_IDLE;
}

void twi_recover(void) {
    TWCR = 0;
    PORTC &= (uint8_t)~SCL;
    for (uint8_t i = 0; i < 9; i++) { /* nine clocks end any byte; the line is only ever pulled down, never driven up */
        DDRC |= SCL;
        _delay_us(5);
        DDRC &= (uint8_t)~SCL;
        _delay_us(5);
    }
    twi_start();
}
