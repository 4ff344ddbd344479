// Soft fingers against each other: action and reaction, friction, what a rigid plane would give, the same bits whoever
// is near, and nothing where nobody is.

#include <cstring>

#include "meshes/finger_regions.h"
#include "meshes/finger_shape.h"
#include "meshes/tetrahedralise.h"
#include "scenes/run/simulation.h"
#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

constexpr double pi = 3.14159265358979323846;
const Quaternion<double> as_it_is = Quaternion<double>::identity(), upside_down = about_x(pi);

/// Two fingers pad to pad, a above and b below z = 0, so far apart.
SceneSpec facing(const TetMesh& mesh, double half_thickness, double gap, bool limits = true) {
    SceneSpec spec;
    spec.fingers_touch = true;
    for (int i = 0; i < 2; ++i) {
        FingerSpec f;
        f.name = i == 0 ? "a" : "b";
        f.mesh = mesh;
        f.has_limits = limits;
        f.start = {{0, 0, (i == 0 ? 1 : -1) * (half_thickness + gap / 2)}, i == 0 ? as_it_is : upside_down};
        spec.fingers.push_back(std::move(f));
    }
    return spec;
}
SceneSpec blocks(double gap = 1e-4) { return facing(block_mesh(3, 2, 2, 0.004), 0.004, gap); }

const TetMesh& index_mesh() {
    static const TetMesh mesh = [] {
        TetMesh m = tetrahedralise(finger_surface(finger_shape("index")), {.elements = 347});
        mark_regions(m, {});
        return m;
    }();
    return mesh;
}
double pad_height(const TetMesh& mesh) {
    double low = 0;
    for (int node : mesh.pad_nodes) low = std::min(low, mesh.nodes[std::size_t(node)][2]);
    return -low;
}
SceneSpec indexes(double gap = 1e-4) { return facing(index_mesh(), pad_height(index_mesh()), gap); }

struct Wrench {
    Vec3<double> force{0, 0, 0}, torque{0, 0, 0};  ///< about the world's origin
    double size = 0;                               ///< sum of the forces of all samples
};
Wrench wrench_on(const World& w, std::size_t finger) {
    const ContactSurface& c = w.contact_surfaces[finger];
    Wrench sum;
    for (std::size_t s = 0; s < c.force.size(); ++s) {
        sum.force += c.force[s];
        sum.torque += cross(transform(c.bone, c.position[s]), c.force[s]);
        sum.size += norm(c.force[s]);
    }
    return sum;
}

/// Presses the two together by `depth`, then shears them by `shear`, and turns one.
void press(double t, World& w, double depth, double shear, double turn) {
    const double pressed = std::min(1.0, t / 0.05), sheared = std::clamp((t - 0.05) / 0.1, 0.0, 1.0);
    for (std::size_t i = 0; i < 2; ++i) {
        const double sign = i == 0 ? 1 : -1;
        TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[i].tracker)->incoming;
        s.pose = w.skins[i].start;
        s.pose.position += Vec3<double>{sign * sheared * shear / 2, 0, -sign * pressed * depth / 2};
        s.pose.rotation = normalised(about_x(i == 0 ? turn * sheared : 0) * s.pose.rotation);
    }
}

TEST(FingerPairs, ActionIsReactionInEveryStepWhetherItHasConvergedOrNot) {
    for (const bool single : {false, true})
        for (const int iterations : {1, 2, 200})
            for (const double dt : {0.001, 0.005, 0.02}) {
                SceneSpec spec = blocks();
                spec.solver.dt = dt;
                spec.solver.newton_iterations = iterations;
                spec.fingers[1].mesh = block_mesh(4, 3, 2, 0.003);  // not alike
                spec.fingers[1].young_modulus = 60e3;
                spec.fingers[1].single_precision = spec.fingers[0].single_precision = single;
                spec.fingers[1].mesh.curved_skin = true;
                Lab lab(spec);
                double force = 0, torque = 0, most = 0;
                int converged = 0, steps = 0;
                lab.run(0.2, [&](double t, World& w) {
                    press(t, w, 0.004, 0.004, 0.2);
                    const Wrench a = wrench_on(w, 0), b = wrench_on(w, 1);
                    most = std::max(most, a.force.z);
                    force = std::max(force, norm(a.force + b.force) / std::max(a.size, 1e-3));
                    torque = std::max(torque, norm(a.torque + b.torque) / std::max(a.size * 0.005, 1e-5));
                    ++steps, converged += w.step == 0 || skin_status(w, w.skins.owner(0)).converged;
                });
                const auto what = ::testing::Message() << (single ? "float " : "double ") << iterations << " " << dt;
                EXPECT_GT(most, 0.1) << what;
                EXPECT_LT(force, 1e-6) << what;
                EXPECT_LT(torque, 1e-6) << what;
                if (iterations == 200) { EXPECT_GT(converged, 0.97 * steps) << what; }
                const ContactSurface& c = lab.world.contact_surfaces[0];
                ASSERT_EQ(c.objects.size(), 1u);
                EXPECT_EQ(c.objects[0].finger, 1);
                EXPECT_EQ(c.objects[0].object, -1);
            }
}

/// Left for right.
TetMesh mirrored(TetMesh mesh) {
    for (Point& p : mesh.nodes) p[1] = -p[1];
    for (auto& tet : mesh.tets) std::swap(tet[0], tet[1]);
    for (auto& face : mesh.surface) std::swap(face[0], face[1]);
    return mesh;
}

TEST(FingerPairs, TwoEqualFingersFeelWhatOneFeelsOnARigidPlane) {
    for (const bool real : {false, true}) {
        SceneSpec spec = real ? indexes() : blocks();
        spec.skin_friction = 0;
        spec.fingers[1].mesh = mirrored(spec.fingers[1].mesh);
        Lab two(spec);
        two.run(0.4, [](double t, World& w) { press(t, w, 0.004, 0, 0); });
        SceneSpec alone = spec;
        alone.fingers.pop_back();
        alone.objects.push_back({"plane", {}, Pose<double>::identity(), 0});
        Lab one(alone);
        one.run(0.4, [](double t, World& w) {
            TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[0].tracker)->incoming;
            s.pose = w.skins[0].start;
            s.pose.position.z -= 0.002 * std::min(1.0, t / 0.05);
        });
        const Wrench a = wrench_on(two.world, 0), b = wrench_on(two.world, 1), reference = wrench_on(one.world, 0);
        EXPECT_GT(reference.force.z, 0.1) << real;
        EXPECT_NEAR(a.force.z, reference.force.z, 1e-3 * reference.force.z) << real;
        EXPECT_NEAR(b.force.z, -reference.force.z, 1e-3 * reference.force.z) << real;
        EXPECT_TRUE(skin_status(two.world, two.world.skins.owner(0)).converged) << real;
    }
}

TEST(FingerPairs, MirroredFingersFeelMirroredForces) {
    // About the plane between them the scene is its own mirror image, and so is its other order.
    SceneSpec spec = indexes();
    Lab lab(spec);
    std::swap(spec.fingers[0], spec.fingers[1]);
    Lab other(spec);
    lab.run(0.2, [](double t, World& w) { press(t, w, 0.003, 0, 0); });
    other.run(0.2, [](double t, World& w) {
        const double pressed = std::min(1.0, t / 0.05);
        for (std::size_t i = 0; i < 2; ++i) {
            TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[i].tracker)->incoming;
            s.pose = w.skins[i].start;
            s.pose.position.z += (i == 0 ? 1 : -1) * pressed * 0.0015;
        }
    });
    const ContactSurface &a = lab.world.contact_surfaces[0], &b = lab.world.contact_surfaces[1];
    const Mat3<double> Ra = rotation_matrix(a.bone.rotation), Rb = rotation_matrix(b.bone.rotation);
    for (std::size_t s = 0; s < a.force.size(); ++s) {
        const Vec3<double> of_a = transposed_times(Ra, a.force[s]), of_b = transposed_times(Rb, b.force[s]);
        EXPECT_NEAR(of_a.z, of_b.z, 2e-4 * a.normal_force) << s;
        EXPECT_NEAR(a.force[s].z, other.world.contact_surfaces[1].force[s].z, 1e-4 * a.normal_force) << s;
    }
}

TEST(FingerPairs, TheySlideAtCoulombsLimit) {
    for (const double friction : {0.0, 0.1, 0.25}) {
        SceneSpec spec = blocks();
        spec.skin_friction = friction;
        Lab lab(spec);
        double worst = 0;
        lab.run(0.3, [&](double t, World& w) {
            // Slowly, and farther than the skin can follow.
            const double pressed = std::min(1.0, t / 0.05), sheared = std::max(0.0, t - 0.05) * 0.02;
            for (std::size_t i = 0; i < 2; ++i) {
                const double sign = i == 0 ? 1 : -1;
                TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[i].tracker)->incoming;
                s.pose = w.skins[i].start;
                s.pose.position += Vec3<double>{sign * sheared / 2, 0, -sign * pressed * 0.0015};
            }
            for (const ContactSurface& c : w.contact_surfaces)
                for (const ObjectContact& o : c.objects)
                    worst = std::max(worst, o.friction_force - 1.02 * friction * o.normal_force - 1e-4);
        });
        const ContactSurface& a = lab.world.contact_surfaces[0];
        const Vec3<double> n = rotation_matrix(lab.world.finger_pairs.near[0].pose.rotation).column(2);
        const double sideways = norm(a.total - dot(a.total, n) * n);
        EXPECT_LE(worst, 0) << friction;
        EXPECT_NEAR(sideways, friction * a.objects[0].normal_force, 0.02 * a.objects[0].normal_force) << friction;
        EXPECT_GT(a.objects[0].slip, 0) << friction;
    }
}

TEST(FingerPairs, BareFingersThatAreHeldTogetherStick) {
    SceneSpec spec = indexes();
    Lab lab(spec);
    lab.run(0.5, [](double t, World& w) { press(t, w, 0.003, 0.001, 0); });
    const ContactSurface& a = lab.world.contact_surfaces[0];
    ASSERT_EQ(a.objects.size(), 1u);
    EXPECT_GT(std::hypot(a.total.x, a.total.y), 0.02);
    EXPECT_LT(a.objects[0].slip, 1e-8);
    EXPECT_TRUE(skin_status(lab.world, lab.world.skins.owner(0)).converged);
}

bool same_bits(const ContactSurface& a, const ContactSurface& b) {
    auto same = [](const auto& x, const auto& y) {
        return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof x[0]) == 0;
    };
    return same(a.position, b.position) && same(a.force, b.force);
}

TEST(FingerPairs, WhereNobodyIsNearNothingChanges) {
    SceneSpec spec = blocks(0.1);
    for (int side : {-1, 1})
        spec.objects.push_back({"box", {ShapeKind::box, {0.02, 0.02, 0.01}}, {{0, 0, side * 0.0395}, as_it_is}, 0.5});
    Lab with(spec);
    spec.fingers_touch = false;
    Lab without(spec);
    auto move = [](double t, World& w) { press(t, w, 0.008, 0.002, 0.1); };
    with.run(0.1, move), without.run(0.1, move);
    EXPECT_EQ(skin_memory_bytes(with.world), skin_memory_bytes(without.world));
    EXPECT_TRUE(with.world.finger_pairs.near.empty());
    EXPECT_GT(with.world.contact_surfaces[0].normal_force, 0);
    for (std::size_t i = 0; i < 2; ++i)
        EXPECT_TRUE(same_bits(with.world.contact_surfaces[i], without.world.contact_surfaces[i]));
}

/// A few fingers have the memory for touching each other from the start: the step in which they meet makes none.
TEST(FingerPairs, FindTheirMemoryWhereTheyMeet) {
    Lab lab(blocks());
    EXPECT_EQ(lab.world.contact_growths, 0);
    lab.run(0.1, [](double t, World& w) { press(t, w, 0.008, 0.002, 0.1); });
    EXPECT_FALSE(lab.world.finger_pairs.near.empty());
    EXPECT_GT(lab.world.contact_surfaces[0].normal_force, 0);
    EXPECT_EQ(lab.world.contact_growths, 0);
}

/// Pairs of fingers in a row, far from each other pair.
SceneSpec pairs_in_a_row(int pairs, bool single) {
    SceneSpec spec;
    spec.fingers_touch = true;
    for (int k = 0; k < pairs; ++k)
        for (FingerSpec f : blocks().fingers) {
            f.name += std::to_string(k);
            f.single_precision = single;
            f.start.position.y += 0.1 * k;
            spec.fingers.push_back(f);
        }
    return spec;
}
void press_all(double t, World& w) {
    for (std::size_t i = 0; i < w.skins.size(); ++i) {
        TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[i].tracker)->incoming;
        const double sign = i % 2 == 0 ? 1 : -1;
        s.pose = w.skins[i].start;
        s.pose.position += Vec3<double>{sign * 0.02 * std::max(0.0, t - 0.05), 0, -sign * 0.04 * std::min(t, 0.05)};
    }
}

TEST(FingerPairs, TheSameBitsAloneAndBesideOthersAndForAnyNumberOfThreads) {
    for (const bool single : {false, true}) {
        Lab alone(pairs_in_a_row(1, single));
        alone.run(0.1, press_all);
        EXPECT_GT(alone.world.contact_surfaces[0].normal_force, 0.05);
        for (const int pairs : {2, 4, 8}) {
            Lab many(pairs_in_a_row(pairs, single));
            many.run(0.1, press_all);
            for (std::size_t i = 0; i < 2; ++i)
                EXPECT_TRUE(same_bits(alone.world.contact_surfaces[i], many.world.contact_surfaces[i]))
                    << single << " " << pairs << " " << i;
        }
        for (const int count : {1, 4}) {
            World w = build_world(pairs_in_a_row(8, single));
            Threads threads(count);
            while (w.time < 0.1 - 1e-9) {
                for (std::size_t i = 0; i < w.skins.size(); ++i)
                    w.tracker_poses.find(w.couplings[i].tracker)->incoming = {w.skins[i].start, w.time, true};
                press_all(w.time, w);
                step(w, threads);
            }
            for (std::size_t i = 0; i < 2; ++i)
                EXPECT_TRUE(same_bits(alone.world.contact_surfaces[i], w.contact_surfaces[i])) << single << count;
        }
    }
}

/// A finger far from a pair that touches, or from one that presses a body, slides on a plate by itself: in whatever
/// chunk it begins, with matrices that are kept, too.
TEST(FingerPairs, OneFarFromThemIsTheSameBitsAsAlone) {
    for (const bool single : {false, true})
        for (const bool with_body : {false, true}) {
            SceneSpec spec = pairs_in_a_row(1, single);
            FingerSpec third = spec.fingers[0];
            third.name = "far";
            third.start.position.y = 0.2;
            spec.fingers.push_back(third);
            spec.objects.push_back({"plate",
                                    {ShapeKind::box, {0.02, 0.02, 0.005}},
                                    {{0, 0.2, third.start.position.z - 0.0092}, as_it_is},
                                    0.5});
            if (with_body) {
                spec.fingers_touch = false;
                spec.gravity = {0, 0, 0};
                ObjectSpec body{"body", {ShapeKind::box, {0.02, 0.02, 0.005}}, {{0, 0, -0.0052}, as_it_is}, 0.5};
                body.body = solid_body(body.shape, 0.02);
                spec.objects.push_back(body);
            }
            spec.solver.newton_iterations = 2, spec.solver.stiffness_steps = 16;
            spec.solver.tolerance = 1e-4, spec.solver.multiplier_tolerance = 1e-3;
            SceneSpec by_itself = spec;
            by_itself.fingers = {third};
            by_itself.objects.resize(1);
            Lab beside(spec), alone(by_itself);
            auto slide = [](double t, World& w, std::size_t finger) {
                TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[finger].tracker)->incoming;
                s.pose = w.skins[finger].start;
                s.pose.position += Vec3<double>{0.02 * std::max(0.0, t - 0.05), 0, -0.04 * std::min(t, 0.05)};
            };
            int coupled = 0;
            for (int k = 0; k < 20; ++k) {
                beside.run(0.005, [&](double t, World& w) { press_all(t, w), slide(t, w, 2); });
                alone.run(0.005, [&](double t, World& w) { slide(t, w, 0); });
                coupled += beside.world.contact_surfaces[0].normal_force > 0;
                ASSERT_TRUE(same_bits(beside.world.contact_surfaces[2], alone.world.contact_surfaces[0]))
                    << single << with_body << ", step " << k;
            }
            EXPECT_GT(alone.world.contact_surfaces[0].normal_force, 0.05);
            EXPECT_GT(coupled, 3);
        }
}

/// Gives a finger a velocity.
void throw_finger(World& w, std::size_t finger, const Vec3<double>& velocity) {
    const Skin& skin = w.skins[finger];
    w.chunks.with(skin.single_precision, skin.chunk, [&](auto& c) {
        auto set = [&](auto& a, std::size_t count) {
            for (std::size_t i = 0; i < count; ++i)
                for (std::size_t d = 0; d < 3; ++d)
                    a[(3 * i + d) * std::size_t(c.width) + std::size_t(skin.lane)] = velocity[int(d)];
        };
        set(c.state.velocity, std::size_t(c.topology->node_count));
        set(c.state.bone_velocity, 1);
    });
}

TEST(FingerPairs, AClapGivesBackNoMoreThanItBrought) {
    struct Clap {
        bool real;
        int iterations;
        double dt;  ///< [s]
    };
    for (const Clap& clap : {Clap{false, 200, 2e-4}, Clap{false, 2, 1e-3}, Clap{false, 1, 5e-3}, Clap{true, 200, 1e-3},
                             Clap{true, 2, 1e-3}, Clap{true, 1, 5e-3}})
        for (const double speed : {0.1, 0.5}) {
            const double dt = clap.dt;
            SceneSpec spec = clap.real ? indexes(1e-3) : blocks(1e-3);
            spec.solver.dt = dt;
            spec.solver.newton_iterations = clap.iterations;
            for (FingerSpec& f : spec.fingers) f.coupling.stiffness = 1, f.coupling.damping = 0;
            Lab lab(spec);
            throw_finger(lab.world, 0, {0, 0, -speed});
            throw_finger(lab.world, 1, {0, 0, speed});
            double back = 0, most = 0;
            lab.run(0.05, [&](double, World& w) {
                const auto& c = w.chunks.doubles[0];
                back = std::max(back, c.state.bone_velocity[2 * std::size_t(c.width)]);
                most = std::max(most, w.contact_surfaces[0].normal_force);
            });
            EXPECT_GT(most, 0) << dt;
            EXPECT_GT(back, 0) << dt;
            EXPECT_LT(back, speed) << dt;
        }
}

TEST(FingerPairs, NoSpeedTakesOneThroughTheOther) {
    int number = 0;
    for (const double dt : {0.001, 0.005, 0.02})
        for (const double speed : {0.1, 1.0, 5.0}) {
            if (!testing::is_tried(++number, 2)) continue;  // not the longest
            SceneSpec spec = indexes(0.03);
            spec.solver.dt = dt;
            Lab lab(spec);
            lab.run(0.3 + 0.03 / speed, [&](double t, World& w) { press(0.05 * speed * t / 0.034, w, 0.034, 0, 0); });
            const Wrench a = wrench_on(lab.world, 0), b = wrench_on(lab.world, 1);
            EXPECT_GT(a.force.z, 0.3) << dt << " " << speed;
            EXPECT_LT(b.force.z, -0.3) << dt << " " << speed;
        }
}

TEST(FingerPairs, FingersThatBeginInEachOtherPartSlowly) {
    SceneSpec spec = blocks(-0.004);
    spec.solver.dt = 0.001;
    Lab lab(spec);
    double speed = 0;
    lab.run(0.2, [&](double, World& w) {
        for (const double v : w.chunks.doubles[0].state.velocity) speed = std::max(speed, std::abs(v));
    });
    EXPECT_LT(speed, 0.3);
    const Wrench a = wrench_on(lab.world, 0);
    EXPECT_GT(a.force.z, 0.1);
}

/// Contacts that have changed by little stay as they are in matrices that are kept, and so in what couples the fingers:
/// that costs no force, and hardly an iteration.
TEST(FingerPairs, KeptMatricesLeadToTheSameForces) {
    struct Pressed {
        std::vector<Vec3<double>> force;
        double iterations = 0, unconverged = 0;
    };
    auto pressed = [](int stiffness_steps, bool single) {
        SceneSpec spec = indexes();
        spec.solver.dt = 1e-3;
        spec.solver.tolerance = 1e-5, spec.solver.multiplier_tolerance = 1e-4;
        spec.solver.stiffness_steps = stiffness_steps;
        for (FingerSpec& f : spec.fingers) f.single_precision = single;
        Lab lab(spec);
        Pressed out;
        lab.run(0.25, [&](double t, World& w) {
            press(t, w, 0.003, 0.003, 0.2);
            if (w.step == 0) return;
            out.force.push_back(w.contact_surfaces[0].total);
            const SkinStatus s = skin_status(w, w.skins.owner(0));
            out.iterations += s.newton_iterations, out.unconverged += !s.converged;
        });
        return out;
    };
    for (const bool single : {false, true}) {
        const Pressed own = pressed(1, single), kept = pressed(16, single);
        double largest = 0, off = 0;
        for (std::size_t k = 0; k < own.force.size(); ++k) {
            largest = std::max(largest, norm(own.force[k]));
            off = std::max(off, norm(kept.force[k] - own.force[k]));
        }
        const auto what = ::testing::Message() << (single ? "float" : "double");
        EXPECT_GT(largest, 0.5) << what;
        EXPECT_LT(off, 1e-3 * largest) << what;
        EXPECT_LE(kept.unconverged, own.unconverged + 1) << what;
        EXPECT_LT(kept.iterations, 1.5 * own.iterations) << what;
    }
}

TEST(FingerPairs, ThreeFingersInABundle) {
    SceneSpec spec = blocks();
    FingerSpec f = spec.fingers[0];
    f.name = "c";
    f.start.position = {0.0141, 0, 0};
    f.start.rotation = {std::sqrt(0.5), 0, std::sqrt(0.5), 0};  // its pad looks along -x
    spec.fingers.push_back(f);
    spec.fingers[0].start.position.x = spec.fingers[1].start.position.x = 0;
    Lab lab(spec);
    lab.run(0.2, [](double t, World& w) {
        press(t, w, 0.003, 0, 0);
        TrackerPose::Sample& s = w.tracker_poses.find(w.couplings[2].tracker)->incoming;
        s.pose = w.skins[2].start;
        s.pose.position.x -= 0.006 * std::min(1.0, t / 0.1);
    });
    Wrench sum;
    double size = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const Wrench of = wrench_on(lab.world, i);
        sum.force += of.force, sum.torque += of.torque, size += of.size;
        EXPECT_TRUE(std::isfinite(of.size));
    }
    EXPECT_GT(size, 0.2);
    EXPECT_LT(norm(sum.force), 1e-6 * size);
    EXPECT_LT(norm(sum.torque), 1e-6 * size * 0.01);
}

TEST(FingerPairs, ThimblesOfABarePinchMatchWhatEachFingerFeelsOfTheOther) {
    Simulation s = make_simulation(load_scene(testing::source_dir() + "/scenes/bare_pinch.toml"), 1);
    std::size_t converged = 0, steps = 0;
    for (; s.world.time < s.scene.duration - 1e-9; ++steps) {
        advance(s);
        const Wrench a = wrench_on(s.world, 0), b = wrench_on(s.world, 1);
        EXPECT_LT(norm(a.force + b.force), 1e-6 * std::max(a.size, 1e-3));
        converged += skin_status(s.world, s.fingers[0]).converged;
    }
    EXPECT_EQ(converged, steps);
    ASSERT_EQ(s.world.matchings.size(), 2u);
    for (const Matching& m : s.world.matchings) {
        EXPECT_GT(m.contact_solves, 10);
        EXPECT_LT(m.result.rms_m, 1e-4);
    }
    const ContactSurface& thumb = s.world.contact_surfaces[0];
    EXPECT_GT(thumb.normal_force, 0.5);
    EXPECT_GT(std::abs(thumb.total.z), 0.05);  // sheared
}

}  // namespace
}  // namespace palpate
