#include <palpate/devices/device.h>
#include <cstdio>

int main() {
    for (const std::string& name : palpate::kind_names()) std::printf("%s\n", name.c_str());
    return palpate::find_kind("chinello-3rrs") ? 0 : 1;
}
