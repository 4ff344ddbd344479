// A fake OpenXR runtime, as little of one as a program needs that asks for hands without a picture. The real loader
// opens it (XR_RUNTIME_JSON); FAKE_OPENXR names what it lacks: "hands", "headless", "headset", "tracking".

#include "tests/scenes/openxr_runtime.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <string>

#define XR_NO_PROTOTYPES
#define XR_USE_TIMESPEC
#include <time.h>

#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

using palpate::testing::OpenXrControl;

namespace {

OpenXrControl* control() {
    static OpenXrControl one;
    return &one;
}
bool lacks(const char* what) {
    const char* said = std::getenv("FAKE_OPENXR");
    return said && std::string(said) == what;
}

XrSessionState told = XR_SESSION_STATE_UNKNOWN;
bool running = false;
template <class Handle>
Handle handle(std::size_t number) {
    static char places[8];
    return reinterpret_cast<Handle>(&places[number]);
}

XrResult XRAPI_CALL list_extensions(const char*, std::uint32_t capacity, std::uint32_t* count,
                                    XrExtensionProperties* all) {
    const char* names[] = {XR_EXT_HAND_TRACKING_EXTENSION_NAME, XR_MND_HEADLESS_EXTENSION_NAME,
                           XR_KHR_CONVERT_TIMESPEC_TIME_EXTENSION_NAME};
    *count = 0;
    for (const char* name : names) {
        if ((lacks("hands") && name == names[0]) || (lacks("headless") && name == names[1])) continue;
        if (*count < capacity) std::strcpy(all[*count].extensionName, name), all[*count].extensionVersion = 1;
        ++*count;
    }
    return XR_SUCCESS;
}
XrResult XRAPI_CALL create_instance(const XrInstanceCreateInfo* info, XrInstance* instance) {
    if (control()->absent) return XR_ERROR_RUNTIME_UNAVAILABLE;
    if (info->enabledExtensionCount != 3) control()->misused = true;
    ++control()->instances, ++control()->made;
    control()->lost = false;
    told = XR_SESSION_STATE_UNKNOWN, running = false;
    *instance = handle<XrInstance>(1);
    return XR_SUCCESS;
}
XrResult XRAPI_CALL destroy_instance(XrInstance) {
    --control()->instances;
    return XR_SUCCESS;
}
XrResult XRAPI_CALL instance_properties(XrInstance, XrInstanceProperties* p) {
    std::strcpy(p->runtimeName, "of a test");
    return XR_SUCCESS;
}
XrResult XRAPI_CALL get_system(XrInstance, const XrSystemGetInfo*, XrSystemId* system) {
    if (lacks("headset")) return XR_ERROR_FORM_FACTOR_UNAVAILABLE;
    *system = 7;
    return XR_SUCCESS;
}
XrResult XRAPI_CALL system_properties(XrInstance, XrSystemId, XrSystemProperties* p) {
    std::strcpy(p->systemName, "Simulated");
    auto* hands = static_cast<XrSystemHandTrackingPropertiesEXT*>(p->next);
    if (hands->type != XR_TYPE_SYSTEM_HAND_TRACKING_PROPERTIES_EXT) control()->misused = true;
    hands->supportsHandTracking = !lacks("tracking");
    return XR_SUCCESS;
}
XrResult XRAPI_CALL create_session(XrInstance, const XrSessionCreateInfo* info, XrSession* session) {
    if (info->systemId != 7 || info->next) control()->misused = true;
    *session = handle<XrSession>(2);
    return XR_SUCCESS;
}
XrResult XRAPI_CALL create_space(XrSession, const XrReferenceSpaceCreateInfo* info, XrSpace* space) {
    if (info->referenceSpaceType != XR_REFERENCE_SPACE_TYPE_LOCAL || info->poseInReferenceSpace.orientation.w != 1)
        control()->misused = true;
    *space = handle<XrSpace>(3);
    return XR_SUCCESS;
}
XrResult XRAPI_CALL create_tracker(XrSession, const XrHandTrackerCreateInfoEXT* info, XrHandTrackerEXT* tracker) {
    *tracker = handle<XrHandTrackerEXT>(info->hand == XR_HAND_LEFT_EXT ? 4u : 5u);
    return XR_SUCCESS;
}
/// The session becomes ready, as it does by itself without a picture.
XrResult XRAPI_CALL poll_event(XrInstance, XrEventDataBuffer* buffer) {
    if (control()->lost) return XR_ERROR_INSTANCE_LOST;
    if (control()->ends.exchange(false)) {
        buffer->type = XR_TYPE_EVENT_DATA_INSTANCE_LOSS_PENDING;
        return XR_SUCCESS;
    }
    if (told == XR_SESSION_STATE_READY) return XR_EVENT_UNAVAILABLE;
    told = told == XR_SESSION_STATE_UNKNOWN ? XR_SESSION_STATE_IDLE : XR_SESSION_STATE_READY;
    XrEventDataSessionStateChanged change{};
    change.type = XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED;
    change.session = handle<XrSession>(2), change.state = told;
    std::memcpy(static_cast<void*>(buffer), &change, sizeof change);
    return XR_SUCCESS;
}
XrResult XRAPI_CALL begin_session(XrSession, const XrSessionBeginInfo*) {
    if (told != XR_SESSION_STATE_READY) control()->misused = true;
    running = true;
    return XR_SUCCESS;
}
XrResult XRAPI_CALL end_session(XrSession) { return XR_SUCCESS; }
XrResult XRAPI_CALL convert_time(XrInstance, const timespec* now, XrTime* time) {
    *time = XrTime(now->tv_sec) * 1000000000 + now->tv_nsec;
    return XR_SUCCESS;
}
XrResult XRAPI_CALL locate(XrHandTrackerEXT tracker, const XrHandJointsLocateInfoEXT* info,
                           XrHandJointLocationsEXT* locations) {
    OpenXrControl& c = *control();
    if (c.lost) return XR_ERROR_INSTANCE_LOST;
    if (!running || info->time <= 0 || locations->jointCount != 26 || info->baseSpace != handle<XrSpace>(3))
        c.misused = true;
    const std::lock_guard lock(c.mutex);
    const int hand = tracker == handle<XrHandTrackerEXT>(4) ? 0 : 1;
    locations->isActive = c.active[hand];
    for (int k = 0; k < 26; ++k) {
        const float* j = c.joints[hand][k];
        XrHandJointLocationEXT& out = locations->jointLocations[k];
        out.locationFlags = c.known[hand][k]
                                ? XR_SPACE_LOCATION_POSITION_VALID_BIT | XR_SPACE_LOCATION_ORIENTATION_VALID_BIT
                                : XR_SPACE_LOCATION_ORIENTATION_VALID_BIT;
        out.pose = {{j[3], j[4], j[5], j[6]}, {j[0], j[1], j[2]}};
    }
    ++c.located;
    return XR_SUCCESS;
}

XrResult XRAPI_CALL find(XrInstance instance, const char* name, PFN_xrVoidFunction* function);

struct Entry {
    const char* name;
    PFN_xrVoidFunction function;
};
template <class Function>
Entry entry(const char* name, Function* function) {
    return {name, reinterpret_cast<PFN_xrVoidFunction>(function)};
}

XrResult XRAPI_CALL find(XrInstance, const char* name, PFN_xrVoidFunction* function) {
    static const Entry all[] = {
        entry("xrGetInstanceProcAddr", find),
        entry("xrEnumerateInstanceExtensionProperties", list_extensions),
        entry("xrCreateInstance", create_instance),
        entry("xrDestroyInstance", destroy_instance),
        entry("xrGetInstanceProperties", instance_properties),
        entry("xrGetSystem", get_system),
        entry("xrGetSystemProperties", system_properties),
        entry("xrCreateSession", create_session),
        entry("xrCreateReferenceSpace", create_space),
        entry("xrCreateHandTrackerEXT", create_tracker),
        entry("xrPollEvent", poll_event),
        entry("xrBeginSession", begin_session),
        entry("xrEndSession", end_session),
        entry("xrConvertTimespecTimeToTimeKHR", convert_time),
        entry("xrLocateHandJointsEXT", locate),
    };
    const auto* found =
        std::find_if(std::begin(all), std::end(all), [&](const Entry& e) { return !std::strcmp(e.name, name); });
    *function = found == std::end(all) ? nullptr : found->function;
    return *function ? XR_SUCCESS : XR_ERROR_FUNCTION_UNSUPPORTED;
}

/// As the loader's interface has it; Debian's package has no header for it.
struct LoaderInfo {
    int type;
    std::uint32_t version;
    std::size_t size;
    std::uint32_t least_interface, most_interface;
    XrVersion least_api, most_api;
};
struct RuntimeRequest {
    int type;
    std::uint32_t version;
    std::size_t size;
    std::uint32_t interface;
    XrVersion api;
    PFN_xrGetInstanceProcAddr find;
};

}  // namespace

extern "C" __attribute__((visibility("default"))) XrResult xrNegotiateLoaderRuntimeInterface(const LoaderInfo* loader,
                                                                                             RuntimeRequest* request) {
    if (loader->least_interface > 1 || request->size != sizeof(RuntimeRequest)) return XR_ERROR_INITIALIZATION_FAILED;
    request->interface = 1, request->api = XR_CURRENT_API_VERSION, request->find = find;
    return XR_SUCCESS;
}
extern "C" __attribute__((visibility("default"))) OpenXrControl* openxr_runtime_control() { return control(); }
