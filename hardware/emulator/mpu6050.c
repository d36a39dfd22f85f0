#include "mpu6050.h"

#include <math.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <string.h>

#define ADDRESS 0x68
#define PER_G 16384.0 /* in the range of +-2 g */
#define SCL_BIT 5 /* of port C */
#define CLOCKS 9 /* that end any byte */

enum { SMPLRT_DIV = 0x19, ACCEL_CONFIG = 0x1C, ACCEL_XOUT_H = 0x3B, ACCEL_ZOUT_L = 0x40 };
enum { PWR_MGMT_1 = 0x6B, WHO_AM_I = 0x75 };
#define ASLEEP 0x40
#define RESET 0x80

uint64_t random_next(uint64_t *random) { /* splitmix64 */
    uint64_t z = (*random += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static double uniform(uint64_t *random) {
    return ((double)(random_next(random) >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(uint64_t *random) {
    double radius = sqrt(-2 * log(uniform(random)));
    return radius * cos(2 * M_PI * uniform(random));
}

void mpu6050_reset(struct mpu6050 *imu) {
    memset(imu->registers, 0, sizeof imu->registers);
    imu->registers[PWR_MGMT_1] = ASLEEP;
    imu->registers[WHO_AM_I] = 0x68;
    imu->selected = false;
    imu->sample = UINT64_MAX;
}

/* The sensor measures at its own pace; whoever asks sooner gets the same again. */
static void measure(struct mpu6050 *imu) {
    uint64_t period = imu->avr->frequency / 1000 * (1u + imu->registers[SMPLRT_DIV]);
    uint64_t sample = imu->avr->cycle / period;
    if (sample == imu->sample || imu->registers[PWR_MGMT_1] & ASLEEP || imu->state == IMU_STUCK)
        return;
    imu->sample = sample;
    double per_g = PER_G / (1 << (imu->registers[ACCEL_CONFIG] >> 3 & 3));
    for (int axis = 0; axis < 3; axis++) {
        double raw = per_g * (imu->felt[axis] + imu->noise * normal(&imu->random));
        long rounded = lround(fmin(fmax(raw, -32768), 32767));
        imu->registers[ACCEL_XOUT_H + 2 * axis] = (uint8_t)((unsigned long)rounded >> 8);
        imu->registers[ACCEL_XOUT_H + 2 * axis + 1] = (uint8_t)rounded;
    }
}

static void answer(struct mpu6050 *imu, uint8_t message, uint8_t data) {
    avr_raise_irq(imu->bus + TWI_IRQ_INPUT, avr_twi_irq_msg(message, ADDRESS << 1, data));
}

static void write_byte(struct mpu6050 *imu, uint8_t byte) {
    if (!imu->addressed) {
        imu->at = byte & 0x7F;
        imu->addressed = true;
        return;
    }
    if (imu->at == PWR_MGMT_1 && byte & RESET) {
        mpu6050_reset(imu);
        imu->selected = true;
        return;
    }
    if (imu->at != WHO_AM_I && !(imu->at >= ACCEL_XOUT_H && imu->at <= ACCEL_ZOUT_L))
        imu->registers[imu->at] = byte;
    imu->at = (imu->at + 1) & 0x7F;
}

static void on_bus(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct mpu6050 *imu = param;
    avr_twi_msg_irq_t message = {.u.v = value};
    uint8_t what = message.u.twi.msg;
    if (imu->state == IMU_BUS_DEAD || imu->state == IMU_BUS_HELD) { /* a line held down: the master waits for ever */
        imu->avr->data[0xBC] &= (uint8_t)~1; /* TWCR, TWIE: what comes of it is told to nobody */
        return;
    }
    if (what & TWI_COND_STOP)
        imu->selected = false;
    if (what & TWI_COND_START) {
        imu->selected = imu->state != IMU_UNPLUGGED && message.u.twi.addr >> 1 == ADDRESS;
        bool reading = message.u.twi.addr & 1;
        if (!reading)
            imu->addressed = false;
        else if (imu->selected && imu->at == ACCEL_XOUT_H)
            measure(imu);
        if (imu->selected)
            answer(imu, TWI_COND_ACK, 1);
    }
    if (!imu->selected || imu->state == IMU_UNPLUGGED)
        return;
    if (what & TWI_COND_WRITE) {
        answer(imu, TWI_COND_ACK, 1);
        write_byte(imu, message.u.twi.data);
    }
    if (what & TWI_COND_READ) {
        answer(imu, TWI_COND_READ, imu->registers[imu->at]);
        imu->at = (imu->at + 1) & 0x7F;
    }
}

/* A master that pulls the clock line down by hand: a slave in the middle of a byte gives its bits and lets go. */
static void on_direction(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct mpu6050 *imu = param;
    bool pulled = value >> SCL_BIT & 1;
    if (pulled && imu->state == IMU_BUS_HELD && ++imu->clocks >= CLOCKS)
        imu->state = IMU_FINE;
}

void mpu6050_connect(struct mpu6050 *imu, avr_t *avr, uint64_t seed) {
    imu->avr = avr;
    imu->random = seed;
    imu->felt[2] = 1;
    imu->bus = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    avr_irq_register_notify(imu->bus + TWI_IRQ_OUTPUT, on_bus, imu);
    avr_irq_t *port = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), IOPORT_IRQ_DIRECTION_ALL);
    avr_irq_register_notify(port, on_direction, imu);
    mpu6050_reset(imu);
}
