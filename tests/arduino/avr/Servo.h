// The functions of Arduino's Servo library that the sketch uses: to compile against, where the library is not there.
#pragma once
class Servo {
  public:
    unsigned char attach(int pin, int min_us, int max_us);
    void detach();
    void writeMicroseconds(int us);
    bool attached();
};
