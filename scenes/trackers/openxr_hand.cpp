#include "scenes/trackers/openxr_hand.h"

#include "meshes/input_error.h"

#ifndef PALPATE_OPENXR

namespace palpate {

std::unique_ptr<HandSourceThread> receive_openxr_hands(HandMailbox&) {
    throw InputError(
        "tracker openxr: palpate was built without OpenXR: install libopenxr-dev, configure and build it again");
}

}  // namespace palpate

#else

#include <dlfcn.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <thread>

#define XR_NO_PROTOTYPES
#define XR_USE_TIMESPEC
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>
#include <openxr/openxr_reflection.h>

namespace palpate {

namespace {

std::string name_of(XrResult result) {
    switch (result) {
#define PALPATE_NAME(name, value) \
    case name:                    \
        return #name;
        XR_LIST_ENUM_XrResult(PALPATE_NAME)
#undef PALPATE_NAME
                default : return "result " +
                          std::to_string(int(result));
    }
}

[[noreturn]] void refuse(const std::string& what) { throw InputError("tracker openxr: " + what); }

/// The loader is opened, not linked: without it, and in programs that bring one of their own, palpate works as ever.
PFN_xrGetInstanceProcAddr loader() {
    static const PFN_xrGetInstanceProcAddr found = [] {
        setenv("XR_LOADER_DEBUG", "none", 0);  // what is wrong is said once, by us
        void* library = dlopen("libopenxr_loader.so.1", RTLD_NOW | RTLD_LOCAL);
        return library ? reinterpret_cast<PFN_xrGetInstanceProcAddr>(dlsym(library, "xrGetInstanceProcAddr")) : nullptr;
    }();
    return found;
}

template <class Function>
Function function(XrInstance instance, const char* name) {
    PFN_xrVoidFunction found = nullptr;
    if (const XrResult result = loader()(instance, name, &found); XR_FAILED(result) || !found)
        refuse(std::string(name) + " is not there (" + name_of(result) + ")");
    return reinterpret_cast<Function>(found);
}
#define PALPATE_XR(instance, name) function<PFN_##name>(instance, #name)

/// A struct of OpenXR says what it is.
template <class Struct>
Struct typed(XrStructureType type) {
    Struct s{};
    s.type = type;
    return s;
}

bool offers(const std::vector<XrExtensionProperties>& all, const char* name) {
    for (const auto& extension : all)
        if (std::strcmp(extension.extensionName, name) == 0) return true;
    return false;
}

constexpr const char* needed[] = {XR_EXT_HAND_TRACKING_EXTENSION_NAME, XR_MND_HEADLESS_EXTENSION_NAME,
                                  XR_KHR_CONVERT_TIMESPEC_TIME_EXTENSION_NAME};

XrInstance make_instance() {
    if (!loader()) refuse("libopenxr_loader.so.1 is not installed (Debian: apt install libopenxr-loader1)");
    const auto list = PALPATE_XR(XR_NULL_HANDLE, xrEnumerateInstanceExtensionProperties);
    std::uint32_t count = 0;
    XrResult result = list(nullptr, 0, &count, nullptr);
    std::vector<XrExtensionProperties> all(count, typed<XrExtensionProperties>(XR_TYPE_EXTENSION_PROPERTIES));
    if (XR_SUCCEEDED(result)) result = list(nullptr, count, &count, all.data());
    if (XR_FAILED(result))
        refuse("no OpenXR runtime answers (" + name_of(result) +
               "): start one, and make it the system's (/etc/xdg/openxr/1/active_runtime.json) or name its file in "
               "XR_RUNTIME_JSON");
    for (const char* extension : needed)
        if (!offers(all, extension))
            refuse(std::string("the OpenXR runtime has no ") + extension +
                   (extension == needed[0]   ? ": it tracks no hands"
                    : extension == needed[1] ? ": it gives hands only to programs that draw, which palpate does not; "
                                               "such a program can send them to udp:PORT"
                                             : ": it cannot be asked for hands without drawing"));
    auto info = typed<XrInstanceCreateInfo>(XR_TYPE_INSTANCE_CREATE_INFO);
    std::strcpy(info.applicationInfo.applicationName, "palpate");
    info.applicationInfo.apiVersion = XR_MAKE_VERSION(1, 0, 0);
    info.enabledExtensionCount = std::size(needed), info.enabledExtensionNames = needed;
    XrInstance instance = XR_NULL_HANDLE;
    result = PALPATE_XR(XR_NULL_HANDLE, xrCreateInstance)(&info, &instance);
    if (XR_FAILED(result)) refuse("the OpenXR runtime gives no instance (" + name_of(result) + "): is it running?");
    return instance;
}

/// An instance and a session with two hand trackers; ends with them.
class Runtime {
  public:
    Runtime() : instance_(make_instance()) {
        try {
            make_session();
        } catch (...) {
            destroy();
            throw;
        }
    }
    ~Runtime() { destroy(); }
    Runtime(const Runtime&) = delete;
    Runtime& operator=(const Runtime&) = delete;

    const std::string& name() const { return name_; }
    /// Empty while it is there, else why not.
    std::string look_at_events();
    /// Both hands as they are now. Empty, or what was wrong; `lost` where it will not come back.
    std::string read_hands(HandMailbox& mailbox, bool& lost);

  private:
    void make_session();
    void destroy() { PALPATE_XR(instance_, xrDestroyInstance)(instance_); }
    XrInstance instance_ = XR_NULL_HANDLE;
    XrSession session_ = XR_NULL_HANDLE;
    XrSpace space_ = XR_NULL_HANDLE;
    std::array<XrHandTrackerEXT, 2> trackers_{};
    PFN_xrPollEvent poll_event_ = nullptr;
    PFN_xrLocateHandJointsEXT locate_ = nullptr;
    PFN_xrConvertTimespecTimeToTimeKHR convert_time_ = nullptr;
    std::string name_;
    bool running_ = false;
};

void Runtime::make_session() {
    const auto need = [](XrResult result, const char* what) {
        if (XR_FAILED(result))
            refuse(std::string("the OpenXR runtime gives no ") + what + " (" + name_of(result) + ")");
    };
    auto about = typed<XrInstanceProperties>(XR_TYPE_INSTANCE_PROPERTIES);
    need(PALPATE_XR(instance_, xrGetInstanceProperties)(instance_, &about), "properties");
    name_ = about.runtimeName;
    auto wanted = typed<XrSystemGetInfo>(XR_TYPE_SYSTEM_GET_INFO);
    wanted.formFactor = XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY;
    XrSystemId system = XR_NULL_SYSTEM_ID;
    if (const XrResult result = PALPATE_XR(instance_, xrGetSystem)(instance_, &wanted, &system); XR_FAILED(result))
        refuse(name_ + " has no headset (" + name_of(result) + "): connect it, or start the service anew");
    auto hands = typed<XrSystemHandTrackingPropertiesEXT>(XR_TYPE_SYSTEM_HAND_TRACKING_PROPERTIES_EXT);
    auto properties = typed<XrSystemProperties>(XR_TYPE_SYSTEM_PROPERTIES);
    properties.next = &hands;
    need(PALPATE_XR(instance_, xrGetSystemProperties)(instance_, system, &properties), "system");
    if (!hands.supportsHandTracking)
        refuse(std::string("the headset \"") + properties.systemName + "\" tracks no hands, or they are switched off");
    auto session = typed<XrSessionCreateInfo>(XR_TYPE_SESSION_CREATE_INFO);
    session.systemId = system;
    need(PALPATE_XR(instance_, xrCreateSession)(instance_, &session, &session_), "session");
    auto space = typed<XrReferenceSpaceCreateInfo>(XR_TYPE_REFERENCE_SPACE_CREATE_INFO);
    space.referenceSpaceType = XR_REFERENCE_SPACE_TYPE_LOCAL;
    space.poseInReferenceSpace.orientation.w = 1;
    need(PALPATE_XR(instance_, xrCreateReferenceSpace)(session_, &space, &space_), "space");
    for (int hand : {0, 1}) {
        auto tracker = typed<XrHandTrackerCreateInfoEXT>(XR_TYPE_HAND_TRACKER_CREATE_INFO_EXT);
        tracker.hand = hand == 0 ? XR_HAND_LEFT_EXT : XR_HAND_RIGHT_EXT;
        tracker.handJointSet = XR_HAND_JOINT_SET_DEFAULT_EXT;
        need(PALPATE_XR(instance_, xrCreateHandTrackerEXT)(session_, &tracker, &trackers_[std::size_t(hand)]), "hand");
    }
    poll_event_ = PALPATE_XR(instance_, xrPollEvent);
    locate_ = PALPATE_XR(instance_, xrLocateHandJointsEXT);
    convert_time_ = PALPATE_XR(instance_, xrConvertTimespecTimeToTimeKHR);
}

std::string Runtime::look_at_events() {
    for (;;) {
        XrEventDataBuffer event{};
        event.type = XR_TYPE_EVENT_DATA_BUFFER;
        const XrResult result = poll_event_(instance_, &event);
        if (result == XR_EVENT_UNAVAILABLE) return "";
        if (XR_FAILED(result)) return name_of(result);
        if (event.type == XR_TYPE_EVENT_DATA_INSTANCE_LOSS_PENDING) return "it is about to end";
        if (event.type != XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED) continue;
        XrEventDataSessionStateChanged change;
        std::memcpy(&change, &event, sizeof change);
        auto begin = typed<XrSessionBeginInfo>(XR_TYPE_SESSION_BEGIN_INFO);
        begin.primaryViewConfigurationType = XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO;
        XrResult done = XR_SUCCESS;
        switch (change.state) {
            case XR_SESSION_STATE_READY:
                done = PALPATE_XR(instance_, xrBeginSession)(session_, &begin);
                running_ = XR_SUCCEEDED(done);
                break;
            case XR_SESSION_STATE_STOPPING:
                running_ = false;
                done = PALPATE_XR(instance_, xrEndSession)(session_);
                break;
            case XR_SESSION_STATE_EXITING:
                return "it ends the session";
            case XR_SESSION_STATE_LOSS_PENDING:
                return "the session is lost";
            default:
                break;
        }
        if (XR_FAILED(done)) return name_of(done);
    }
}

std::string Runtime::read_hands(HandMailbox& mailbox, bool& lost) {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    XrTime time = 0;
    XrResult result = running_ ? convert_time_(instance_, &now, &time) : XR_SUCCESS;
    for (int hand = 0; hand < 2 && XR_SUCCEEDED(result) && running_; ++hand) {
        std::array<XrHandJointLocationEXT, hand_joint_count> found{};
        auto locate = typed<XrHandJointsLocateInfoEXT>(XR_TYPE_HAND_JOINTS_LOCATE_INFO_EXT);
        locate.baseSpace = space_, locate.time = time;
        auto locations = typed<XrHandJointLocationsEXT>(XR_TYPE_HAND_JOINT_LOCATIONS_EXT);
        locations.jointCount = hand_joint_count, locations.jointLocations = found.data();
        result = locate_(trackers_[std::size_t(hand)], &locate, &locations);
        if (XR_FAILED(result)) break;
        std::array<HandJoint, hand_joint_count> joints;
        for (std::size_t k = 0; k < joints.size(); ++k) {
            constexpr auto both = XR_SPACE_LOCATION_POSITION_VALID_BIT | XR_SPACE_LOCATION_ORIENTATION_VALID_BIT;
            if ((found[k].locationFlags & both) != both) continue;  // its rotation stays zero: not known
            const auto& p = found[k].pose.position;
            const auto& q = found[k].pose.orientation;
            joints[k] = {{p.x, p.y, p.z}, {q.x, q.y, q.z, q.w}};
        }
        HandFrame frame;
        frame.valid = locations.isActive;
        set_fingers(frame, joints, {});
        mailbox.take(hand, frame, 1e-9 * double(time));
    }
    lost = result == XR_ERROR_INSTANCE_LOST || result == XR_ERROR_SESSION_LOST || result == XR_ERROR_RUNTIME_FAILURE;
    return XR_FAILED(result) ? "OpenXR gives no hands: " + name_of(result) : "";
}

class OpenXrHands : public HandSourceThread {
  public:
    explicit OpenXrHands(HandMailbox& mailbox) : mailbox_(mailbox), runtime_(std::make_unique<Runtime>()) {
        about_ = "the OpenXR runtime " + runtime_->name();
        mailbox_.count_connection();
        reader_ = std::thread([this] { read(); });
    }
    ~OpenXrHands() override {
        ending_ = true;
        reader_.join();
    }
    std::string about() const override { return about_; }

  private:
    static constexpr auto period = std::chrono::milliseconds(4), pause = std::chrono::milliseconds(1000);
    void read() {
        auto next = std::chrono::steady_clock::now();
        while (!ending_) {
            std::this_thread::sleep_until(next);
            const auto now = std::chrono::steady_clock::now();
            next = std::max(next + period, now);
            if (!runtime_ && now >= try_again_) find_again();
            if (!runtime_) continue;
            bool lost = false;
            std::string wrong = runtime_->look_at_events();
            if (!wrong.empty())
                lost = true, wrong = "the OpenXR runtime is gone: " + wrong;
            else
                wrong = runtime_->read_hands(mailbox_, lost);
            if (!wrong.empty()) mailbox_.count_malformed(std::move(wrong));
            if (lost) runtime_.reset(), try_again_ = now + pause;
        }
    }
    void find_again() {
        try_again_ = std::chrono::steady_clock::now() + pause;
        try {
            runtime_ = std::make_unique<Runtime>();
            mailbox_.count_connection();
        } catch (const InputError&) {}  // not there yet
    }
    HandMailbox& mailbox_;
    std::unique_ptr<Runtime> runtime_;  ///< null while it is gone
    std::chrono::steady_clock::time_point try_again_{};
    std::string about_;
    std::atomic<bool> ending_{false};
    std::thread reader_;
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_openxr_hands(HandMailbox& mailbox) {
    return std::make_unique<OpenXrHands>(mailbox);
}

}  // namespace palpate

#endif
