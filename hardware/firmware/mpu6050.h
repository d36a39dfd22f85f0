/* The MPU-6050 accelerometer: found, woken, set up and read without ever waiting for it. */
#ifndef MPU6050_H
#define MPU6050_H

#include "imu.h"

/* To be called every millisecond. */
void mpu6050_poll(struct imu *imu, uint32_t now);

#endif
