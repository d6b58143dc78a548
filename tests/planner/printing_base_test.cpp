// The cases of paper.md, Fig. 5: what a nozzle can start printing on.
#include "planner/reuse/printing_base.h"

#include <gtest/gtest.h>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/shapes.h"
#include "planner/reuse/volumes.h"

namespace reforge {
namespace {

TriangleMesh box(double x0, double y0, double z0, double x1, double y1, double z1) {
  return make_box(Vec3(x0, y0, z0), Vec3(x1, y1, z1));
}

std::vector<BaseComponent> bases_of(const TriangleMesh& initial, const TriangleMesh& target) {
  const auto volumes = ideal_volumes(initial, target);
  EXPECT_TRUE(volumes.ok());
  return printing_bases(volumes->complex, volumes->is_skin);
}

TEST(PrintingBase, AFlatTopIsPlanoConvex) {
  const auto bases = bases_of(box(0, 0, 0, 20, 20, 10), box(0, 0, 0, 20, 20, 15));
  ASSERT_EQ(bases.size(), 1u);
  EXPECT_TRUE(bases[0].plano_convex);
  EXPECT_NEAR(bases[0].area_mm2, 400, 80 * kMachineTolerance);  // its walls are common to both
  EXPECT_NEAR(bases[0].lowest_z, 10, 1e-9);
  EXPECT_NEAR(bases[0].mean_normal.z(), 1, 1e-9);
}

TEST(PrintingBase, AStepUpIsHollow) {
  // V_R has a step: the wall and the tread meet in a hollow edge.
  const auto step = boolean_union(box(0, 0, 0, 20, 20, 10), box(0, 0, 10, 10, 20, 18));
  const auto bases = bases_of(*step, box(0, 0, 0, 20, 20, 18));
  ASSERT_EQ(bases.size(), 1u);
  EXPECT_EQ(bases[0].planes.size(), 2u);
  EXPECT_FALSE(bases[0].plano_convex);
}

TEST(PrintingBase, ARidgeBendsAwayAndIsPlanoConvex) {
  // The target wraps around a corner of V_R: two facets that meet in an outer edge.
  const auto bases = bases_of(box(0, 0, 0, 20, 20, 10), box(0, 0, 0, 25, 20, 15));
  ASSERT_EQ(bases.size(), 1u);
  EXPECT_EQ(bases[0].planes.size(), 2u);
  EXPECT_TRUE(bases[0].plano_convex);
}

TEST(PrintingBase, ACurvedBaseIsNotPlanar) {
  const auto worn = boolean_difference(box(0, 0, 0, 30, 20, 10),
                                       make_cylinder(Vec3(15, -1, 14), Vec3(15, 21, 14), 8, 96));
  const auto bases = bases_of(*worn, box(0, 0, 0, 30, 20, 10));
  ASSERT_EQ(bases.size(), 1u);
  EXPECT_FALSE(bases[0].plano_convex);
}

TEST(PrintingBase, TwoFlatTopsApartAreTwoBases) {
  auto fork = boolean_union(box(0, 0, 0, 30, 10, 10), box(0, 0, 10, 8, 10, 20));
  fork = boolean_union(*fork, box(22, 0, 10, 30, 10, 16));
  auto longer = boolean_union(box(0, 0, 0, 30, 10, 10), box(0, 0, 10, 8, 10, 24));
  longer = boolean_union(*longer, box(22, 0, 10, 30, 10, 24));
  const auto bases = bases_of(*fork, *longer);
  ASSERT_EQ(bases.size(), 2u);
  EXPECT_TRUE(bases[0].plano_convex);
  EXPECT_TRUE(bases[1].plano_convex);
}

TEST(PrintingBase, NothingToPrintHasNoBase) {
  EXPECT_TRUE(bases_of(box(0, 0, 0, 20, 20, 10), box(5, 5, 0, 15, 15, 10)).empty());
}

TEST(Volumes, BalanceOverNestedOverlappingAndIdenticalParts) {
  const auto block = box(0, 0, 0, 20, 20, 10);
  for (const auto& target : {box(5, 5, 0, 15, 15, 10), box(5, 5, 0, 30, 15, 14), block}) {
    const auto volumes = ideal_volumes(block, target);
    ASSERT_TRUE(volumes.ok());
    const double reused = volume_of(volumes->complex, kReused);
    EXPECT_NEAR(reused + volume_of(volumes->complex, kRemoved) + volumes->dropped_initial_mm3,
                volume(block), 1e-3);
    EXPECT_NEAR(reused + volume_of(volumes->complex, kAdded) + volumes->dropped_mm3, volume(target),
                1e-3);
  }
}

TEST(Volumes, LoosePiecesOfTheCommonVolumeDoNotStay) {
  // The arch's lintel is common to both, but the target's legs stand elsewhere.
  const auto initial = boolean_union(box(0, 0, 0, 6, 10, 20), box(0, 0, 20, 40, 10, 26));
  const auto target = boolean_union(box(34, 0, 0, 40, 10, 20), box(20, 0, 20, 40, 10, 26));
  auto volumes = ideal_volumes(*initial, *target);
  ASSERT_TRUE(volumes.ok());
  EXPECT_NEAR(set_loose_pieces_free(volumes->complex), 1200, 1e-3);
  EXPECT_EQ(volume_of(volumes->complex, kReused), 0);
  EXPECT_NEAR(volume_of(volumes->complex, kThenAdded), 1200, 1e-3);
}

}  // namespace
}  // namespace reforge
