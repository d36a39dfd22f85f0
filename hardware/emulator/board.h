/* An ATmega328P with the firmware in it, the wires that lead to it, and the clock that all of them share. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct board;

struct pulse {
    uint64_t rise; /* cycles of 1/16 us since the beginning */
    uint32_t width;
    uint8_t channel;
    uint8_t cut; /* ended by a reset, the supply or the firmware, not by the timer */
};

/* NULL if the file is no firmware. `seed` decides the sensor's noise and what an unpowered memory holds. */
struct board *board_new(const char *hex, uint64_t seed);
void board_free(struct board *board);

/* The supply is off until this. Afterwards as long as the board runs: 0, or -1 if the firmware has crashed. */
int board_run(struct board *board, uint64_t until);
uint64_t board_now(const struct board *board);

/* The supply; what the reset will have been caused by when it comes (bits of MCUSR); whether memories forget. */
void board_power_off(struct board *board);
void board_power_on(struct board *board, uint8_t cause, bool forget);

/* The serial line: bytes queue up on their way in, each takes 40 us; out come those that have wholly left by now. */
void board_write(struct board *board, const uint8_t *bytes, size_t length);
size_t board_read(struct board *board, uint8_t *bytes, size_t room);

/* Pulses that have ended since the last call, in order of their ends. */
size_t board_pulses(struct board *board, struct pulse *pulses, size_t room);

void board_eeprom(struct board *board, uint16_t offset, uint8_t *bytes, uint16_t length, bool write);

/* The button on D2: its contact opens when pressed. */
void board_press_stop(struct board *board, bool pressed);

/* The processor runs in a circle from now on, with its interrupts served or not. -1: the firmware has no circle. */
int board_hang(struct board *board, bool interrupts);

/* What the accelerometer feels (g, along its own axes) and the noise on it (g, standard deviation). */
void board_feel(struct board *board, double x, double y, double z);
void board_noise(struct board *board, double noise);

enum imu_state { IMU_FINE, IMU_UNPLUGGED, IMU_STUCK, IMU_BUS_DEAD, IMU_BUS_HELD };
void board_imu(struct board *board, int state);

/* The sensor alone loses its supply for a moment: it comes back asleep. */
void board_imu_restart(struct board *board);

#endif
