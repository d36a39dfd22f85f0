#include "mpu6050.h"

#include "twi.h"

#define DEVICE 0x68
#define WHO_AM_I 0x75
#define ACCELERATIONS 0x3B

#define TIMEOUT_MS 5u /* a reading takes 0.3 ms */
#define RETRY_MS 20u
#define WAKE_AGAIN_MS 250u

/* What is written after it has been found. */
static const uint8_t settings[][2] = {
    {0x6B, 0x01}, /* PWR_MGMT_1: awake, clock from the gyroscope */
    {0x1A, 0x03}, /* CONFIG: 44 Hz, above any movement of a servo and below its vibration */
    {0x19, 0x04}, /* SMPLRT_DIV: 200 readings a second */
    {0x1C, 0x00}, /* ACCEL_CONFIG: +-2 g */
};
#define SETTINGS (sizeof settings / sizeof settings[0])

static enum { LOOKING, SETTING, WAITING, READING } phase;
static uint8_t setting;
static uint32_t since; /* ms: when the exchange under way, or the last one, began */
static uint32_t woken; /* ms: when a stuck one was last set up again */

static void look_again(struct imu *imu) {
    imu_failure(imu);
    phase = LOOKING;
}

static void done(struct imu *imu, uint32_t now) {
    const uint8_t *bytes = twi_bytes();
    int16_t raw[3];
    switch (phase) {
    case LOOKING:
        if (bytes[0] == 0 || bytes[0] == 0xFF) {
            look_again(imu);
            return;
        }
        imu->who = bytes[0];
        phase = SETTING;
        setting = 0;
        break;
    case SETTING:
        if (++setting == SETTINGS)
            phase = WAITING;
        break;
    default:
        for (uint8_t axis = 0; axis < 3; axis++)
            raw[axis] = (int16_t)((uint16_t)bytes[2 * axis] << 8 | bytes[2 * axis + 1]);
        imu_reading(imu, raw, now);
        phase = WAITING;
        if (imu_stuck(imu) && now - woken >= WAKE_AGAIN_MS) {
            /* One that has lost its supply for a moment sleeps and repeats itself: find it and wake it again. */
            woken = now;
            phase = LOOKING;
        }
    }
}

static void ask(const struct imu *imu, uint32_t now) {
    switch (phase) {
    case LOOKING:
        if (now - since < RETRY_MS && imu->failures > 0)
            return;
        twi_exchange(DEVICE, WHO_AM_I, 0, 1);
        break;
    case SETTING:
        twi_exchange(DEVICE, settings[setting][0], settings[setting][1], 0);
        break;
    default:
        if (now - since < IMU_PERIOD_MS)
            return;
        phase = READING;
        twi_exchange(DEVICE, ACCELERATIONS, 0, 6);
    }
    since = now;
}

void mpu6050_poll(struct imu *imu, uint32_t now) {
    switch (twi_state()) {
    case TWI_BUSY:
        if (now - since < TIMEOUT_MS)
            return;
        twi_recover();
        look_again(imu);
        return;
    case TWI_FAILED:
        twi_finish();
        look_again(imu);
        break;
    case TWI_DONE:
        twi_finish();
        done(imu, now);
        break;
    case TWI_IDLE:
        break;
    }
    ask(imu, now);
}
