/* palpate in C: load or build a scene, step it, read what fingers feel. scenes/api/README.md shows how.

   Units are SI: m, N, Pa, kg, s, rad. A pose is 7 numbers: position x y z [m], rotation as a unit quaternion w x y z;
   from the finger's (or object's) own frame to the world. Arrays are row by row.

   Every function returns PALPATE_OK or a negative code; palpate_last_error() then says what was wrong, where, and how
   to mend it. Nothing throws, aborts or prints. A function that fails has changed nothing, unless it says so.

   Threads: one thread at a time steps, saves, restores or reads views of a world; a second one gets PALPATE_ERROR_BUSY
   and does not wait. palpate_set_finger_pose, palpate_release_finger, palpate_set_object_pose, palpate_release_object
   and palpate_read_snapshot may be called from any thread at any time. Worlds are independent of each other.

   Structs begin with their size: set it to sizeof before a call that fills one; the palpate_default_ functions do it
   for those that are filled by you. So a library that is newer than your program still understands it. */

#ifndef PALPATE_H
#define PALPATE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define PALPATE_API __attribute__((visibility("default")))
#else
#define PALPATE_API
#endif

/* A world: a scene that is being run. 0 is none. Ids of destroyed worlds are never valid again. */
typedef int64_t PalpateWorld;

enum {
    PALPATE_OK = 0,
    PALPATE_ERROR_ARGUMENT = -1, /* a null pointer, a number out of range or not finite */
    PALPATE_ERROR_WORLD = -2,    /* no such world, or it has been destroyed */
    PALPATE_ERROR_SCENE = -3,    /* a scene, setting or recording that cannot be used: every problem, one a line */
    PALPATE_ERROR_BUSY = -4,     /* another thread is using the world */
    PALPATE_ERROR_SIZE = -5,     /* your buffer is too small; what is needed was written */
    PALPATE_ERROR_STATE = -6,    /* not now: a body is moved by forces, a recording has ended, ... */
    PALPATE_ERROR_FILE = -7,     /* a file cannot be read or written */
    PALPATE_ERROR_MEMORY = -8,   /* out of memory */
    PALPATE_ERROR_INTERNAL = -9  /* a fault in palpate */
};

/* Version of this header; palpate_api_version() is that of the library. */
#define PALPATE_API_VERSION 1
PALPATE_API int32_t palpate_api_version(void);
/* Of palpate, for example "0.1.0". */
PALPATE_API const char* palpate_version(void);
/* What was wrong with the last call of this thread that failed; valid until its next one. */
PALPATE_API const char* palpate_last_error(void);

/* Where it is told what a person should know, one sentence a call; NULL: nowhere. Scenes: warnings and notes as they
   are loaded (palpate_get_text has the warnings in any case). Steps: a finger that diverged, steps that did not
   converge (the 1st, 2nd, 4th, 8th, ... of a finger). Called by the thread that loads or steps, which for
   palpate_step_many are several at once; it must not call palpate for the world that it is told of. */
typedef void (*PalpateLog)(const char* message, void* user);
PALPATE_API int32_t palpate_set_log(PalpateLog log, void* user);
enum {
    PALPATE_LOG_NOTE = 0,   /* how something was understood */
    PALPATE_LOG_WARNING = 1 /* likely a mistake, or results that should not be trusted */
};
/* Within a PalpateLog: what kind of message it is, and of which world (0: one that is being loaded). Either may be
 * NULL. */
PALPATE_API int32_t palpate_log_about(int32_t* level, PalpateWorld* world);

/* ---- Worlds ---- */

typedef struct PalpateWorldDef {
    int32_t size;
    int32_t threads;             /* that a step uses; 1. 0: as many as the machine has */
    const char* const* settings; /* "solver.preset=balanced": as after `palpate run --set` */
    int32_t setting_count;       /* 0 */
    int32_t reserved;
    const char* folder; /* of text: where the files that it names are; NULL: the working folder */
} PalpateWorldDef;
PALPATE_API int32_t palpate_default_world_def(PalpateWorldDef* def, int32_t size);

/* From a scene file, or the name of a scene that comes with palpate ("hand"). `def` may be NULL. */
PALPATE_API int32_t palpate_load(const char* file, const PalpateWorldDef* def, PalpateWorld* world);
/* From the text of a scene (TOML). */
PALPATE_API int32_t palpate_load_text(const char* text, const PalpateWorldDef* def, PalpateWorld* world);

typedef struct PalpateFingerDef {
    int32_t size;
    int32_t elements;     /* tetrahedra wanted; 0: as the preset has it */
    const char* name;     /* NULL: "finger 0", ... */
    const char* finger;   /* preset ("index-median") or finger file (ends with .toml) */
    const char* device;   /* kind of the thimble that it wears ("chinello-3rrs"); NULL: none */
    const char* method;   /* of its matching; NULL: "constrained" */
    double pose[7];       /* tracked pose until another one is set */
    double young_modulus; /* [Pa]; 0: as the preset has it */
} PalpateFingerDef;
PALPATE_API int32_t palpate_default_finger_def(PalpateFingerDef* def, int32_t size);

enum {
    PALPATE_PLANE = 0, /* the half-space below its z = 0 */
    PALPATE_BOX = 1,
    PALPATE_SPHERE = 2,
    PALPATE_CAPSULE = 3, /* along its z, as a cylinder is */
    PALPATE_CYLINDER = 4,
    PALPATE_MESH = 5
};
typedef struct PalpateObjectDef {
    int32_t size;
    int32_t shape;
    const char* name;     /* NULL: "object 0", ... */
    const char* file;     /* of a mesh, in mm */
    double dimensions[3]; /* box: edges x y z; others: radius, length [m] */
    double pose[7];
    double friction;      /* Coulomb coefficient; 0: none is built */
    double stiffness;     /* pressure on skin per depth, where it gives way [Pa/m]; 0: rigid */
    double mass;          /* forces move it [kg]; 0: it stays where it is put */
    double young_modulus; /* it is tissue [Pa]; 0: rigid. No plane, no mass, no stiffness */
    double poisson;       /* of tissue; 0: as `palpate keys object.soft` has it */
    const char* fixed;    /* side of the tissue that is held; "bottom" */
    double fixed_depth;   /* what lies that near to this side is held, too [m]; more than 0 where the side is round */
    int32_t elements;     /* tetrahedra wanted of the tissue; 0: as `palpate keys object.soft` has it */
    int32_t reserved;
} PalpateObjectDef;
PALPATE_API int32_t palpate_default_object_def(PalpateObjectDef* def, int32_t size);

typedef struct PalpateSceneDef {
    int32_t size;
    int32_t finger_count;
    const PalpateFingerDef* fingers;
    const PalpateObjectDef* objects;
    int32_t object_count;
    int32_t reserved;
    double dt;          /* of a step [s]; 0.001 */
    double gravity[3];  /* on bodies [m/s^2] */
    const char* preset; /* of the solver; "balanced". NULL: what `more` says */
    const char* more;   /* further lines of the scene (TOML), before its fingers and objects; NULL: none */
} PalpateSceneDef;
PALPATE_API int32_t palpate_default_scene_def(PalpateSceneDef* def, int32_t size);
/* From descriptions. They become the text of a scene, which palpate_get_text shows and palpate_load_text reads: the
   same checks hold for both. */
PALPATE_API int32_t palpate_build(const PalpateSceneDef* scene, const PalpateWorldDef* def, PalpateWorld* world);

/* Another world in the same state. */
PALPATE_API int32_t palpate_clone(PalpateWorld world, PalpateWorld* clone);
/* Frees it; its views are then invalid. */
PALPATE_API int32_t palpate_destroy(PalpateWorld world);

typedef struct PalpateWorldInfo {
    int32_t size;
    int32_t finger_count, object_count, thimble_count;
    double time;     /* simulated [s] */
    double dt;       /* [s] */
    double duration; /* of a run of the program [s] */
    int64_t step;
    int64_t generation; /* grows whenever what views show may have changed */
} PalpateWorldInfo;
PALPATE_API int32_t palpate_get_info(PalpateWorld world, PalpateWorldInfo* info);

enum {
    PALPATE_TEXT_SCENE = 0,    /* the text of the scene */
    PALPATE_TEXT_WARNINGS = 1, /* what was accepted, but is likely a mistake: one a line */
    PALPATE_TEXT_SETTINGS = 2, /* one a line */
    PALPATE_TEXT_FOLDER = 3,   /* where files that the scene names are */
    PALPATE_TEXT_FINGER = 4,   /* name of the finger with id `index` */
    PALPATE_TEXT_OBJECT = 5,
    PALPATE_TEXT_THIMBLE = 6, /* kind of the device of thimble `index` */
    PALPATE_TEXT_FILE = 7,    /* of the scene; empty where it was given as text */
    PALPATE_TEXT_REPORT = 8   /* one HTML page with 3-D playback, plots and summary, of kept frames or else of now */
};
/* Copies a text with its final zero; `needed` (may be NULL) is its size. With capacity 0 the size alone. */
PALPATE_API int32_t palpate_get_text(PalpateWorld world, int32_t text, int32_t index, char* buffer, int64_t capacity,
                                     int64_t* needed);
/* Id of a finger or object by its name. */
PALPATE_API int32_t palpate_find_finger(PalpateWorld world, const char* name, int32_t* finger);
PALPATE_API int32_t palpate_find_object(PalpateWorld world, const char* name, int32_t* object);

/* Changes settings while it runs ("finger.index.material.young_kPa=40"), which takes milliseconds. Not those that build
   another mesh, or other fingers, objects or thimbles: PALPATE_ERROR_STATE, and a new world is the remedy. Objects that
   nothing moves go to where their position_mm and rotation_deg have changed; bodies are where they are. */
PALPATE_API int32_t palpate_set(PalpateWorld world, const char* const* settings, int32_t count);

/* ---- Fingers, objects and thimbles, their ids, and how they come and go ---- */

/* A world begins with fingers, objects and thimbles 0, 1, 2, ... Those that are added later get ids of their own; ids
   of removed ones are errors from then on. */
enum { PALPATE_FINGERS = 0, PALPATE_OBJECTS = 1, PALPATE_THIMBLES = 2 };
/* Their ids, in the order of rows of the world's views; `count` (may be NULL) becomes their number. With capacity 0
   nothing else happens. */
PALPATE_API int32_t palpate_list(PalpateWorld world, int32_t what, int32_t* ids, int32_t capacity, int32_t* count);

/* Between steps; tens of milliseconds, more where a mesh is made. The others go on with the same bits, unless what is
   new is the first of its kind, or what goes the last (body, friction, elastic object): then they find their contacts
   anew, which is felt for a few steps. What is added must not lie inside what is there. Views of the world, and of what
   was removed, must be asked for anew; old ones can be read still, but say nothing. Not while it records, nor in a
   replay. */
PALPATE_API int32_t palpate_add_finger(PalpateWorld world, const PalpateFingerDef* def, int32_t* finger);
PALPATE_API int32_t palpate_remove_finger(PalpateWorld world, int32_t finger);
PALPATE_API int32_t palpate_add_object(PalpateWorld world, const PalpateObjectDef* def, int32_t* object);
PALPATE_API int32_t palpate_remove_object(PalpateWorld world, int32_t object);
/* The simulated thimble that a finger wears, instead of the one that it wore; NULL: none. `method` of its matching, or
   NULL. Its id is the one that palpate_list has anew. */
PALPATE_API int32_t palpate_set_thimble(PalpateWorld world, int32_t finger, const char* kind, const char* method);

/* ---- Inputs ---- */

/* From the next step on a finger's tracked pose is this, instead of its track; NULL: its tracker does not see it. Until
   palpate_release_finger. */
PALPATE_API int32_t palpate_set_finger_pose(PalpateWorld world, int32_t finger, const double* pose);
PALPATE_API int32_t palpate_release_finger(PalpateWorld world, int32_t finger);
/* The same of an object that no forces move. */
PALPATE_API int32_t palpate_set_object_pose(PalpateWorld world, int32_t object, const double* pose);
PALPATE_API int32_t palpate_release_object(PalpateWorld world, int32_t object);

/* ---- Steps ---- */

#define PALPATE_MOST_STEPS 1000000
/* n steps, 1 to PALPATE_MOST_STEPS. After the first ones it allocates nothing, except while it records. */
PALPATE_API int32_t palpate_step(PalpateWorld world, int32_t n);
/* Steps until the simulated time [s] is reached to half a step. */
PALPATE_API int32_t palpate_step_to(PalpateWorld world, double time);
/* n steps of many worlds, in parallel, on all cores. Each world must be in the list once; make them with threads = 1.
   Where one fails, the others are stepped all the same. */
PALPATE_API int32_t palpate_step_many(const PalpateWorld* worlds, int32_t count, int32_t n);

/* ---- What is felt ---- */

/* Sizes: S samples of the pad, N nodes, E tetrahedra, F faces of the pad; C components of a thimble's configuration, J
   joints. "world" views (index -1) have a row per finger, object. */
enum {
    PALPATE_POSITIONS = 0,         /* finger: [S][3] float64, samples, world [m] */
    PALPATE_FORCES = 1,            /* finger: [S][3] float64, on the skin, world [N] */
    PALPATE_TOUCHES = 2,           /* finger: [S] uint8, 1 where it is pushed */
    PALPATE_PRESSURES = 3,         /* finger: [S] float64, normal force by area [Pa] */
    PALPATE_AREAS = 4,             /* finger: [S] float64, share of the surface at rest [m^2] */
    PALPATE_FACES = 5,             /* finger: [F][3] int32, samples, outward */
    PALPATE_SAMPLE_NODES = 6,      /* finger: [S] int32, node of each sample */
    PALPATE_NODES = 7,             /* finger: [N][3] float64, world [m] */
    PALPATE_REST_NODES = 8,        /* finger: [N][3] float64, finger frame [m] */
    PALPATE_TETRAHEDRA = 9,        /* finger: [E][4] int32, nodes */
    PALPATE_STRETCHES = 10,        /* finger: [E][2] float64, smallest and largest principal stretch */
    PALPATE_CONFIGURATION = 11,    /* thimble: [C] float64 [rad or m] */
    PALPATE_JOINTS_WANTED = 12,    /* thimble: [J] float64 [rad] */
    PALPATE_JOINTS_SENT = 13,      /* thimble: [J] float64 [rad] */
    PALPATE_JOINTS_REACHED = 14,   /* thimble: [J] float64 [rad], of the simulated servos */
    PALPATE_BONE_POSES = 15,       /* world: [fingers][7] float64 */
    PALPATE_TRACKED_POSES = 16,    /* world: [fingers][7] float64, newest valid ones */
    PALPATE_NET_FORCES = 17,       /* world: [fingers][3] float64 [N] */
    PALPATE_NET_TORQUES = 18,      /* world: [fingers][3] float64, about the bone's origin [N m] */
    PALPATE_CENTRES = 19,          /* world: [fingers][3] float64, of pressure [m]; NaN where nothing pushes */
    PALPATE_CONTACT_AREAS = 20,    /* world: [fingers] float64 [m^2] */
    PALPATE_OBJECT_POSES = 21,     /* world: [objects][7] float64 */
    PALPATE_OBJECT_MOTIONS = 22,   /* world: [objects][6] float64, velocity [m/s], angular velocity [rad/s] */
    PALPATE_OBJECT_FORCES = 23,    /* world: [objects][3] float64, on each, as PalpateObjectState has it [N] */
    PALPATE_FORCES_BY_OBJECT = 24, /* finger: [objects][3] float64, of each object on its skin, world [N] */
    /* The same of a soft object (its id), whose bone is its fixed part. A rigid one: PALPATE_ERROR_STATE. */
    PALPATE_SOFT_POSITIONS = 25,
    PALPATE_SOFT_FORCES = 26,
    PALPATE_SOFT_TOUCHES = 27,
    PALPATE_SOFT_PRESSURES = 28,
    PALPATE_SOFT_AREAS = 29,
    PALPATE_SOFT_FACES = 30,
    PALPATE_SOFT_SAMPLE_NODES = 31,
    PALPATE_SOFT_NODES = 32,
    PALPATE_SOFT_REST_NODES = 33, /* object frame */
    PALPATE_SOFT_TETRAHEDRA = 34,
    PALPATE_SOFT_STRETCHES = 35,
    PALPATE_FIELD_COUNT = 36
};
enum { PALPATE_FLOAT64 = 0, PALPATE_INT32 = 1, PALPATE_UINT8 = 2 };

typedef struct PalpateView {
    int32_t size;
    int32_t type; /* of the numbers */
    int32_t rank; /* 1 or 2 */
    int32_t shape[2];
    int32_t reserved;
    int64_t generation; /* of the world, as the view was filled */
    const void* data;   /* read only; stays in its place as long as the world lives */
} PalpateView;
/* Shows a field of the finger, soft object or thimble with id `index`, or of the world (-1), without a copy. A field
   that has been asked for once is filled anew by every palpate_step, _restore and _set: keep the view, and its data are
   the newest.
 */
PALPATE_API int32_t palpate_view(PalpateWorld world, int32_t field, int32_t index, PalpateView* view);

typedef struct PalpateFingerState {
    int32_t size;
    int32_t touching;       /* samples */
    double time;            /* simulated, at the end of the step [s] */
    double tracked_pose[7]; /* the newest valid one */
    double bone_pose[7];
    double force[3];       /* on the skin, world [N] */
    double torque[3];      /* about the bone's origin [N m] */
    double centre[3];      /* of pressure [m]; NaN where nothing pushes */
    double normal_force;   /* sum of normal forces [N] */
    double contact_area;   /* [m^2] */
    double coupling_force; /* with which the tracked pose draws the bone [N] */
    double silent;         /* since its tracker saw it last, or since the start [s] */
    double residual;       /* force that the solve left out of balance [N] */
    int32_t converged;     /* 0: the solve of the last step did not reach its tolerance */
    int32_t iterations;
    int64_t resets; /* times that it diverged and was put back to rest */
} PalpateFingerState;
PALPATE_API int32_t palpate_get_finger(PalpateWorld world, int32_t finger, PalpateFingerState* state);

typedef struct PalpateObjectState {
    int32_t size;
    int32_t moves; /* 1: forces move it */
    double pose[7];
    double velocity[3]; /* of the centre of mass [m/s] */
    double spin[3];     /* angular velocity [rad/s] */
    /* Of all contacts in the last step, where forces move it or it is soft; else of fingers and soft objects [N]. */
    double force[3];
    /* Where forces move it about the centre of mass, where it is soft about its pose's origin; else 0 [N m]. */
    double torque[3];
    double contact_area; /* of a soft one [m^2] */
    int32_t soft;        /* 1: of tissue, which the PALPATE_SOFT_ fields show */
    int32_t touching;    /* samples of a soft one that are pushed */
} PalpateObjectState;
PALPATE_API int32_t palpate_get_object(PalpateWorld world, int32_t object, PalpateObjectState* state);

#define PALPATE_MOST_JOINTS 6
typedef struct PalpateThimbleState {
    int32_t size;
    int32_t finger; /* that wears it */
    int32_t configuration_count, joint_count;
    double configuration[PALPATE_MOST_JOINTS]; /* [rad or m] */
    double wanted[PALPATE_MOST_JOINTS];        /* joint angles [rad] */
    double sent[PALPATE_MOST_JOINTS];
    double reached[PALPATE_MOST_JOINTS]; /* of the simulated servos */
    double error;                        /* rms distance between platform and contact [m] */
    int32_t matches;                     /* 1: there is a contact, and it is rendered */
    int32_t at_limit;                    /* 1: a joint is */
} PalpateThimbleState;
PALPATE_API int32_t palpate_get_thimble(PalpateWorld world, int32_t thimble, PalpateThimbleState* state);

/* From now on (1) every palpate_step leaves a snapshot behind for other threads; 0: no longer. */
PALPATE_API int32_t palpate_keep_snapshots(PalpateWorld world, int32_t on);
/* A finger in the newest snapshot, whole: never parts of two steps. Never waits. `positions` and `forces` ([S][3]) may
   be NULL; `capacity` counts samples, `samples` (may be NULL) becomes S. */
PALPATE_API int32_t palpate_read_snapshot(PalpateWorld world, int32_t finger, PalpateFingerState* state,
                                          double* positions, double* forces, int32_t capacity, int32_t* samples);

/* So many frames per simulated second are kept from now on for PALPATE_TEXT_REPORT (30 show motion well; 0: none any
   longer). They take memory as the world goes on; a restore and what comes or goes begin them anew. */
PALPATE_API int32_t palpate_keep_frames(PalpateWorld world, double per_second);

/* ---- States and recordings ---- */

/* The whole state as bytes: put back, the world goes on with the same bits. `needed` becomes their number; with
   capacity 0 nothing else happens. */
PALPATE_API int32_t palpate_save(PalpateWorld world, void* buffer, int64_t capacity, int64_t* needed);
/* Into a world of the same scene with the same settings (dt_ms and solver, too), of the same version of palpate. Damage
   is found by a checksum; bytes that were forged are not looked for. */
PALPATE_API int32_t palpate_restore(PalpateWorld world, const void* bytes, int64_t size);

/* From now on every step is recorded into a file, which `palpate replay` and `palpate convert` read. A file that is no
   recording is not replaced, nor one that another world or program is recording into (PALPATE_ERROR_FILE). */
PALPATE_API int32_t palpate_record(PalpateWorld world, const char* file);
PALPATE_API int32_t palpate_end_recording(PalpateWorld world);
/* A world that goes through a recorded run (1, 2, ...) again, with what went in then. */
PALPATE_API int32_t palpate_load_replay(const char* file, int32_t run, const PalpateWorldDef* def, PalpateWorld* world);
typedef struct PalpateReplayState {
    int32_t size;
    int32_t same;      /* 1: so far all came out the same, bit for bit */
    int64_t steps;     /* recorded */
    int64_t done;      /* run again */
    int64_t different; /* first step that came out otherwise; 0: none */
} PalpateReplayState;
PALPATE_API int32_t palpate_get_replay(PalpateWorld world, PalpateReplayState* state);

#ifdef __cplusplus
}
#endif
#endif
