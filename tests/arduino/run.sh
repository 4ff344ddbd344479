#!/bin/sh
# Compiles the reference sketch of devices/arduino as the Arduino tools do, for an Uno and a Mega: with a PCA9685 it is
# the whole program; with servos on pins, its objects against a header in the place of the Servo library, which Debian
# does not have. Needs Debian's gcc-avr, avr-libc, arduino-core-avr.
set -eu
cd "$(dirname "$0")/../.."
avr=/usr/share/arduino/hardware/arduino/avr
sketch=devices/arduino/palpate_servos
[ -d $avr/cores/arduino ] && command -v avr-g++ > /dev/null ||
    { echo "arduino-core-avr or gcc-avr is not installed" >&2; exit 2; }
out=${TMPDIR:-/tmp}/palpate_sketch.$$
mkdir -p "$out"
trap 'rm -rf "$out"' EXIT
for board in atmega328p:standard atmega2560:mega; do
    chip=${board%%:*}
    flags="-mmcu=$chip -DF_CPU=16000000UL -DARDUINO=10819 -DARDUINO_ARCH_AVR -DDECIMAL_DIG=__DECIMAL_DIG__ -Os -ffunction-sections -fdata-sections
        -I$avr/cores/arduino -I$avr/variants/${board##*:} -I$avr/libraries/Wire/src -I$avr/libraries/Wire/src/utility"
    own="-std=gnu++11 -fno-exceptions -fno-threadsafe-statics -Wall -Wextra -Werror -I$sketch -x c++ -include Arduino.h"
    # shellcheck disable=SC2086
    {
        avr-g++ $flags -Itests/arduino/avr $own -DUSE_PCA9685=0 -c $sketch/palpate_servos.ino -o "$out/pins.o"
        avr-g++ $flags $own -DUSE_PCA9685=1 -c $sketch/palpate_servos.ino -o "$out/sketch.o"
        objects="$out/sketch.o"
        for source in "$avr"/cores/arduino/*.c "$avr"/cores/arduino/*.cpp "$avr"/libraries/Wire/src/*.cpp \
            "$avr"/libraries/Wire/src/utility/*.c; do
            object="$out/$(basename "$source").o"
            case $source in
                *.c) avr-gcc -w -std=gnu11 $flags -c "$source" -o "$object" ;;
                *) avr-g++ -w -std=gnu++11 -fno-exceptions -fno-threadsafe-statics $flags -c "$source" -o "$object" ;;
            esac
            objects="$objects $object"
        done
        avr-gcc -mmcu="$chip" -Os -Wl,--gc-sections $objects -lm -o "$out/sketch.elf"
    }
    set -- $(avr-size "$out/sketch.elf" | tail -1)
    echo "$chip: $(($1 + $2)) bytes of program, $(($2 + $3)) bytes of memory"
done
