#include "imu.h"

#include <string.h>

void imu_reading(struct imu *imu, const int16_t raw[3], uint32_t now) {
    uint8_t last = imu->next == 0 ? IMU_MEAN - 1 : imu->next - 1;
    bool again = imu->count > 0 && memcmp(imu->readings[last], raw, sizeof imu->readings[0]) == 0;
    if (!again && imu_stuck(imu)) /* what it repeated is not averaged with what it says now */
        imu->count = imu->next = 0;
    if (!again)
        imu->same = 0;
    else if (imu->same < UINT8_MAX)
        imu->same++;
    memcpy(imu->readings[imu->next], raw, sizeof imu->readings[0]);
    imu->next = (imu->next + 1) % IMU_MEAN;
    if (imu->count < IMU_MEAN)
        imu->count++;
    imu->failures = 0;
    imu->at = now;
}

void imu_failure(struct imu *imu) {
    if (imu->failures < UINT8_MAX)
        imu->failures++;
    if (imu->failures >= IMU_MISSING_AFTER) { /* what comes after a gap is not averaged with what was before it */
        imu->count = imu->next = 0;
        imu->same = 0;
    }
}

bool imu_missing(const struct imu *imu) {
    return imu->count == 0;
}

bool imu_stuck(const struct imu *imu) {
    return imu->same >= IMU_STUCK_AFTER - 1;
}

void imu_mean(const struct imu *imu, int16_t mean[3]) {
    for (uint8_t axis = 0; axis < 3; axis++) {
        int32_t sum = 0;
        for (uint8_t i = 0; i < imu->count; i++)
            sum += imu->readings[i][axis];
        mean[axis] = imu->count ? (int16_t)(sum / imu->count) : 0;
    }
}

uint8_t imu_age(const struct imu *imu, uint32_t now) {
    if (imu_missing(imu))
        return IMU_NO_AGE;
    uint32_t age = now - imu->at;
    return age > 254 ? 254 : (uint8_t)age;
}
