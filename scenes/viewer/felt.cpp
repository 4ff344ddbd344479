#include "scenes/viewer/felt.h"

#include <sys/resource.h>
#include <unistd.h>

namespace palpate {

namespace {

void read_wanted(const Simulation& s, std::vector<Coordinates>& w, std::vector<char>& rendered) {
    w.clear(), rendered.clear();
    for (const Matching& m : s.world.matchings) {
        w.push_back(m.result.w);
        rendered.push_back(m.result.status != MatchingStatus::no_contact);
    }
}

}  // namespace

FeltPads::FeltPads(const Simulation& s) {
    for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
        const Matching& m = s.world.matchings[t];
        const auto finger = std::size_t(s.scene.spec.thimbles[t].finger);
        models_.push_back(m.model);
        pads_.push_back(make_pad_on_platform(s.scene.spec.fingers[finger], m.model));
        FeltPad felt;
        felt.position = s.scene.spec.fingers[finger].mesh.nodes;
        const std::size_t samples = s.scene.spec.fingers[finger].mesh.pad_nodes.size();
        felt.force.assign(samples, {0, 0, 0});
        felt.touches.assign(samples, 0);
        felt_.push_back(std::move(felt));
    }
}

const std::vector<FeltPad>& FeltPads::solve(const Simulation& s) {
    std::vector<Coordinates> w;
    std::vector<char> rendered;
    read_wanted(s, w, rendered);
    return solve(w, rendered);
}

const std::vector<FeltPad>& FeltPads::solve(const std::vector<Coordinates>& w, const std::vector<char>& rendered) {
    for (std::size_t t = 0; t < felt_.size(); ++t) {
        FeltPad& felt = felt_[t];
        PadOnPlatform& pad = pads_[t];
        felt.rendered = rendered[t];
        resimulate(pad, models_[t], w[t], threads_);
        const ContactSurface& contact = pad.world.contact_surfaces[0];
        const Mat3<double> R = rotation_matrix(contact.bone.rotation);
        for (std::size_t s = 0; s < felt.force.size(); ++s)
            felt.force[s] = transposed_times(R, contact.force[s]), felt.touches[s] = contact.touches[s];
        felt.normal_force = contact.normal_force;
        const Pose<double> bone = bone_pose(pad.world, pad.finger);
        const std::vector<Point> now = finger_positions(pad.world, pad.finger);
        for (std::size_t i = 0; i < now.size(); ++i) {
            const Vec3<double> x = inverse_transform(bone, Vec3<double>{now[i][0], now[i][1], now[i][2]});
            felt.position[i] = {x.x, x.y, x.z};
        }
    }
    return felt_;
}

FeltThread::FeltThread(const Simulation& s) : pads_(s) {
    newest_ = pads_.solve(s);
    thread_ = std::thread([this] { serve(); });
}

FeltThread::~FeltThread() {
    {
        const std::lock_guard lock(mutex_);
        ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

const std::vector<FeltPad>& FeltThread::ask(const Simulation& s) {
    {
        const std::lock_guard lock(mutex_);
        if (fresh_) std::swap(newest_, ready_);
        fresh_ = false;
        read_wanted(s, wanted_, rendered_);
        asked_ = true;
    }
    changed_.notify_all();
    return newest_;
}

void FeltThread::serve() {
    setpriority(PRIO_PROCESS, id_t(gettid()), 10);  // of this thread: pictures wait for the run, not the other way
    std::vector<Coordinates> w;
    std::vector<char> rendered;
    while (true) {
        {
            std::unique_lock lock(mutex_);
            changed_.wait(lock, [&] { return asked_ || ending_; });
            if (ending_) return;
            w = wanted_, rendered = rendered_;
            asked_ = false;
        }
        const std::vector<FeltPad>& felt = pads_.solve(w, rendered);
        const std::lock_guard lock(mutex_);
        ready_ = felt;
        fresh_ = true;
    }
}

}  // namespace palpate
