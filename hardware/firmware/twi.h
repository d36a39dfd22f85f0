/* The two-wire bus as its master, one exchange at a time, moved on by interrupts. */
#ifndef TWI_H
#define TWI_H

#include <stdint.h>

enum twi { TWI_IDLE, TWI_BUSY, TWI_DONE, TWI_FAILED };

void twi_start(void);

/* Writes a register's address and then either `value` (`length` = 0) or reads `length` bytes (at most TWI_MOST). */
void twi_exchange(uint8_t device, uint8_t reg, uint8_t value, uint8_t length);

/* How the exchange stands. */
enum twi twi_state(void);

/* What was read, once it is done. */
const uint8_t *twi_bytes(void);

/* Takes note of an exchange that is done or failed. */
void twi_finish(void);

/* After an exchange that never ended: frees a bus on which a slave waits in the middle of a byte. */
void twi_recover(void);

#define TWI_MOST 6

#endif
