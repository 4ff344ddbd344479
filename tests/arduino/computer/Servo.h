#pragma once
// Arduino's Servo library on a computer, as far as the sketch uses it.

class Servo {
  public:
    void attach(int pin, int, int) {
        pin_ = pin;
        arduino::keep_pulse(pin_, us_);
    }
    void detach() {
        if (pin_ >= 0) arduino::keep_pulse(pin_, 0);
        pin_ = -1;
    }
    void writeMicroseconds(int us) {
        if (us != us_ && pin_ >= 0) arduino::keep_pulse(pin_, us);
        us_ = us;
    }
    bool attached() const { return pin_ >= 0; }

  private:
    int pin_ = -1, us_ = 1500;
};
