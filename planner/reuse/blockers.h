// Which samples of V~_R stand in the way of a tool: the edges of the collision dependency graph
// G_cd (paper.md, appendix B), as bit sets.
//
// A tool is a stack of cylinders that only widens upwards (height_map.h); above the first section
// of
//   infinite radius everything is in the way. Cones count at their wider end.
// Units: mm, part frame. Limits: obstacles are sample points; bodies are therefore widened by the
// caller.
#pragma once

#include <span>
#include <vector>

#include "planner/geometry/bit_set.h"
#include "planner/geometry/height_map.h"
#include "planner/geometry/voxel_set.h"
#include "protocols/rig.h"

namespace reforge {

// A set of samples, by the words of a BitSet that are not empty.
struct Blockers {
  struct Word {
    std::uint32_t index;
    std::uint64_t bits;
  };
  std::vector<Word> words;

  Blockers() = default;
  explicit Blockers(const BitSet& set);
  bool any() const { return !words.empty(); }
  // Whether all of them have been taken away.
  bool clear(const BitSet& taken) const {
    for (const Word& word : words) {
      if (word.bits & ~taken.words[word.index]) return false;
    }
    return true;
  }
};

// A tool as its steps: what is farther than `from` above the tip and nearer than the root of
// `square` to the axis is in the way.
struct ToolProfile {
  struct Step {
    float from, square;  // mm, mm^2
  };
  std::vector<Step> steps;      // ascending in both
  float infinite_from = 1e30f;  // above it everything is in the way
  float widest = 0;             // of the finite steps

  // Radii grow by `widen`; every step but the first begins `lower` nearer to the tip.
  ToolProfile(std::span<const ToolSection> sections, double widen, double lower);
  bool holds(float height, float square) const {
    if (height > infinite_from) return true;
    for (std::size_t k = steps.size(); k-- > 0;) {
      if (height > steps[k].from) return square < steps[k].square;
    }
    return false;
  }
  // Whether whatever is in this tool's way is in the other's as well.
  bool within(const ToolProfile& other) const;
};

// The samples in order of height along one direction.
class DirectedSamples {
 public:
  DirectedSamples(const VoxelSet& samples, const Vec3& direction);

  const Frame& frame() const { return frame_; }
  // At least so many are in the way of a tool with its tip there; cheap.
  std::size_t least(const ToolProfile& tool, const Vec3& tip) const;
  // How many; counting ends beyond `most`.
  std::size_t count(const ToolProfile& tool, const Vec3& tip, std::size_t most) const;
  BitSet find(const ToolProfile& tool, const Vec3& tip) const;

 private:
  std::size_t above(float height) const;
  template <typename Visit>
  void visit_finite(const ToolProfile& tool, const Vec3& local, Visit visit) const;

  Frame frame_;
  std::vector<float> u_, v_, h_;
  std::vector<std::uint32_t> number_;
};

}  // namespace reforge
