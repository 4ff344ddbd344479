#pragma once
// Triangles to pixels on the CPU, where there is neither a graphics card nor a browser: opaque things with depth, then
// the nearest surface of each thing that may hide a contact, clear where it does.

#include <Eigen/Core>
#include <array>
#include <vector>

#include "engine/math/linear_algebra.h"
#include "scenes/picture/image.h"

namespace palpate {

inline Eigen::Vector3d as_eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }

/// Looks from `eye` at `target`; z up.
struct Camera {
    Eigen::Vector3d eye{0, 0, 0}, target{0, 0, 0}, up{0, 0, 1};
    double field = 0.56;  ///< vertical angle of view [rad]; 0: parallel, `half_height` above and below the target
    double half_height = 0.01;
};

/// World to view: x right, y up, z towards the viewer [m].
struct View {
    Camera camera;
    Eigen::Matrix3d axes;  ///< rows
    int width = 0, height = 0;
    View(const Camera& camera, int width, int height);
    Eigen::Vector3d in_view(const Eigen::Vector3d& world) const;
    /// Pixel of a point in view space; z is 1/distance, or its z with a parallel camera: larger is nearer.
    Eigen::Vector3d pixel(const Eigen::Vector3d& in_view) const;
    /// Point of the ray through a pixel, and its direction, in the world.
    std::array<Eigen::Vector3d, 2> ray(double x, double y) const;
};

struct Vertex {
    Eigen::Vector3d position, normal;
    Colour colour;
};

/// What a picture is made of.
struct Triangles {
    std::vector<Vertex> vertices;
    std::vector<std::array<int, 3>> faces;
};

/// Where contacts are that nothing may hide: what lies between them and the eye becomes clear around them.
struct Contacts {
    std::vector<Eigen::Vector3d> place;
    double radius = 0.011;  ///< [m]
};

class Raster {
  public:
    Raster(const Camera& camera, int width, int height, Colour background);
    /// Shaded by its normals; two-sided.
    void opaque(const Triangles& t);
    /// Its surface nearest to the eye, with `opacity`, less before contacts; drawn over what is behind it. `id` is
    /// what `layer_id` says of it.
    void layer(const Triangles& t, int id, double opacity, const Contacts& contacts);
    /// A line drawn over what is not nearer [m].
    void line(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Colour colour, double thickness, bool hidden = true);
    /// The floor z = height, with a grid of 10 mm and soft shadows of what has been drawn as `shadow`.
    void floor(double height, const std::vector<const Triangles*>& shadow, Colour colour, Colour lines);
    /// With layers over it, smaller by `factor`.
    Image image(int factor) const;
    const View& view() const { return view_; }
    /// The layer whose surface is seen at a pixel; -1: none.
    int layer_id(int x, int y) const { return ids_[std::size_t(y * view_.width + x)]; }

  private:
    struct Pixel {
        Colour colour;
        float depth;
    };
    template <class Paint>
    void draw(const Triangles& t, Paint paint);
    View view_;
    Colour background_;
    std::vector<Pixel> pixels_;
    std::vector<float> layer_depth_, opacity_;
    std::vector<Colour> layer_colour_;
    std::vector<int> ids_;
};

}  // namespace palpate
