// Connectivity of a solid's sample points, run by run: up to 64 neighbours along x are one word.
//
// Floods as flood() in voxel_set.h does, about ten times faster: within a run by carries, from run
// to run by shifts. Invariants: runs are maximal but for their greatest length; numbers of a run's
// points are consecutive. Units: mm, part frame.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/geometry/bit_set.h"
#include "planner/geometry/plane.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {

class RunGraph {
 public:
  struct Seed {  // points of one run
    std::uint32_t run;
    std::uint64_t bits;
  };
  explicit RunGraph(const VoxelSet& set);

  std::vector<Seed> seeds_at(const std::vector<std::uint32_t>& numbers) const;
  // What hangs together with the seeds by faces within `allowed`.
  BitSet flood_faces(const std::vector<Seed>& seeds, const BitSet& allowed) const;
  // The points beyond the plane that hang together with the seeds, by corners, through points no
  // deeper than `thin` below it.
  BitSet flood_beyond(const std::vector<Seed>& seeds, const Plane& plane, double thin) const;

 private:
  struct Run {
    std::uint32_t first;  // its first point
    std::uint32_t length;
    Eigen::Vector3f start;                   // where that is
    std::uint32_t faces_begin, links_begin;  // into links_; face links come first
    std::uint32_t links_end;
  };
  struct Link {
    std::uint32_t run;
    std::int32_t shift;  // bit b here is bit b + shift there
  };
  std::uint64_t bits_of(const Run& run, const BitSet& set) const;
  static void add_bits(const Run& run, std::uint64_t bits, BitSet& set);

  std::size_t size_ = 0;
  float pitch_ = 1;
  std::vector<Run> runs_;
  std::vector<Link> links_;
  std::vector<std::uint32_t> run_of_;  // by point
};

}  // namespace reforge
