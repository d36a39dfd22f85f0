/* What is made of the accelerometer's readings: their mean, their age, and whether they can be believed. */
#ifndef IMU_H
#define IMU_H

#include <stdbool.h>
#include <stdint.h>

#define IMU_PERIOD_MS 5u /* 200 readings a second */
#define IMU_MEAN 4       /* readings in the mean: 20 ms, one servo frame */
#define IMU_MISSING_AFTER 5
#define IMU_STUCK_AFTER 50 /* bit-identical readings in a row; a live sensor's noise never does that */
#define IMU_NO_AGE 255

struct imu {
    uint8_t who; /* its WHO_AM_I; 0: none was ever found */
    int16_t readings[IMU_MEAN][3];
    uint8_t count, next; /* how many of them are valid, where the next one goes */
    uint8_t same;        /* readings in a row that equal the one before */
    uint8_t failures;    /* in a row */
    uint32_t at;         /* ms of the last reading */
};

/* A reading (raw, +-2 g) has arrived. */
void imu_reading(struct imu *imu, const int16_t raw[3], uint32_t now);

/* A reading was asked for and did not arrive. */
void imu_failure(struct imu *imu);

bool imu_missing(const struct imu *imu);
bool imu_stuck(const struct imu *imu);

/* The mean of the last readings; zeros while it is missing. */
void imu_mean(const struct imu *imu, int16_t mean[3]);

/* Milliseconds since the last reading, at most 254; IMU_NO_AGE while it is missing. */
uint8_t imu_age(const struct imu *imu, uint32_t now);

#endif
