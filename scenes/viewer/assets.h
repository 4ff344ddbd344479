#pragma once
// Files of the viewer's page, kept inside the program.

#include <string_view>

namespace palpate::assets {

std::string_view page();            ///< page.html, with marks for the others
std::string_view frames();          ///< frames.js
std::string_view plots();           ///< plots.js
std::string_view scene();           ///< scene.js
std::string_view detail();          ///< detail.js
std::string_view skin();            ///< skin.js
std::string_view shadow();          ///< shadow.js
std::string_view surroundings();    ///< surroundings.js
std::string_view hand();            ///< hand.js
std::string_view mechanism();       ///< mechanism.js
std::string_view names();           ///< names.js
std::string_view pads();            ///< pads.js
std::string_view view();            ///< view.js
std::string_view keys();            ///< keys.js
std::string_view three();           ///< three.js
std::string_view orbit_controls();  ///< of three.js

}  // namespace palpate::assets
