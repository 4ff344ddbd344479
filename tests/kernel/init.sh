#!/bin/busybox sh
# The first process of the machine that run.sh boots.
busybox=/bin/busybox
$busybox mount -t proc none /proc
$busybox mount -t sysfs none /sys
$busybox mount -t devtmpfs none /dev
for module in $($busybox cat /modules/order); do $busybox insmod "/modules/$module"; done
$busybox mount -t configfs none /sys/kernel/config
g=/sys/kernel/config/usb_gadget/maestro
$busybox mkdir -p $g && cd $g || exit 1
echo 0x1ffb > idVendor
echo 0x008b > idProduct
echo 0x0104 > bcdDevice
$busybox mkdir -p strings/0x409 configs/c.1 functions/ffs.maestro /tmp/ffs
echo 00123456 > strings/0x409/serialnumber
echo Pololu > strings/0x409/manufacturer
echo Maestro > strings/0x409/product
$busybox ln -s functions/ffs.maestro configs/c.1/
$busybox mount -t functionfs maestro /tmp/ffs
cd /tmp || exit 1
# shellcheck disable=SC2046
/bin/maestro-gadget /tmp/ffs $g/UDC dummy_udc.0 /tmp/wire $($busybox cat /tmp/plan) &
n=0
while ! $busybox ls /dev/bus/usb/001/002 > /dev/null 2>&1 && [ $n -lt 100 ]; do $busybox sleep 0.1; n=$((n + 1)); done
/bin/palpate boards
/bin/palpate run scene.toml --arm --out /tmp/results 2>&1
echo "EXIT $?"
echo "WIRE BEGIN"
$busybox cat /tmp/wire
echo "WIRE END"
$busybox dmesg | $busybox grep -iE 'BUG|Oops|dummy_hcd|usb 1' | $busybox tail -20
$busybox poweroff -f
