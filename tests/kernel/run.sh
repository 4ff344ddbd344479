#!/bin/sh
# Boots Debian's kernel in QEMU (plain emulation, no KVM) with its dummy_hcd, behind which maestro_gadget.cpp plays a
# Maestro by FunctionFS, and lets the program drive it while it is unplugged (its gadget unbound), hangs, stalls, and while
# its watchdog bites: a real kernel's USB stack, usbfs and uevents. Judged from the gadget's log: tests/kernel/run.sh [ROUNDS],
# 6 by default, about a minute and a half each on one core.
set -eu
cd "$(dirname "$0")/../.."
.ci/install-packages qemu-system-x86 linux-image-amd64 busybox-static cpio
[ -e build/release/CMakeCache.txt ] || cmake --preset release -DPALPATE_TESTS=ON -DPALPATE_BENCH=OFF > /dev/null
cmake --build build/release --target palpate palpate-tetgen maestro-gadget wire-judge
program=build/release/palpate
kernel=$(ls /boot/vmlinuz-*-amd64 | sort -V | tail -1)
release=${kernel#/boot/vmlinuz-}
root=$PWD/build/kernel/root
rm -rf "$root"
mkdir -p "$root/bin" "$root/proc" "$root/sys" "$root/dev" "$root/tmp" "$root/modules"
cp /bin/busybox "$root/bin/"
cp $program build/release/palpate-tetgen build/release/tests/maestro-gadget "$root/bin/"
strip "$root"/bin/palpate*
for library in $(ldd $program build/release/palpate-tetgen build/release/tests/maestro-gadget | grep -o '/[^ :)]*' | grep '\.so' | sort -u); do
    mkdir -p "$root$(dirname "$library")"
    cp -L "$library" "$root$library"
done
# In the order in which they need one another.
for module in $(for m in dummy_hcd usb_f_fs; do modprobe -S "$release" --show-depends $m; done | sed -n 's/^insmod \([^ ]*\).*/\1/p'); do
    cp "$module" "$root/modules/"
    basename "$module"
done | awk '!seen[$0]++' > "$root/modules/order"
grep -q dummy_hcd "$root/modules/order" || { echo "this kernel has no dummy_hcd" >&2; exit 1; }
cp tests/kernel/init.sh "$root/init"
chmod +x "$root/init"
cat > "$root/tmp/scene.toml" << 'END'
duration_s = 3
dt_ms = 50
[solver]
preset = "real-time"
precision = "float"
[[object]]
name = "table"
kind = "plane"
[[finger]]
name = "index"
elements = 20
device = { kind = "chinello-3rrs", driver = "maestro", serial = "00123456", calibration = "cal.toml", channels = [0, 1, 2] }
track = [ { t_s = 0, position_mm = [0, 0, 9] }, { t_s = 2, position_mm = [0, 0, 6.5], rotation_deg = [10, 0, 0] }, { t_s = 4, position_mm = [0, 0, 6.5], rotation_deg = [-10, 0, 0] } ]
END
for servo in 0 1 2; do
    printf '[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 992\nmax_us = 2000\n'
done > "$root/tmp/cal.toml"
failed=0
plans="none 1.5:unplug,2.5:replug 1.5:hang 1:unplug,1.6:replug,2.2:unplug,2.6:replug 1.5:bite 1.2:stall,1.8:hang,3:unplug"
round=0
for plan in $plans; do
    round=$((round + 1))
    [ $round -le "${1:-6}" ] || break
    echo "$plan" | sed 's/none//; s/,/ /g' > "$root/tmp/plan"
    (cd "$root" && find . | cpio -o -H newc --quiet | gzip -1) > build/kernel/initramfs.gz
    log=build/kernel/round_$round.log
    timeout 600 qemu-system-x86_64 -accel tcg -cpu max -m 1024 -smp 2 -nographic -no-reboot -kernel "$kernel" \
        -initrd build/kernel/initramfs.gz -append "console=ttyS0 panic=-1 quiet" > "$log" 2>&1 < /dev/null || true
    tr -d '\r' < "$log" > "$log.txt" && mv "$log.txt" "$log"
    sed -n '/^WIRE BEGIN/,/^WIRE END/p' "$log" | sed '1d;$d' > build/kernel/round_$round.wire
    echo "round $round, $plan: $(build/release/tests/wire-judge build/kernel/round_$round.wire "$log")" | tee build/kernel/verdict
    grep -q ': safe' build/kernel/verdict || failed=1
done
exit $failed
