#include "scenes/program/paper_figures.h"

#include <cmath>

#include "scenes/load/find_scene.h"
#include "scenes/picture/still.h"
#include "scenes/run/wrapped.h"
#include "scenes/viewer/rendered_pads.h"

namespace palpate {

namespace {

namespace fs = std::filesystem;

/// Moments of a scene, in columns: the scene, then a row of pads that touch the object, then these pads on their
/// platforms.
struct Figure {
    const char* file;
    struct Column {
        const char* scene;
        double time;  ///< [s]
        const char* what;
    };
    std::vector<Column> columns;
    int width;  ///< of a column [pixels]
    bool hand;
};
const std::vector<Figure> figures{
    {"paper-fig1.png", {{"hand", 2.7, "five fingers roll a ball"}}, 900, true},
    {"paper-fig5.png",
     {{"press", 0.6, "a flat surface"}, {"edge", 0.6, "the edge of a box"}, {"ball", 0.6, "a ball, off its centre"}},
     300,
     false},
    {"paper-fig6.png",
     {{"roll", 0.3, "rolled by 0 degrees"},
      {"roll", 1.1, "by 20 degrees"},
      {"roll", 1.7, "by 35 degrees"},
      {"roll", 2.3, "by 50 degrees"}},
     300,
     false},
};
constexpr int scene_height = 300, pad_height = 200, head = 24;
constexpr Colour ink{0.11f, 0.14f, 0.19f}, soft{0.36f, 0.40f, 0.46f}, paper{1, 1, 1};

/// Sum over samples of the difference between the force that was wanted and the one rendered, finger frame [N].
double field_error(const ContactSurface& wanted, const RenderedPad& felt) {
    const Mat3<double> R = rotation_matrix(wanted.bone.rotation);
    double sum = 0;
    for (std::size_t k = 0; k < felt.force.size(); ++k)
        sum += norm(transposed_times(R, wanted.force[k]) - felt.force[k]);
    return sum;
}

void paint_column(Image& image, int left, const Figure& figure, const Figure::Column& column, const Simulation& s) {
    PictureSettings settings;
    settings.width = figure.width, settings.height = scene_height, settings.hand = figure.hand;
    settings.pads = settings.title = false;
    image.paste(Painter(s, settings).paint(s), left, head);
    image.write(left + (figure.width - text_width(column.what)) / 2, 6, column.what, ink);
    RenderedPads felt(s);
    const std::vector<RenderedPad>& rendered = felt.solve(s);
    const int count = int(s.world.matchings.size()), cell = figure.width / count, top = head + scene_height;
    for (int t = 0; t < count; ++t) {
        const EntityId finger = s.world.matchings[std::size_t(t)].finger;
        const std::string& name = s.world.skins.find(finger)->name;
        const PadOnPlatform& pad = felt.pad(std::size_t(t));
        const double most = paint_pad(image, s.world, finger, {left + t * cell, top, cell, pad_height, name});
        paint_pad(image, pad.world, pad.finger, {left + t * cell, top + pad_height, cell, pad_height, "feels", most});
        const std::string error =
            written(cell > 200 ? "difference of the forces %.2f N" : "off %.2f N",
                    field_error(*s.world.contact_surfaces.find(finger), rendered[std::size_t(t)]));
        image.write(left + t * cell + (cell - text_width(error)) / 2, top + 2 * pad_height + 4, error, soft);
    }
}

}  // namespace

std::vector<fs::path> paint_paper_figures(const fs::path& folder, int threads, const std::atomic<bool>& stop,
                                          const std::function<void(double)>& show) {
    std::vector<fs::path> files;
    for (const Figure& figure : figures) {
        Image image(figure.width * int(figure.columns.size()), head + scene_height + 2 * pad_height + 24, paper);
        std::unique_ptr<Simulation> s;
        for (std::size_t k = 0; k < figure.columns.size(); ++k) {
            const Figure::Column& column = figure.columns[k];
            const bool goes_on = k > 0 && std::string(figure.columns[k - 1].scene) == column.scene;
            if (!goes_on)
                s = std::make_unique<Simulation>(make_simulation(load_scene(find_scene(column.scene)), threads, false));
            while (!stop && s->world.time < column.time - 0.5 * s->world.solver.dt) advance(*s);
            if (stop) return {};
            paint_column(image, int(k) * figure.width, figure, column, *s);
            show((double(files.size()) + double(k + 1) / double(figure.columns.size())) / double(figures.size()));
        }
        files.push_back(folder / figure.file);
        write_png(files.back(), fewer_colours(std::move(image)));
    }
    return files;
}

}  // namespace palpate
