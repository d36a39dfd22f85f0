/* The MPU-6050 as far as the firmware can see it: a slave on the two-wire bus that feels accelerations. */
#ifndef MPU6050_H
#define MPU6050_H

#include <simavr/sim_avr.h>
#include <stdbool.h>

#include "board.h"

struct mpu6050 {
    avr_t *avr;
    avr_irq_t *bus; /* those of the master: answers go in, questions come out */
    uint64_t random;
    double felt[3], noise;
    enum imu_state state;
    uint8_t registers[128];
    uint8_t at;
    bool selected, addressed;
    uint8_t clocks;  /* by hand, while it holds the bus */
    uint64_t sample; /* which of the sensor's own readings is in the registers */
};

/* Connects it to the master's bus; a second call after a reset is not needed. */
void mpu6050_connect(struct mpu6050 *imu, avr_t *avr, uint64_t seed);

/* As after switching on: asleep. */
void mpu6050_reset(struct mpu6050 *imu);

/* The next of a sequence of random numbers. */
uint64_t random_next(uint64_t *random);

#endif
