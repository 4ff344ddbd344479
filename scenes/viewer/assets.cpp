#include "scenes/viewer/assets.h"

// The files become part of the program as they are, by the assembler.
#define PALPATE_ASSET(name, path)                                          \
    asm(".section .rodata\n" #name "_begin:\n.incbin \"" path "\"\n" #name \
        "_end:\n"                                                          \
        ".byte 0\n.text\n");                                               \
    extern "C" const char name##_begin[], name##_end[];

PALPATE_ASSET(palpate_page, PALPATE_VIEWER_DIR "/page.html")
PALPATE_ASSET(palpate_frames, PALPATE_VIEWER_DIR "/frames.js")
PALPATE_ASSET(palpate_plots, PALPATE_VIEWER_DIR "/plots.js")
PALPATE_ASSET(palpate_scene, PALPATE_VIEWER_DIR "/scene.js")
PALPATE_ASSET(palpate_skin, PALPATE_VIEWER_DIR "/skin.js")
PALPATE_ASSET(palpate_surroundings, PALPATE_VIEWER_DIR "/surroundings.js")
PALPATE_ASSET(palpate_hand, PALPATE_VIEWER_DIR "/hand.js")
PALPATE_ASSET(palpate_mechanism, PALPATE_VIEWER_DIR "/mechanism.js")
PALPATE_ASSET(palpate_names, PALPATE_VIEWER_DIR "/names.js")
PALPATE_ASSET(palpate_pads, PALPATE_VIEWER_DIR "/pads.js")
PALPATE_ASSET(palpate_keys, PALPATE_VIEWER_DIR "/keys.js")
PALPATE_ASSET(palpate_detail, PALPATE_VIEWER_DIR "/detail.js")
PALPATE_ASSET(palpate_shadow, PALPATE_VIEWER_DIR "/shadow.js")
PALPATE_ASSET(palpate_view, PALPATE_VIEWER_DIR "/view.js")
PALPATE_ASSET(palpate_three, PALPATE_THREE_DIR "/three.min.js")
PALPATE_ASSET(palpate_orbit, PALPATE_THREE_DIR "/examples/js/controls/OrbitControls.js")

namespace palpate::assets {

std::string_view page() { return {palpate_page_begin, palpate_page_end}; }
std::string_view frames() { return {palpate_frames_begin, palpate_frames_end}; }
std::string_view plots() { return {palpate_plots_begin, palpate_plots_end}; }
std::string_view scene() { return {palpate_scene_begin, palpate_scene_end}; }
std::string_view skin() { return {palpate_skin_begin, palpate_skin_end}; }
std::string_view surroundings() { return {palpate_surroundings_begin, palpate_surroundings_end}; }
std::string_view hand() { return {palpate_hand_begin, palpate_hand_end}; }
std::string_view mechanism() { return {palpate_mechanism_begin, palpate_mechanism_end}; }
std::string_view names() { return {palpate_names_begin, palpate_names_end}; }
std::string_view pads() { return {palpate_pads_begin, palpate_pads_end}; }
std::string_view keys() { return {palpate_keys_begin, palpate_keys_end}; }
std::string_view detail() { return {palpate_detail_begin, palpate_detail_end}; }
std::string_view shadow() { return {palpate_shadow_begin, palpate_shadow_end}; }
std::string_view view() { return {palpate_view_begin, palpate_view_end}; }
std::string_view three() { return {palpate_three_begin, palpate_three_end}; }
std::string_view orbit_controls() { return {palpate_orbit_begin, palpate_orbit_end}; }

}  // namespace palpate::assets
