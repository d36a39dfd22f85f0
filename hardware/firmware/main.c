/* The board with its wires: everything is asked in turn, and the processor sleeps until the next interrupt. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "board.h"
#include "clock.h"
#include "identity.h"
#include "mpu6050.h"
#include "servos.h"
#include "twi.h"
#include "uart.h"

#define STOP_PIN _BV(PIND2)
#define STOP_AFTER 3 /* ms the contact must be open: longer than a bounce, shorter than a frame */

static struct board board;

static void stop_start(void) {
    PORTD |= STOP_PIN; /* pulled up: a broken wire reads as pressed */
}

static void stop_watch(void) {
    static uint8_t open;
    open = PIND & STOP_PIN ? open + 1 : 0;
    if (open >= STOP_AFTER) {
        board_stop(&board);
        open = STOP_AFTER;
    }
}

static void each_millisecond(uint32_t now) {
    wdt_reset(); /* here and nowhere else: without a clock or without this loop the board resets */
    clock_alive();
    stop_watch();
    board_tick(&board, now);
    mpu6050_poll(&board.imu, now);
    servos_drive(&board);
}

static bool to_serve(void) {
    return uart_readable() && uart_room(MOST_FRAME);
}

/* Takes what has arrived, up to the end of one request. */
static void serve(uint32_t now) {
    uint8_t frame[MOST_FRAME];
    while (to_serve()) {
        for (uint8_t lost = uart_overruns(); lost; lost--)
            count(&board.overruns);
        uint8_t length = board_byte(&board, uart_read(), now, frame);
        if (length == 0)
            continue;
        servos_drive(&board); /* a stop is not to wait for the reply */
        if (board.renamed) {
            board.renamed = false;
            identity_keep_name(&board);
        }
        uart_write(frame, length);
        return;
    }
}

static void rest(uint32_t now) {
    cli();
    if (clock_now() == now && !to_serve()) {
        sleep_enable();
        sei(); /* takes effect after the next instruction: nothing can come between */
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

int main(void) {
    set_sleep_mode(SLEEP_MODE_IDLE);
    identity_load(&board);
    board_start(&board);
    servos_start();
    stop_start();
    twi_start();
    uart_start();
    clock_start();
    wdt_enable(WDTO_120MS);
    sei();
    uint32_t seen = 0;
    for (;;) {
        uint32_t now = clock_now();
        if (now != seen) {
            each_millisecond(now);
            seen = now;
        }
        serve(now);
        rest(now);
    }
}
