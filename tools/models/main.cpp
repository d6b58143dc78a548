// reforge-make-models FOLDER: the project's own small pairs, so that demo and tests need nothing
// else.
//
// Each pair is `<name>_<initial>.stl` and `<name>_<target>.stl`, registered as stored, in mm,
// standing on z = 0. Every solid is made of cuboids and cylinders by exact booleans; nothing is
// random.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <utility>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

// Stops the program with the error: a model recipe that fails is a defect of ours.
TriangleMesh must(Result<TriangleMesh> made) {
  if (!made) {
    std::fprintf(stderr, "reforge-make-models: %s\n", made.error().sentence.c_str());
    std::exit(4);
  }
  return std::move(made).value();
}
TriangleMesh joined(const TriangleMesh& a, const TriangleMesh& b) {
  return must(boolean_union(a, b));
}
TriangleMesh without(const TriangleMesh& a, const TriangleMesh& b) {
  return must(boolean_difference(a, b));
}

// A cuboid centred on x and y, standing at `foot`, turned about z and then leant about y.
TriangleMesh leaning_box(const Vec3& size, const Vec3& foot, double lean_deg, double turn_deg) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translate(foot);
  pose.rotate(Eigen::AngleAxisd(turn_deg * std::numbers::pi / 180, Vec3::UnitZ()));
  pose.rotate(Eigen::AngleAxisd(lean_deg * std::numbers::pi / 180, Vec3::UnitY()));
  return transformed(
      make_box(Vec3(-size.x() / 2, -size.y() / 2, 0), Vec3(size.x() / 2, size.y() / 2, size.z())),
      pose);
}

struct Pair {
  TriangleMesh initial;
  TriangleMesh target;
};

// A pillow block whose bore ran hot: the top is gouged, one end of the flange is torn off at a
// concave edge. Repaired, it also gets a lightening pocket that it never had.
Pair bearing() {
  TriangleMesh block =
      joined(make_box({-20, -9, 0}, {20, 9, 6}), make_box({-11, -9, 3}, {11, 9, 24}));
  block = without(block, make_cylinder({0, -10, 14}, {0, 10, 14}, 6, 48));
  TriangleMesh worn = without(block, make_cylinder({4, -10, 27}, {4, 1, 27}, 5.5, 32));
  worn = without(worn, leaning_box({8, 30, 20}, {20, 8, -5}, 0, 25));
  worn = without(worn, leaning_box({8, 30, 20}, {20, -8, -5}, 0, -25));
  TriangleMesh repaired = without(block, make_box({-18, -6, 4}, {-12.5, 6, 8}));
  return {std::move(worn), std::move(repaired)};
}

// A disc of stock turned into an impeller whose hub stands above it.
Pair impeller() {
  TriangleMesh wheel = joined(make_cylinder({0, 0, 0}, {0, 0, 4}, 15, 72),
                              make_cylinder({0, 0, 2}, {0, 0, 15}, 5, 48));
  for (int k = 0; k < 5; ++k) {
    const double turn = 72.0 * k + 5;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.rotate(Eigen::AngleAxisd(turn * std::numbers::pi / 180, Vec3::UnitZ()));
    wheel = joined(wheel, transformed(make_box({3.5, -1.2, 3}, {14.2, 1.2, 10}), pose));
  }
  return {make_cylinder({0, 0, 0}, {0, 0, 12}, 16, 64), std::move(wheel)};
}

// A bent Y whose two arms broke off at hollow faces: one clipping plane cannot serve both.
Pair bent_y() {
  const TriangleMesh trunk = make_box({-6, -5, 0}, {6, 5, 16});
  const TriangleMesh left = leaning_box({8, 8, 22}, {-1, 0, 11}, -42, 8);
  const TriangleMesh right = leaning_box({8, 8, 22}, {1, 0.5, 11.5}, 40, -15);
  TriangleMesh target = joined(joined(trunk, left), right);
  TriangleMesh broken = without(target, make_cylinder({-17, -12, 27}, {-17, 12, 27}, 9, 40));
  broken = without(broken, make_cylinder({17, -12, 27.5}, {17, 12, 27.5}, 9, 40));
  return {std::move(broken), std::move(target)};
}

// A block of stock made into an angle bracket that is taller than the block.
Pair bracket() {
  TriangleMesh angle =
      joined(make_box({-17, -9, 0}, {17, 9, 5}), make_box({-17, -9, 3}, {-10, 9, 24}));
  angle = without(angle, make_cylinder({8, 0, 2}, {8, 0, 8}, 3.5, 40));
  return {make_box({-18, -10, 0}, {18, 10, 14}), std::move(angle)};
}

bool write(const std::filesystem::path& file, const TriangleMesh& mesh) {
  const Status written = write_binary_stl(mesh, file);
  if (!written) std::fprintf(stderr, "reforge-make-models: %s\n", written.error().sentence.c_str());
  return written.ok();
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  using namespace reforge;
  if (argc != 2) {
    std::fprintf(stderr, "usage: reforge-make-models FOLDER\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) {
    std::fprintf(stderr, "reforge-make-models: cannot make the folder %s: %s\n", folder.c_str(),
                 failed.message().c_str());
    return 3;
  }
  const Pair bearing_pair = bearing(), impeller_pair = impeller(), y_pair = bent_y(),
             bracket_pair = bracket();
  const bool all = write(folder / "bearing_worn.stl", bearing_pair.initial) &&
                   write(folder / "bearing_repaired.stl", bearing_pair.target) &&
                   write(folder / "impeller_cylinder.stl", impeller_pair.initial) &&
                   write(folder / "impeller_wheel.stl", impeller_pair.target) &&
                   write(folder / "y_broken.stl", y_pair.initial) &&
                   write(folder / "y_whole.stl", y_pair.target) &&
                   write(folder / "bracket_box.stl", bracket_pair.initial) &&
                   write(folder / "bracket_angle.stl", bracket_pair.target);
  if (all) std::printf("four pairs in %s\n", folder.c_str());
  return all ? 0 : 3;
}
