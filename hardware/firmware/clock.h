/* Milliseconds since boot, from timer 0. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

void clock_start(void);
uint32_t clock_now(void);

/* Says that the main loop is alive. The clock's interrupt lets the servos go if this is not heard for DEAF_MS. */
void clock_alive(void);

#define DEAF_MS 50 /* before the hardware watchdog (120 ms), whose reset could cut a pulse short */

#endif
