#include "planner/toolpath/slicing.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace reforge {
namespace {

using EdgeName = std::pair<std::uint32_t, std::uint32_t>;

// Vertices exactly at the height count as above it, so every triangle is crossed at two edges or
// none.
class Section {
 public:
  Section(const std::vector<Vec3>& at, double height) : at_(at), height_(height) {}

  void add(const std::array<std::uint32_t, 3>& t) {
    int below = 0;
    for (const auto v : t) below += at_[v].z() < height_;
    if (below == 0 || below == 3) return;
    EdgeName in{}, out{};
    for (int i = 0; i < 3; ++i) {
      const auto a = t[i], b = t[(i + 1) % 3];
      const bool a_below = at_[a].z() < height_, b_below = at_[b].z() < height_;
      // Seen from outside the edge that rises comes last: the inside stays on the left.
      if (a_below && !b_below) in = std::minmax(a, b);
      if (!a_below && b_below) out = std::minmax(a, b);
    }
    next_.emplace(out, in);
  }

  PlaneRegion close() {
    std::vector<Polyline> rings;
    while (!next_.empty()) {
      Polyline ring;
      EdgeName edge = next_.begin()->first;
      for (auto link = next_.find(edge); link != next_.end(); link = next_.find(edge)) {
        ring.push_back(crossing(edge));
        edge = link->second;
        next_.erase(link);
      }
      if (ring.size() > 2) rings.push_back(std::move(ring));
    }
    return united(rings);
  }

 private:
  Vec2 crossing(const EdgeName& edge) const {
    const Vec3 &a = at_[edge.first], &b = at_[edge.second];
    const double t = (height_ - a.z()) / (b.z() - a.z());
    return (a + t * (b - a)).head<2>();
  }

  const std::vector<Vec3>& at_;
  double height_;
  std::multimap<EdgeName, EdgeName> next_;
};

std::vector<Vec3> in_frame(const TriangleMesh& solid, const Frame& frame) {
  std::vector<Vec3> at;
  at.reserve(solid.vertices.size());
  for (const Vec3& v : solid.vertices) at.push_back(frame.to_local(v));
  return at;
}

}  // namespace

Slices slice(const TriangleMesh& solid, const Frame& frame, double layer_height_mm) {
  Slices slices;
  slices.layer_height = layer_height_mm;
  if (solid.empty()) return slices;
  const std::vector<Vec3> at = in_frame(solid, frame);
  double low = 1e300, high = -1e300;
  for (const auto& t : solid.triangles) {
    for (const auto v : t) {
      low = std::min(low, at[v].z());
      high = std::max(high, at[v].z());
    }
  }
  slices.base = low;
  const int count = std::max(1, static_cast<int>(std::ceil((high - low) / layer_height_mm - 0.5)));
  const auto middle = [&](int k) { return low + (k + 0.5) * layer_height_mm; };
  std::vector<Section> sections;
  for (int k = 0; k < count; ++k) sections.emplace_back(at, middle(k));
  for (const auto& t : solid.triangles) {
    const auto [bottom, top] = std::minmax({at[t[0]].z(), at[t[1]].z(), at[t[2]].z()});
    const int first =
        std::max(0, static_cast<int>(std::floor((bottom - low) / layer_height_mm - 0.5)));
    for (int k = first; k < count && middle(k) <= top; ++k) sections[k].add(t);
  }
  for (Section& s : sections) slices.layers.push_back(s.close());
  return slices;
}

PlaneRegion section(const TriangleMesh& solid, const Frame& frame, double height) {
  const std::vector<Vec3> at = in_frame(solid, frame);
  Section cut(at, height);
  for (const auto& t : solid.triangles) cut.add(t);
  return cut.close();
}

}  // namespace reforge
