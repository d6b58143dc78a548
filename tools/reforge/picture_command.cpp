#include "tools/reforge/picture_command.h"

#include <filesystem>
#include <memory>

#include "planner/geometry/mesh_io.h"
#include "tools/picture/render.h"

namespace reforge {
namespace {

// The paper's colours.
constexpr Colour kInitial{0.62, 0.66, 0.70};
constexpr Colour kReused{0.36, 0.66, 0.42};
constexpr Colour kAdded{0.95, 0.62, 0.25};
constexpr Colour kTarget{0.42, 0.58, 0.82};

struct PictureOptions {
  std::filesystem::path job;
  std::filesystem::path out;
  View view;
};

Status draw(const PictureOptions& options) {
  const Result<TriangleMesh> initial = read_mesh(options.job / "initial.stl");
  if (!initial) return initial.error();
  const Result<TriangleMesh> reused = read_mesh(options.job / "reused.stl");
  if (!reused) return reused.error();
  const Result<TriangleMesh> added = read_mesh(options.job / "added.stl");
  if (!added) return added.error();
  const Result<TriangleMesh> target = read_mesh(options.job / "target.stl");
  if (!target) return target.error();
  const std::vector<Panel> panels = {{{&*initial, kInitial}},
                                     {{&*reused, kReused}},
                                     {{&*reused, kReused}, {&*added, kAdded}},
                                     {{&*target, kTarget}}};
  return write_png(render(panels, options.view), options.out);
}

}  // namespace

void add_picture_command(CLI::App& app, Outcome& outcome) {
  auto options = std::make_shared<PictureOptions>();
  CLI::App* picture = app.add_subcommand(
      "picture", "Draw a job: initial, reused, reused + added, target, side by side");
  picture->add_option("job", options->job, "the job folder")
      ->required()
      ->check(CLI::ExistingDirectory);
  picture->add_option("-o,--out", options->out, "the PNG file to write")->required();
  picture->add_option("--azimuth", options->view.azimuth_deg, "viewer's azimuth, degrees");
  picture->add_option("--elevation", options->view.elevation_deg, "viewer's elevation, degrees");
  picture->callback([options, &outcome] {
    if (const Status drawn = draw(*options); !drawn) report(outcome, drawn.error());
  });
}

}  // namespace reforge
