// A servo controller for palpate: Arduino (Uno, Nano, Mega, ...) or ESP32, hobby servos on its own pins or on a PCA9685.
// Set the servos below, upload, and say in a scene's finger:
//   device = { kind = "chinello-3rrs", driver = "text", port = "/dev/ttyACM0", channels = [0, 1, 2],
//              calibration = "index.toml" }

#include "servo_line.h"

// Hobby servos on pins (0), or on a PCA9685 at I2C address 0x40 (1).
#ifndef USE_PCA9685
#define USE_PCA9685 0
#endif

// Pin (or channel of the PCA9685), shortest and longest pulse, and home: where a servo goes when nobody commands it any
// more [us]; 0: it gets no pulses then, and lets go.
const ServoConfig servos[] = {
    {3, 900, 2100, 0},
    {5, 900, 2100, 0},
    {6, 900, 2100, 0},
    {9, 900, 2100, 0},
    {10, 900, 2100, 0},
    {11, 900, 2100, 0},
};
const uint8_t servo_count = sizeof servos / sizeof servos[0];

ServoBoard board;

#if USE_PCA9685

#include <Wire.h>
const uint8_t pca9685 = 0x40;

void write_register(uint8_t where, uint8_t value) {
    Wire.beginTransmission(pca9685);
    Wire.write(where);
    Wire.write(value);
    Wire.endTransmission();
}
void begin_pulses() {
    Wire.begin();
    Wire.setClock(400000);
    write_register(0x00, 0x10);  // asleep: the only time that its rate can be set
    write_register(0xFE, 121);   // 25 MHz / (4096 * 50 Hz) - 1
    write_register(0x00, 0x20);  // awake; registers follow each other
    delay(1);
}
void write_pulse(uint8_t channel, uint16_t us) {
    static uint16_t last[most_servos];
    uint16_t ticks = uint16_t((uint32_t(us) * 4096 + 10000) / 20000);
    if (ticks == last[channel]) return;
    last[channel] = ticks;
    Wire.beginTransmission(pca9685);
    Wire.write(uint8_t(0x06 + 4 * servos[channel].pin));
    Wire.write(0);
    Wire.write(0);
    Wire.write(uint8_t(ticks));
    Wire.write(uint8_t(us ? ticks >> 8 : 0x10));  // 0x10: off
    Wire.endTransmission();
}

#else

#if defined(ESP32)
#include <ESP32Servo.h>
#else
#include <Servo.h>
#endif
Servo outputs[servo_count];

void begin_pulses() {}
void write_pulse(uint8_t channel, uint16_t us) {
    if (us == 0) {
        outputs[channel].detach();
        return;
    }
    // The pulse before the pin: a servo never sees the library's own default.
    outputs[channel].writeMicroseconds(us);
    if (!outputs[channel].attached()) {
        outputs[channel].attach(servos[channel].pin, servos[channel].min_us, servos[channel].max_us);
        outputs[channel].writeMicroseconds(us);
    }
}

#endif

// Servos that tell where they are: return it here [us], from their potentiometer's pin.
uint16_t measured_pulse(uint8_t) { return 0; }

void write_text(const char* text) { Serial.write(text); }

void setup() {
    Serial.begin(115200);
    begin_pulses();
    begin_board(board, servos, servo_count, millis());
}

void loop() {
    while (Serial.available() > 0) receive_byte(board, char(Serial.read()), millis());
    tick_board(board, millis());
}
