// Solids that nearly coincide: what the volumes are is known by hand.

#include <gtest/gtest.h>

#include <cmath>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/shapes.h"
#include "planner/reuse/tolerant_overlay.h"
#include "planner/reuse/volumes.h"

#ifdef REFORGE_SHARED_MODELS
#include <fstream>
#include <nlohmann/json.hpp>
#endif

namespace reforge {
namespace {

double volume_in(const Volumes& volumes, Region region) {
  return volume_of(volumes.complex, region);
}

// Closed, oriented, free of self-intersection, and adding up to both parts.
void expect_sound(const Volumes& volumes, const TriangleMesh& initial, const TriangleMesh& target) {
  for (const Region region : {kReused, kRemoved, kAdded}) {
    const TriangleMesh surface = surface_of(volumes.complex, in(region));
    EXPECT_TRUE(is_closed(surface)) << "region " << region;
    EXPECT_GE(volume(surface), 0) << "region " << region;
    const EdgeFaults faults = edge_faults(surface);
    if (!surface.empty() && faults.crowded == 0 && !pinched_vertex(surface)) {
      EXPECT_FALSE(self_intersects(surface)) << "region " << region;
    }
  }
  const double of_initial = volume(initial), of_target = volume(target);
  EXPECT_NEAR(
      volume_in(volumes, kReused) + volume_in(volumes, kRemoved) + volumes.dropped_initial_mm3,
      of_initial, 1e-6 * of_initial);
  EXPECT_NEAR(volume_in(volumes, kReused) + volume_in(volumes, kAdded) + volumes.dropped_mm3,
              of_target, 1e-6 * of_target);
  const double bound = kMachineTolerance * volumes.coincident_area_mm2 + 1e-6 * of_target;
  EXPECT_LE(std::abs(volumes.dropped_mm3), bound);
  EXPECT_LE(std::abs(volumes.dropped_initial_mm3), bound);
}

struct Expected {
  double reused, removed, added, within;
};

void expect_volumes(const TriangleMesh& initial, const TriangleMesh& target,
                    const Expected& expected) {
  const auto volumes = ideal_volumes(initial, target);
  ASSERT_TRUE(volumes) << volumes.error().sentence;
  expect_sound(*volumes, initial, target);
  EXPECT_NEAR(volume_in(*volumes, kReused), expected.reused, expected.within);
  EXPECT_NEAR(volume_in(*volumes, kRemoved), expected.removed, expected.within);
  EXPECT_NEAR(volume_in(*volumes, kAdded), expected.added, expected.within);
}

// Every triangle in four, the middles of edges moved by up to `noise` mm.
TriangleMesh retessellated(const TriangleMesh& mesh, double noise) {
  std::vector<Vec3> corners;
  TriangleMesh result;
  const auto middle = [noise](const Vec3& a, const Vec3& b) {
    const Vec3 m = (a + b) / 2;
    return Vec3(m + noise * Vec3(std::sin(1e3 * m.x() + 1), std::sin(1e3 * m.y() + 2),
                                 std::sin(1e3 * m.z() + 3)));
  };
  const auto add = [&result](const Vec3& a, const Vec3& b, const Vec3& c) {
    const auto first = static_cast<std::uint32_t>(result.vertices.size());
    result.vertices.insert(result.vertices.end(), {a, b, c});
    result.triangles.push_back({first, first + 1, first + 2});
  };
  for (const auto& [i, j, k] : mesh.triangles) {
    const Vec3 &a = mesh.vertices[i], &b = mesh.vertices[j], &c = mesh.vertices[k];
    const Vec3 ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    add(a, ab, ca);
    add(ab, b, bc);
    add(ca, bc, c);
    add(ab, bc, ca);
  }
  return welded(rounded_to_float(std::move(result)));
}

TriangleMesh block() {
  return make_box(Vec3(0, 0, 0), Vec3(20, 16, 10));
}
TriangleMesh drilled() {
  return *boolean_difference(block(), make_cylinder(Vec3(11, 7, -1), Vec3(11, 7, 11), 3, 48));
}
double hole() {
  return volume(block()) - volume(drilled());
}

TEST(VolumesOverlap, IdenticalSolidsAreAllReused) {
  expect_volumes(block(), block(), {3200, 0, 0, 1e-9});
}

TEST(VolumesOverlap, TheSameBoxWithOtherTrianglesIsAllReused) {
  expect_volumes(block(), retessellated(block(), 0), {3200, 0, 0, 1e-6});
  expect_volumes(retessellated(block(), 0), block(), {3200, 0, 0, 1e-6});
}

TEST(VolumesOverlap, RoundingNoiseLeavesNoSkins) {
  const TriangleMesh cylinder =
      rounded_to_float(make_cylinder(Vec3(0, 0, 0), Vec3(0, 0, 12), 9, 64));
  const TriangleMesh noisy = retessellated(cylinder, 1e-6);
  expect_volumes(cylinder, noisy, {volume(cylinder), 0, 0, 1e-3});
}

TEST(VolumesOverlap, AShiftWithinTheToleranceIsNoDifference) {
  expect_volumes(block(), translated(block(), Vec3(1e-4, 2e-4, 0)), {3200, 0, 0, 1e-6});
}

TEST(VolumesOverlap, AShiftBeyondTheToleranceIsOne) {
  const double shift = 0.5;
  expect_volumes(block(), translated(block(), Vec3(shift, 0, 0)),
                 {19.5 * 160, shift * 160, shift * 160, 0.1});
}

TEST(VolumesOverlap, AHoleIsRemovedAlone) {
  expect_volumes(block(), drilled(), {3200 - hole(), hole(), 0, 0.05});
}

TEST(VolumesOverlap, AHoleIsFilledAlone) {
  expect_volumes(drilled(), block(), {3200 - hole(), 0, hole(), 0.05});
}

TEST(VolumesOverlap, AHoleInASolidWithOtherTrianglesAndNoise) {
  expect_volumes(retessellated(block(), 1e-6), drilled(), {3200 - hole(), hole(), 0, 0.1});
  expect_volumes(drilled(), retessellated(block(), 1e-6), {3200 - hole(), 0, hole(), 0.1});
}

TEST(VolumesOverlap, WornCornerAndNewBossShareTheRest) {
  const TriangleMesh worn =
      *boolean_difference(block(), make_box(Vec3(15, -1, 6), Vec3(21, 5, 11)));
  const TriangleMesh wanted =
      *boolean_difference(drilled(), make_box(Vec3(-1, 12, 7), Vec3(4, 17, 11)));
  const double step = 4 * 4 * 3;
  expect_volumes(worn, wanted, {3200 - hole() - step - 100, hole() + step, 100, 0.1});
}

TEST(VolumesOverlap, NestedSolidsShareTheirVolume) {
  expect_volumes(block(), make_box(Vec3(5, 5, 2), Vec3(10, 10, 7)), {125, 3075, 0, 1e-6});
}

TEST(VolumesOverlap, ACommonBaseNeedsNoSkinUnderThePart) {
  expect_volumes(block(), make_box(Vec3(5, 5, 0), Vec3(10, 10, 5)), {125, 3075, 0, 0.01});
}

TEST(VolumesOverlap, TouchingSolidsShareNothing) {
  expect_volumes(block(), make_box(Vec3(20, 0, 0), Vec3(30, 16, 10)), {0, 3200, 1600, 0.1});
}

TEST(VolumesOverlap, ApartNothingIsShared) {
  expect_volumes(block(), make_box(Vec3(30, 0, 0), Vec3(40, 10, 10)), {0, 3200, 1000, 1e-9});
}

TEST(VolumesOverlap, SameInputSameComplex) {
  const auto one = tolerant_overlay(block(), drilled(), kMachineTolerance);
  const auto two = tolerant_overlay(block(), drilled(), kMachineTolerance);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(one->complex.vertices, two->complex.vertices);
  ASSERT_EQ(one->complex.facets.size(), two->complex.facets.size());
  for (std::size_t f = 0; f < one->complex.facets.size(); ++f) {
    EXPECT_EQ(one->complex.facets[f].corners, two->complex.facets[f].corners);
  }
}

#ifdef REFORGE_SHARED_MODELS
// The pairs that exact booleans fail on or take minutes for, and one they do not.
TEST(VolumesOverlap, SharedPairsKeepTheirReferenceReuse) {
  const std::string folder = REFORGE_SHARED_MODELS;
  const auto pairs = nlohmann::json::parse(std::ifstream(folder + "/pairs.json"));
  for (const auto& pair : pairs["pairs"]) {
    const std::string name = pair["name"];
    if (name != "bearing_repair" && name != "overlap_one_hole" && name != "overlap_fill_hole" &&
        name != "overlap_retessellated" && name != "trapezium_joint") {
      continue;
    }
    SCOPED_TRACE(name);
    const auto read = [&](const char* key) {
      return rounded_to_float(welded(*read_mesh(folder + "/" + pair[key].get<std::string>())));
    };
    const TriangleMesh initial = read("initial"), target = read("target");
    const auto volumes = ideal_volumes(initial, target);
    ASSERT_TRUE(volumes) << volumes.error().sentence;
    const double reference = pair["reference"]["as_stored"]["intersection_volume"];
    EXPECT_NEAR(volume_in(*volumes, kReused), reference, 1e-4 * reference);
    const double of_initial = volume(initial), of_target = volume(target);
    EXPECT_NEAR(volume_in(*volumes, kReused) + volume_in(*volumes, kRemoved), of_initial,
                1e-6 * of_initial);
    EXPECT_LE(std::abs(volumes->dropped_mm3),
              kMachineTolerance * volumes->coincident_area_mm2 + 1e-6 * of_target);
    for (const Region region : {kReused, kRemoved, kAdded}) {
      EXPECT_TRUE(is_closed(surface_of(volumes->complex, in(region))));
    }
  }
}
#endif

}  // namespace
}  // namespace reforge
