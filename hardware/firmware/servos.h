/* Servo pulses from timer 1, 50 a second, to half a microsecond: OC1A (D9) and OC1B (D10). */
#ifndef SERVOS_H
#define SERVOS_H

#include "board.h"

void servos_start(void);

/* Lets go or loads the coming frame's pulses, whichever the board says, if this is the moment for it. Call it often. */
void servos_drive(struct board *board);

/* Lets go unless a pulse is under way. With interrupts off. */
void servos_release(void);

#endif
