#pragma once
// A moment of a run as a picture: the scene with its hand, objects, floor and forces, and below it each finger's pad
// seen from its contact side.

#include "scenes/picture/scales.h"
#include "scenes/picture/scene_triangles.h"

namespace palpate {

struct PictureSettings {
    int width = 900, height = 620;
    bool hand = true, thimbles = true, pads = true, title = true, dark = false;
    bool painted = true;  ///< false: results have no picture
    int samples = 2;      ///< per pixel and direction
    PictureScales scales{};
};

/// Where a pad is drawn, and how.
struct PadPlace {
    int x, top, width, height;  ///< [pixels]
    std::string name;           ///< above it
    double most = 0;            ///< end of its scale [Pa]; 0: of its own
    bool dark = false;
    int samples = 2;
};
/// Names as they fit into a width [pixels], all in the same manner: whole, "L thumb" for "left thumb", or the first
/// letters of that.
std::vector<std::string> fitting_names(std::vector<std::string> names, int width);

/// A finger's pad seen from its contact side, the tip up: pressure, edge of the touched area, centre of pressure, name,
/// force, area and scale. Returns the end of the scale [Pa].
double paint_pad(Image& image, const World& world, EntityId finger, const PadPlace& place);

/// Draws moments of one run, one after the other: the camera follows, the hand goes on from where it was.
class Painter {
  public:
    Painter(const Simulation& simulation, PictureSettings settings);
    Image paint(const Simulation& simulation);
    /// What the last picture's camera saw of objects: for tests.
    const Raster& raster() const { return *raster_; }
    /// Where its names stand: left, top, width, height [pixels].
    const std::vector<std::array<int, 4>>& names() const { return names_; }

  private:
    void choose_camera(const Simulation& simulation);
    void paint_scene(const Simulation& simulation, Image& image, int top, int height);
    void write_names(const Simulation& simulation, Image& image, int top, int height);
    void paint_pads(const Simulation& simulation, Image& image, int top, int height);
    PictureSettings settings_;
    std::vector<HandPoser> hands_;
    std::unique_ptr<Raster> raster_;
    Camera camera_;
    double reach_ = 0, most_ = 0, most_force_ = 0.5;
    std::vector<double> floors_;
    std::vector<std::array<int, 4>> names_;
};

}  // namespace palpate
