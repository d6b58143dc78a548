// The smallest pair that is milled and printed: a block of 12 x 12 x 8 mm that becomes a step, one
// half a millimetre lower, the other a millimetre higher. Planned by the real planner in seconds.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "tests/rig/scratch_folder.h"
#include "tests/scenarios/process.h"
#include "tests/support/job_folder.h"

namespace reforge::testing {

using Profile = std::vector<std::pair<float, float>>;  // x, z; anticlockwise

// The profile drawn out along y, from 0 to `depth`, as binary STL.
inline std::string extruded(const Profile& profile,
                            const std::vector<std::array<std::size_t, 3>>& faces, float depth) {
  std::string body;
  std::uint32_t count = 0;
  using Point = std::array<float, 3>;
  const auto at = [&](std::size_t i, float y) {
    return Point{profile[i].first, y, profile[i].second};
  };
  const auto add = [&](const Point& a, const Point& b, const Point& c) {
    std::array<char, 50> record{};  // the readers do without normals
    for (std::size_t k = 0; k < 3; ++k) {
      std::memcpy(record.data() + 12 + 4 * k, &a[k], 4);
      std::memcpy(record.data() + 24 + 4 * k, &b[k], 4);
      std::memcpy(record.data() + 36 + 4 * k, &c[k], 4);
    }
    body.append(record.data(), record.size());
    ++count;
  };
  for (const auto& [a, b, c] : faces) {
    add(at(a, 0), at(b, 0), at(c, 0));
    add(at(a, depth), at(c, depth), at(b, depth));
  }
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const std::size_t j = (i + 1) % profile.size();
    add(at(i, 0), at(i, depth), at(j, depth));
    add(at(i, 0), at(j, depth), at(j, 0));
  }
  std::string out(84, '\0');
  std::memcpy(out.data() + 80, &count, 4);
  return out + body;
}

inline void write_tiny_pair(const std::filesystem::path& initial,
                            const std::filesystem::path& target) {
  write_file(initial, extruded({{0, 0}, {12, 0}, {12, 8}, {0, 8}}, {{0, 1, 2}, {0, 2, 3}}, 12));
  write_file(target, extruded({{0, 0}, {12, 0}, {12, 7}, {6, 7}, {6, 9}, {0, 9}},
                              {{0, 1, 3}, {1, 2, 3}, {0, 3, 5}, {3, 4, 5}}, 12));
}

// The pair's job, planned once for the tests of one process.
inline const std::filesystem::path& planned_job() {
  static const ScratchFolder scratch;
  static const std::filesystem::path job = [] {
    const std::filesystem::path here = scratch.path;
    write_tiny_pair(here / "initial.stl", here / "target.stl");
    Process plan({REFORGE_CLI, "plan", (here / "initial.stl").string(),
                  (here / "target.stl").string(), "-o", (here / "job").string(), "--rig",
                  shipped_rig_file().string(), "--effort", "fast", "--setup", "stored"},
                 {}, here / "plan.log");
    const auto end = plan.end_within(240);
    EXPECT_TRUE(end == 0) << read_file(here / "plan.log");
    return here / "job";
  }();
  return job;
}

}  // namespace reforge::testing
