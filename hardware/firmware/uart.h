/* The serial line: 250000 baud 8N1 (exact at 16 MHz), both directions through rings filled and emptied by interrupts. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

void uart_start(void);

bool uart_readable(void);
uint8_t uart_read(void); /* only if readable */

/* Whether so many bytes can be written without waiting. */
bool uart_room(uint8_t length);
void uart_write(const uint8_t *bytes, uint8_t length); /* only if there is room */

/* How many bytes were lost since the last call, because nobody read them in time. */
uint8_t uart_overruns(void);

#endif
