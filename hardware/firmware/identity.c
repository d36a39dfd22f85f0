/* Boot loaders cannot write the EEPROM. So the same bytes may lie at the end of the flash (BUILD_A.md), just below
   Optiboot, from where a blank EEPROM takes them over.

   EEPROM: 0..15 name, 16..23 unique id, 24..25 cold boots (little-endian), 26 servos; 0xFF is blank. */
#include "identity.h"

#include <avr/eeprom.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/wdt.h>
#include <string.h>

#define AT_NAME ((uint8_t *)0)
#define AT_UNIQUE ((uint8_t *)16)
#define AT_BOOTS ((uint16_t *)24)
#define AT_SERVOS ((uint8_t *)26)

#define IN_FLASH 0x7DE0u
#define BLANK 0xFF
#define WARM_BITS 6 /* of the nonce */

static uint8_t reset_cause __attribute__((section(".noinit")));

/* Survives a reset, not a power cut: then it is whatever the memory happens to hold. */
static struct {
    uint16_t cold;
    uint8_t warm;
    uint8_t check;
} boots __attribute__((section(".noinit")));

/* Before main: after a reset by the watchdog it still runs, at its shortest time-out. */
void first_things(void) __attribute__((naked, used, section(".init3")));
void first_things(void) {
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static uint8_t check(void) {
    return (uint8_t)(~(boots.cold ^ (boots.cold >> 8) ^ boots.warm)) ^ 0x5A;
}

/* Another number than at any of the last 65535 boots. Resets without a power cut are counted in the memory: a board that
   resets for hours on end must not wear out its EEPROM, which stands 100,000 writes. */
static uint16_t next_nonce(void) {
    bool kept = !(reset_cause & (_BV(PORF) | _BV(BORF))) && boots.check == check();
    if (kept)
        boots.warm++;
    if (!kept || boots.warm >> WARM_BITS) {
        boots.cold = eeprom_read_word(AT_BOOTS) + 1;
        boots.warm = 0;
        eeprom_update_word(AT_BOOTS, boots.cold);
    }
    boots.check = check();
    return (uint16_t)(boots.cold << WARM_BITS) | boots.warm;
}

static bool blank(const uint8_t unique[UNIQUE_LENGTH]) {
    for (uint8_t i = 0; i < UNIQUE_LENGTH; i++)
        if (unique[i] != BLANK)
            return false;
    return true;
}

static void take_over(void) {
    uint8_t kept[UNIQUE_LENGTH], flashed[UNIQUE_LENGTH], name[NAME_LENGTH];
    eeprom_read_block(kept, AT_UNIQUE, UNIQUE_LENGTH);
    memcpy_P(flashed, (const void *)(IN_FLASH + (uint16_t)AT_UNIQUE), UNIQUE_LENGTH);
    if (!blank(kept) || blank(flashed))
        return;
    memcpy_P(name, (const void *)IN_FLASH, NAME_LENGTH);
    eeprom_update_block(name, AT_NAME, NAME_LENGTH);
    eeprom_update_byte(AT_SERVOS, pgm_read_byte(IN_FLASH + (uint16_t)AT_SERVOS));
    eeprom_update_block(flashed, AT_UNIQUE, UNIQUE_LENGTH); /* last: if the power goes before, it is done again */
}

void identity_load(struct board *board) {
    take_over();
    uint8_t servos = eeprom_read_byte(AT_SERVOS);
    board->servos = servos >= 1 && servos <= MOST_SERVOS ? servos : MOST_SERVOS;
    eeprom_read_block(board->name, AT_NAME, NAME_LENGTH);
    if (board->name[0] == BLANK)
        memset(board->name, 0, NAME_LENGTH);
    eeprom_read_block(board->unique, AT_UNIQUE, UNIQUE_LENGTH);
    board->reset_cause = reset_cause;
    board->nonce = next_nonce();
}

void identity_keep_name(const struct board *board) {
    eeprom_update_block(board->name, AT_NAME, NAME_LENGTH);
}
