/* Prints the bits of a scene step by step: bits SCENE STEPS */
#include <palpate/palpate.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int show(PalpateWorld world, int32_t field, int32_t index) {
    PalpateView view;
    int32_t k, n;
    view.size = sizeof view;
    if (palpate_view(world, field, index, &view) != PALPATE_OK) return 0;
    n = view.shape[0] * (view.rank == 2 ? view.shape[1] : 1);
    for (k = 0; k < n; ++k) {
        unsigned long long bits;
        memcpy(&bits, (const double*)view.data + k, sizeof bits);
        printf(" %016llx", bits);
    }
    return 1;
}

int main(int argc, char** argv) {
    PalpateWorld world = 0;
    int step;
    if (argc != 3 || palpate_load(argv[1], NULL, &world) != PALPATE_OK) return fputs(palpate_last_error(), stderr), 1;
    for (step = 1; step <= atoi(argv[2]); ++step) {
        if (palpate_step(world, 1) != PALPATE_OK) return 1;
        printf("%d", step);
        if (!show(world, PALPATE_NET_FORCES, -1) || !show(world, PALPATE_NET_TORQUES, -1) ||
            !show(world, PALPATE_BONE_POSES, -1) || !show(world, PALPATE_OBJECT_POSES, -1) ||
            !show(world, PALPATE_OBJECT_FORCES, -1) ||
            !show(world, PALPATE_JOINTS_SENT, 0))
            return fputs(palpate_last_error(), stderr), 1;
        printf("\n");
    }
    return palpate_destroy(world) != PALPATE_OK;
}
