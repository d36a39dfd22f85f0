/* Who this board is, in the EEPROM, and which boot this is. */
#ifndef IDENTITY_H
#define IDENTITY_H

#include "board.h"

/* Fills in name, unique id, servos, boot nonce and reset cause. Once, at boot. */
void identity_load(struct board *board);

/* Keeps the name. Takes up to 54 ms. */
void identity_keep_name(const struct board *board);

#endif
