/* A preset finger with a simulated thimble is pressed on a plane; forces and joint angles are printed.
     cc press.c -lpalpate -o press && ./press */
#include <palpate/palpate.h>
#include <stdio.h>

static int failed(const char* what, int32_t result) {
    if (result != PALPATE_OK) fprintf(stderr, "%s: %s\n", what, palpate_last_error());
    return result != PALPATE_OK;
}

int main(void) {
    PalpateFingerDef finger;
    PalpateObjectDef table;
    PalpateSceneDef scene;
    PalpateWorld world = 0;
    int step;

    palpate_default_finger_def(&finger, sizeof finger);
    finger.name = "index";
    finger.finger = "index-median";
    finger.device = "chinello-3rrs";
    finger.pose[2] = 0.010; /* above the plane z = 0 [m] */

    palpate_default_object_def(&table, sizeof table);
    table.name = "table";
    table.shape = PALPATE_PLANE;
    table.friction = 0.5;

    palpate_default_scene_def(&scene, sizeof scene);
    scene.fingers = &finger;
    scene.finger_count = 1;
    scene.objects = &table;
    scene.object_count = 1;
    if (failed("build", palpate_build(&scene, NULL, &world))) return 1;

    printf("  time s  force N  area mm2  samples  joints deg\n");
    for (step = 1; step <= 300; ++step) {
        double pose[7] = {0, 0, 0.010, 1, 0, 0, 0};
        pose[2] -= 0.004 * (step < 200 ? step / 200.0 : 1.0); /* 4 mm down in 0.2 s */
        if (failed("pose", palpate_set_finger_pose(world, 0, pose))) return 1;
        if (failed("step", palpate_step(world, 1))) return 1;
        if (step % 50 == 0) {
            PalpateFingerState felt;
            PalpateThimbleState thimble;
            felt.size = sizeof felt;
            thimble.size = sizeof thimble;
            if (failed("finger", palpate_get_finger(world, 0, &felt))) return 1;
            if (failed("thimble", palpate_get_thimble(world, 0, &thimble))) return 1;
            printf("%8.3f %8.4f %9.2f %8d  %.1f %.1f %.1f\n", felt.time, felt.force[2], 1e6 * felt.contact_area,
                   (int)felt.touching, 57.29578 * thimble.sent[0], 57.29578 * thimble.sent[1],
                   57.29578 * thimble.sent[2]);
        }
    }
    return failed("destroy", palpate_destroy(world));
}
