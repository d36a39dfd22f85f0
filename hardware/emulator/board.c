#include "board.h"

#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>
#include <simavr/sim_regbit.h>
#include <stdlib.h>
#include <string.h>

#include "mpu6050.h"
#include "pulses.h"
#include "serial.h"

#define FREQUENCY 16000000
#define STOP_BIT 2 /* of port D */
#define WITHOUT_A_LOOK 100000 /* cycles at most between two looks at the timers; the next timer ends it sooner */
#define CIRCLE_LOW 0xFF /* rjmp .-2 */
#define CIRCLE_HIGH 0xCF

struct board {
    avr_t *avr;
    void (*core_reset)(avr_t *);
    bool powered;
    uint64_t until;
    uint64_t random;
    struct serial serial;
    struct pulses pulses;
    struct mpu6050 imu;
};

static void silent(avr_t *avr, const int level, const char *format, va_list arguments) {
    (void)avr, (void)level, (void)format, (void)arguments;
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { /* time passes as fast as it can be computed */
    (void)avr, (void)cycles;
}

static avr_cycle_count_t nothing(avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)avr, (void)when, (void)param;
    return 0;
}

/* Wakes a sleeping processor at the end of the slice: otherwise it would sleep past it. */
static void set_end(struct board *board) {
    if (board->until > board->avr->cycle)
        avr_cycle_timer_register(board->avr, board->until - board->avr->cycle, nothing, board);
}

/* Called within every reset, also the watchdog's: all timers are forgotten by then. */
static void on_reset(avr_t *avr) {
    struct board *board = avr->custom.data;
    if (board->core_reset)
        board->core_reset(avr);
    if (board->pulses.avr)
        pulses_cut(&board->pulses);
    avr->run_cycle_limit = WITHOUT_A_LOOK;
    serial_resume(&board->serial);
    set_end(board);
}

void board_press_stop(struct board *board, bool pressed) {
    avr_ioport_external_t wire = {.name = 'D', .mask = 1 << STOP_BIT, .value = pressed ? 1 << STOP_BIT : 0};
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &wire);
    avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), STOP_BIT), pressed);
}

static void forget(struct board *board) {
    for (unsigned i = 0x100; i <= board->avr->ramend; i++)
        board->avr->data[i] = (uint8_t)random_next(&board->random);
}

struct board *board_new(const char *hex, uint64_t seed) {
    avr_global_logger_set(silent);
    ihex_chunk_p parts = NULL;
    int count = read_ihex_chunks(hex, &parts);
    if (count <= 0)
        return NULL;
    struct board *board = calloc(1, sizeof *board);
    avr_t *avr = board->avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    avr->frequency = FREQUENCY;
    for (int i = 0; i < count; i++)
        if (parts[i].baseaddr + parts[i].size <= avr->flashend + 1)
            avr_loadcode(avr, parts[i].data, parts[i].size, parts[i].baseaddr);
    free_ihex_chunks(parts);
    avr->sleep = no_sleep;
    avr->custom.data = board;
    board->core_reset = avr->reset;
    avr->reset = on_reset;
    board->random = seed;
    serial_connect(&board->serial, avr);
    pulses_connect(&board->pulses, avr);
    mpu6050_connect(&board->imu, avr, random_next(&board->random));
    forget(board);
    board_press_stop(board, false);
    return board;
}

void board_free(struct board *board) {
    avr_terminate(board->avr);
    free(board->avr);
    pulses_free(&board->pulses);
    serial_free(&board->serial);
    free(board);
}

int board_run(struct board *board, uint64_t until) {
    avr_t *avr = board->avr;
    board->until = until;
    if (!board->powered) {
        serial_pass_by(&board->serial, until);
        if (avr->cycle < until)
            avr->cycle = until;
        return 0;
    }
    set_end(board);
    while (avr->cycle < until) {
        avr_run(avr);
        if (avr->state == cpu_Crashed || avr->state == cpu_Done)
            return -1;
    }
    return 0;
}

uint64_t board_now(const struct board *board) {
    return board->avr->cycle;
}

void board_power_off(struct board *board) {
    board->powered = false;
    pulses_cut(&board->pulses);
    if (board->serial.next_start < board->avr->cycle)
        board->serial.next_start = board->avr->cycle;
}

void board_power_on(struct board *board, uint8_t cause, bool forgetful) {
    avr_t *avr = board->avr;
    board->powered = true;
    if (forgetful) {
        forget(board);
        mpu6050_reset(&board->imu);
    }
    board->until = 0;
    avr_reset(avr);
    avr->data[avr->reset_flags.porf.reg] = cause;
}

void board_write(struct board *board, const uint8_t *bytes, size_t length) {
    serial_write(&board->serial, bytes, length);
}

size_t board_read(struct board *board, uint8_t *bytes, size_t room) {
    return serial_read(&board->serial, bytes, room);
}

size_t board_pulses(struct board *board, struct pulse *pulses, size_t room) {
    return pulses_take(&board->pulses, pulses, room);
}

void board_eeprom(struct board *board, uint16_t offset, uint8_t *bytes, uint16_t length, bool write) {
    avr_eeprom_desc_t part = {.ee = bytes, .offset = offset, .size = length};
    avr_ioctl(board->avr, write ? AVR_IOCTL_EEPROM_SET : AVR_IOCTL_EEPROM_GET, &part);
}

int board_hang(struct board *board, bool interrupts) {
    avr_t *avr = board->avr;
    for (avr_flashaddr_t at = 0; at + 1 < avr->codeend; at += 2) {
        if (avr->flash[at] == CIRCLE_LOW && avr->flash[at + 1] == CIRCLE_HIGH) {
            avr->pc = at;
            avr->state = cpu_Running;
            avr->sreg[S_I] = interrupts;
            return 0;
        }
    }
    return -1;
}

void board_feel(struct board *board, double x, double y, double z) {
    board->imu.felt[0] = x;
    board->imu.felt[1] = y;
    board->imu.felt[2] = z;
}

void board_noise(struct board *board, double noise) {
    board->imu.noise = noise;
}

void board_imu_restart(struct board *board) {
    mpu6050_reset(&board->imu);
}

void board_imu(struct board *board, int state) {
    board->imu.state = (enum imu_state)state;
    board->imu.clocks = 0;
}
