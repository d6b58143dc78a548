// Accessibility against slow oracles that look at every sample or every cell, one after another.
#include "planner/reuse/accessibility.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "planner/geometry/shapes.h"
#include "planner/reuse/blockers.h"
#include "planner/reuse/run_graph.h"

namespace reforge {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  double in(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1p-53;
  }
  Vec3 point(double size) { return {in(-size, size), in(-size, size), in(0, size)}; }
  Vec3 direction() {
    const double z = in(0, 1), turn = in(0, 6.28), r = std::sqrt(1 - z * z);
    return {r * std::cos(turn), r * std::sin(turn), z};
  }

 private:
  std::mt19937_64 random_;
};

// A table with pillars on it.
std::vector<TriangleMesh> pillars(Dice& dice) {
  std::vector<TriangleMesh> solids{make_box({-12, -12, 0}, {12, 12, 2})};
  for (int k = 0; k < 5; ++k) {
    const Vec3 foot(dice.in(-10, 10), dice.in(-10, 10), 2);
    solids.push_back(make_cylinder(foot, foot + Vec3(0, 0, dice.in(2, 18)), dice.in(1, 4), 9));
  }
  return solids;
}

TriangleMesh together(const std::vector<TriangleMesh>& solids) {
  TriangleMesh all;
  for (const TriangleMesh& solid : solids) {
    const auto first = static_cast<std::uint32_t>(all.vertices.size());
    all.vertices.insert(all.vertices.end(), solid.vertices.begin(), solid.vertices.end());
    for (const auto& [a, b, c] : solid.triangles)
      all.triangles.push_back({a + first, b + first, c + first});
  }
  return all;
}

std::vector<ToolSection> random_tool(Dice& dice) {
  const double first = dice.in(0.1, 2), second = first + dice.in(1, 6),
               third = second + dice.in(1, 6);
  const double r1 = dice.in(0.5, 2), r2 = r1 + dice.in(0.2, 6);
  return {
      {first, second, r1, r1}, {second, third, r2, r2}, {third, kInfinite, kInfinite, kInfinite}};
}

TEST(Accessibility, BlockersAreTheSamplesInsideTheToolOneByOne) {
  Dice dice(7);
  for (int round = 0; round < 5; ++round) {
    const TriangleMesh solid = together(pillars(dice));
    const VoxelSet samples = sample(solid, VoxelGrid::over(bounds(solid), 1.3));
    for (int look = 0; look < 40; ++look) {
      const Vec3 direction = dice.direction(), tip = dice.point(14);
      const auto sections = random_tool(dice);
      const ToolProfile tool(sections, 0.2, 0.1);
      const DirectedSamples along(samples, direction);
      const BitSet found = along.find(tool, tip);
      std::size_t expected = 0;
      for (std::size_t i = 0; i < samples.size(); ++i) {
        // In the frame's own single precision: whoever stands on a limit is judged alike.
        const Frame& frame = along.frame();
        const Vec3 at = frame.to_local(tip);
        const auto du =
            static_cast<float>(frame.u.dot(samples.points[i])) - static_cast<float>(at.x());
        const auto dv =
            static_cast<float>(frame.v.dot(samples.points[i])) - static_cast<float>(at.y());
        const auto h = static_cast<float>(samples.points[i].dot(direction));
        const auto base = static_cast<float>(at.z());
        bool inside = h > base + tool.infinite_from;
        float square = 0;
        for (const auto& step : tool.steps) {
          if (h > base + step.from) square = step.square;
        }
        inside |= du * du + dv * dv < square;
        EXPECT_EQ(found.test(i), inside);
        expected += inside;
      }
      EXPECT_EQ(found.count(), expected);
      EXPECT_EQ(along.count(tool, tip, samples.size()), expected);
      EXPECT_LE(along.least(tool, tip), expected);
    }
  }
}

// What the height maps answer, from the envelope cell by cell.
bool oracle_reaches(const HeightMap& envelope, const std::vector<ToolSection>& tool,
                    double narrowed, const Vec3& tip) {
  const HeightGrid& grid = envelope.grid;
  const auto column = std::floor((grid.frame.u.dot(tip) - grid.u0) / grid.pitch_mm + 0.5);
  const auto row = std::floor((grid.frame.v.dot(tip) - grid.v0) / grid.pitch_mm + 0.5);
  const double limit = tip.dot(grid.frame.d) + 1e-4;
  for (int j = 0; j < grid.rows; ++j) {
    for (int i = 0; i < grid.columns; ++i) {
      const double dx = i - column, dy = j - row;
      for (const ToolSection& section : tool) {
        const double radius = (section.r_from_mm + narrowed) / grid.pitch_mm;
        const bool under =
            std::isinf(radius) || (radius > 0 && dx * dx + dy * dy <= radius * radius - 1e-9);
        const float height = envelope.at(i, j) - static_cast<float>(section.z_from_mm);
        if (under && height > limit) return false;
      }
    }
  }
  return true;
}

TEST(Accessibility, ReachIsWhatEveryCellOfTheEnvelopeSays) {
  Dice dice(11);
  int reached = 0, blocked = 0;
  for (int round = 0; round < 8; ++round) {
    const TriangleMesh solid = together(pillars(dice));
    const TriangleMesh* obstacles[] = {&solid};
    const ToolBodies tools{1.5, random_tool(dice), random_tool(dice)};
    const Vec3 direction = dice.direction();
    constexpr double kPitch = 0.5;
    std::vector<Vec3> points;
    for (int k = 0; k < 40; ++k) points.push_back(dice.point(12));
    const DirectionalReach reach(direction, obstacles, points, tools, kPitch);
    std::vector<Vec3> extent = points;
    extent.insert(extent.end(), solid.vertices.begin(), solid.vertices.end());
    const HeightMap envelope = upper_envelope(
        HeightGrid::over(Frame::along(direction), kPitch, extent, 2 * tools.ball_radius_mm), solid,
        Sampling::kCentres);
    for (const Vec3& point : points) {
      const bool nozzle = oracle_reaches(envelope, tools.nozzle, -0.71 * kPitch, point);
      EXPECT_EQ(reach.nozzle_reaches(point), nozzle);
      const Vec3 tip = point - tools.ball_radius_mm * direction;
      const bool cutter =
          tip.z() >= -1e-6 && oracle_reaches(envelope, tools.cutter, -0.71 * kPitch, tip);
      EXPECT_EQ(reach.cutter_reaches(point), cutter);
      ++(nozzle ? reached : blocked);
    }
  }
  EXPECT_GT(reached, 20);
  EXPECT_GT(blocked, 20);
}

TEST(Accessibility, WhatAShortToolReachesALongerOneReaches) {
  Dice dice(13);
  const TriangleMesh solid = together(pillars(dice));
  const VoxelSet samples = sample(solid, VoxelGrid::over(bounds(solid), 1.3));
  for (int look = 0; look < 200; ++look) {
    auto sections = random_tool(dice);
    const ToolProfile tool(sections, 0, 0);
    for (ToolSection& section : sections) {
      if (&section != &sections.front()) section.z_from_mm += dice.in(0, 10);
    }
    sections[2].z_from_mm = std::max(sections[2].z_from_mm, sections[1].z_from_mm);
    const ToolProfile longer(sections, 0, 0);
    EXPECT_TRUE(longer.within(tool));
    const DirectedSamples along(samples, dice.direction());
    const Vec3 tip = dice.point(14);
    BitSet more = along.find(longer, tip);
    more.subtract(along.find(tool, tip));
    EXPECT_FALSE(more.any());
  }
}

TEST(RunGraph, FloodsAsSampleBySample) {
  Dice dice(17);
  for (int round = 0; round < 6; ++round) {
    // Longer than one run holds, with holes.
    const TriangleMesh solid = make_box({0, 0, 0}, {150, 6, 5});
    const VoxelSet samples = sample(solid, VoxelGrid::over(bounds(solid), 1));
    const RunGraph runs(samples);
    BitSet allowed(samples.size());
    for (std::uint32_t i = 0; i < samples.size(); ++i) {
      if (dice.in(0, 1) < 0.45) allowed.set(i);
    }
    std::vector<std::uint32_t> seeds;
    for (std::uint32_t i = 0; i < 200; i += 7) seeds.push_back(i);
    EXPECT_TRUE(runs.flood_faces(runs.seeds_at(seeds), allowed) ==
                flood(samples, seeds, allowed, Connectivity::kFaces));
    const Plane plane = Plane::through(dice.point(80), dice.direction());
    BitSet near(samples.size()), beyond(samples.size());
    for (std::uint32_t i = 0; i < samples.size(); ++i) {
      const double above = plane.signed_distance(samples.points[i]);
      if (above > -0.8) near.set(i);
      if (above > 0) beyond.set(i);
    }
    BitSet expected = flood(samples, seeds, near, Connectivity::kCorners);
    expected &= beyond;
    EXPECT_TRUE(runs.flood_beyond(runs.seeds_at(seeds), plane, 0.8) == expected);
  }
}

}  // namespace
}  // namespace reforge
