#include "scenes/viewer/rendered_pads.h"

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

RenderedPads::RenderedPads(const Simulation& s) {
    for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
        const Matching& m = s.world.matchings[t];
        const auto finger = std::size_t(s.scene.spec.thimbles[t].finger);
        models_.push_back(m.model);
        pads_.push_back(make_pad_on_platform(s.scene.spec.fingers[finger], m.model));
        RenderedPad pad;
        pad.position = s.scene.spec.fingers[finger].mesh.nodes;
        const std::size_t samples = s.scene.spec.fingers[finger].mesh.pad_nodes.size();
        pad.force.assign(samples, {0, 0, 0});
        pad.touches.assign(samples, 0);
        rendered_pads_.push_back(std::move(pad));
    }
}

const std::vector<RenderedPad>& RenderedPads::solve(const Simulation& s) {
    std::vector<Coordinates> w;
    std::vector<char> rendered;
    read_wanted(s, w, rendered);
    return solve(w, rendered);
}

const std::vector<RenderedPad>& RenderedPads::solve(const std::vector<Coordinates>& w,
                                                    const std::vector<char>& rendered) {
    for (std::size_t t = 0; t < rendered_pads_.size(); ++t) {
        RenderedPad& out = rendered_pads_[t];
        PadOnPlatform& pad = pads_[t];
        out.rendered = rendered[t];
        resimulate(pad, models_[t], w[t], threads_);
        const ContactSurface& contact = pad.world.contact_surfaces[0];
        const Mat3<double> R = rotation_matrix(contact.bone.rotation);
        for (std::size_t s = 0; s < out.force.size(); ++s)
            out.force[s] = transposed_times(R, contact.force[s]), out.touches[s] = contact.touches[s];
        out.normal_force = contact.normal_force;
        const Pose<double> bone = bone_pose(pad.world, pad.finger);
        const std::vector<Point> now = finger_positions(pad.world, pad.finger);
        for (std::size_t i = 0; i < now.size(); ++i) {
            const Vec3<double> x = inverse_transform(bone, Vec3<double>{now[i][0], now[i][1], now[i][2]});
            out.position[i] = {x.x, x.y, x.z};
        }
    }
    return rendered_pads_;
}

RenderedPadsThread::RenderedPadsThread(const Simulation& s) : pads_(s) {
    newest_ = pads_.solve(s);
    thread_ = std::thread([this] { serve(); });
}

RenderedPadsThread::~RenderedPadsThread() {
    {
        const std::lock_guard lock(mutex_);
        ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

const std::vector<RenderedPad>& RenderedPadsThread::ask(const Simulation& s) {
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

void RenderedPadsThread::serve() {
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
        const std::vector<RenderedPad>& rendered_pads = pads_.solve(w, rendered);
        const std::lock_guard lock(mutex_);
        ready_ = rendered_pads;
        fresh_ = true;
    }
}

}  // namespace palpate
