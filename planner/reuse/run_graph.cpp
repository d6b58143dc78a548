#include "planner/reuse/run_graph.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace reforge {
namespace {

constexpr std::uint32_t kLongest = 64;

std::uint64_t lowest(std::uint32_t count) {
  return count >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1;
}

std::uint64_t shifted(std::uint64_t bits, int by) {
  if (by >= 64 || by <= -64) return 0;
  return by >= 0 ? bits << by : bits >> -by;
}

// All of `allowed` that hangs together with `bits`, a part of it, in one line.
std::uint64_t spread(std::uint64_t bits, std::uint64_t allowed) {
  bits |= allowed & ~(allowed + bits);  // upwards: the carry runs to the end of the line
  std::uint64_t open = allowed;
  for (int step = 1; step < 64; step *= 2) {
    bits |= open & (bits >> step);
    open &= open >> step;
  }
  return bits;
}

}  // namespace

RunGraph::RunGraph(const VoxelSet& set)
    : size_(set.size()), pitch_(static_cast<float>(set.grid.pitch_mm)), run_of_(set.size()) {
  for (std::uint32_t i = 0; i < set.size(); ++i) {
    const auto& [x, y, z] = set.voxels[i];
    const bool continues = i > 0 && runs_.back().length < kLongest &&
                           set.voxels[i - 1] == std::array<int, 3>{x - 1, y, z};
    if (!continues) runs_.push_back({i, 0, set.points[i].cast<float>(), 0, 0, 0});
    ++runs_.back().length;
    run_of_[i] = static_cast<std::uint32_t>(runs_.size() - 1);
  }
  // Links: face neighbours first, then those that touch by edges and corners only.
  for (std::uint32_t r = 0; r < runs_.size(); ++r) {
    Run& run = runs_[r];
    const int column = set.voxels[run.first][0];
    const auto collect = [&](std::size_t from, std::size_t to, auto skip) {
      std::vector<std::uint32_t> found;
      for (std::uint32_t i = run.first; i < run.first + run.length; ++i) {
        for (std::size_t n = from; n < to; ++n) {
          const auto next = set.neighbours[i][n];
          if (next < 0) continue;
          const auto other = run_of_[static_cast<std::size_t>(next)];
          if (other != r && !skip(other)) found.push_back(other);
        }
      }
      std::sort(found.begin(), found.end());
      found.erase(std::unique(found.begin(), found.end()), found.end());
      for (const auto other : found) {
        links_.push_back({other, column - set.voxels[runs_[other].first][0]});
      }
    };
    run.faces_begin = static_cast<std::uint32_t>(links_.size());
    collect(0, 6, [](std::uint32_t) { return false; });
    run.links_begin = static_cast<std::uint32_t>(links_.size());
    collect(6, 26, [&](std::uint32_t other) {
      return std::any_of(links_.begin() + run.faces_begin, links_.begin() + run.links_begin,
                         [&](const Link& link) { return link.run == other; });
    });
    run.links_end = static_cast<std::uint32_t>(links_.size());
  }
}

std::uint64_t RunGraph::bits_of(const Run& run, const BitSet& set) const {
  const auto word = run.first / 64, offset = run.first % 64;
  std::uint64_t bits = set.words[word] >> offset;
  if (offset + run.length > 64) bits |= set.words[word + 1] << (64 - offset);
  return bits & lowest(run.length);
}

void RunGraph::add_bits(const Run& run, std::uint64_t bits, BitSet& set) {
  const auto word = run.first / 64, offset = run.first % 64;
  set.words[word] |= bits << offset;
  if (offset + run.length > 64) set.words[word + 1] |= bits >> (64 - offset);
}

std::vector<RunGraph::Seed> RunGraph::seeds_at(const std::vector<std::uint32_t>& numbers) const {
  std::map<std::uint32_t, std::uint64_t> bits;
  for (const auto number : numbers) {
    const auto r = run_of_[number];
    bits[r] |= std::uint64_t{1} << (number - runs_[r].first);
  }
  std::vector<Seed> seeds;
  for (const auto& [run, some] : bits) seeds.push_back({run, some});
  return seeds;
}

BitSet RunGraph::flood_faces(const std::vector<Seed>& seeds, const BitSet& allowed) const {
  std::vector<std::uint64_t> left(runs_.size());  // allowed and not yet reached
  for (std::size_t r = 0; r < runs_.size(); ++r) left[r] = bits_of(runs_[r], allowed);
  BitSet reached(size_);
  std::vector<Seed> front;
  const auto visit = [&](std::uint32_t r, std::uint64_t bits) {
    bits &= left[r];
    if (!bits) return;
    bits = spread(bits, left[r]);
    left[r] &= ~bits;
    front.push_back({r, bits});
  };
  for (const auto& [run, bits] : seeds) visit(run, bits);
  while (!front.empty()) {
    const auto [r, bits] = front.back();
    front.pop_back();
    const Run& run = runs_[r];
    add_bits(run, bits, reached);
    for (std::uint32_t k = run.faces_begin; k < run.links_begin; ++k) {
      const Link& link = links_[k];
      // In the same line one follows the other.
      const bool in_line = link.shift == static_cast<std::int32_t>(kLongest) ||
                           link.shift == -static_cast<std::int32_t>(kLongest);
      if (in_line) {
        visit(link.run, link.shift > 0 ? std::uint64_t{bits & 1} << 63 : bits >> 63);
      } else {
        visit(link.run, shifted(bits, link.shift));
      }
    }
  }
  return reached;
}

BitSet RunGraph::flood_beyond(const std::vector<Seed>& seeds, const Plane& plane,
                              double thin) const {
  const Eigen::Vector3f normal = plane.normal.cast<float>();
  const auto offset = static_cast<float>(plane.offset);
  const float step = normal.x() * pitch_;
  // The points of a run more than `height` above the plane.
  const auto above = [&](const Run& run, float height) -> std::uint64_t {
    const float at_first = normal.dot(run.start) - offset - height;
    if (std::abs(step) < 1e-7f) return at_first > 0 ? lowest(run.length) : 0;
    const float crossing = -at_first / step;  // in points from the first
    const auto length = static_cast<float>(run.length);
    if (step > 0) {
      if (crossing < 0) return lowest(run.length);
      if (crossing >= length) return 0;
      return lowest(run.length) & ~lowest(static_cast<std::uint32_t>(crossing) + 1);
    }
    if (crossing <= 0) return 0;
    if (crossing >= length) return lowest(run.length);
    return lowest(std::min(run.length, static_cast<std::uint32_t>(std::ceil(crossing))));
  };
  const auto below = static_cast<float>(-thin);
  std::vector<std::uint64_t> left(runs_.size());
  std::vector<bool> known(runs_.size(), false);
  BitSet taken(size_);
  std::vector<Seed> front;
  const auto visit = [&](std::uint32_t r, std::uint64_t bits) {
    if (!known[r]) {
      known[r] = true;
      left[r] = above(runs_[r], below);
    }
    bits &= left[r];
    if (!bits) return;
    bits = spread(bits, left[r]);
    left[r] &= ~bits;
    front.push_back({r, bits});
  };
  for (const auto& [run, bits] : seeds) visit(run, bits);
  while (!front.empty()) {
    const auto [r, bits] = front.back();
    front.pop_back();
    const Run& run = runs_[r];
    const std::uint64_t beyond = bits & above(run, 0);
    if (beyond) add_bits(run, beyond, taken);
    for (std::uint32_t k = run.faces_begin; k < run.links_end; ++k) {
      const Link& link = links_[k];
      visit(link.run, shifted(bits, link.shift) | shifted(bits, link.shift + 1) |
                          shifted(bits, link.shift - 1));
    }
  }
  return taken;
}

}  // namespace reforge
