#include "planner/geometry/mesh_topology.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <unordered_map>

#include "planner/geometry/mesh_parsers.h"

namespace reforge {
namespace {

struct HalfEdge {
  std::uint32_t low, high;  // vertices, low < high
  std::uint32_t triangle;
  bool forward;  // the triangle runs from low to high
};

// Sorted by edge, so that the triangles of one edge stand together.
std::vector<HalfEdge> half_edges(const TriangleMesh& mesh) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const auto a = mesh.triangles[t][k], b = mesh.triangles[t][(k + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), t, a < b});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& x, const HalfEdge& y) {
    return std::tie(x.low, x.high, x.triangle) < std::tie(y.low, y.high, y.triangle);
  });
  return edges;
}

template <typename Visit>  // visit(first, last) for each edge
void for_edges(const std::vector<HalfEdge>& edges, Visit visit) {
  for (std::size_t from = 0; from < edges.size();) {
    std::size_t to = from + 1;
    while (to < edges.size() && edges[to].low == edges[from].low &&
           edges[to].high == edges[from].high) {
      ++to;
    }
    visit(from, to);
    from = to;
  }
}

// Renumbers vertices by `to`, dropping collapsed triangles and unused vertices.
TriangleMesh renumbered(const TriangleMesh& mesh, const std::vector<std::uint32_t>& to) {
  constexpr auto kUnused = std::numeric_limits<std::uint32_t>::max();
  TriangleMesh result;
  std::vector<std::uint32_t> number(mesh.vertices.size(), kUnused);
  for (const auto& [a, b, c] : mesh.triangles) {
    std::array<std::uint32_t, 3> triangle{to[a], to[b], to[c]};
    if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0])
      continue;
    for (auto& vertex : triangle) {
      if (number[vertex] == kUnused) {
        number[vertex] = static_cast<std::uint32_t>(result.vertices.size());
        result.vertices.push_back(mesh.vertices[vertex]);
      }
      vertex = number[vertex];
    }
    result.triangles.push_back(triangle);
  }
  return result;
}

std::uint32_t root_of(std::vector<std::uint32_t>& parent, std::uint32_t x) {
  while (parent[x] != x) x = parent[x] = parent[parent[x]];
  return x;
}

}  // namespace

TriangleMesh welded(const TriangleMesh& mesh) {
  std::vector<Vec3> corners;
  corners.reserve(3 * mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    for (const auto vertex : triangle) corners.push_back(mesh.vertices[vertex]);
  }
  const TriangleMesh indexed = mesh_parsers::index_corners(corners);
  std::vector<std::uint32_t> same(indexed.vertices.size());
  std::iota(same.begin(), same.end(), 0u);
  return renumbered(indexed, same);
}

TriangleMesh welded_within(const TriangleMesh& mesh, double within_mm) {
  const auto cell_of = [within_mm](const Vec3& point) {
    return Eigen::Array3d((point / within_mm).array().floor());
  };
  const auto hash_of = [](const Eigen::Array3d& cell) {
    const auto part = [&](int k) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[k]));
    };
    return part(0) * 0x9E3779B97F4A7C15u ^ part(1) * 0xBF58476D1CE4E5B9u ^
           part(2) * 0x94D049BB133111EBu;
  };
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> kept;  // by cell; looked up only
  std::vector<std::uint32_t> to(mesh.vertices.size());
  for (std::uint32_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vec3& point = mesh.vertices[i];
    auto match = i;
    for (int n = 0; n < 27; ++n) {
      const Eigen::Array3d near =
          cell_of(point) + Eigen::Array3d(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
      const auto bucket = kept.find(hash_of(near));
      if (bucket == kept.end()) continue;
      for (const auto other : bucket->second) {
        if (other < match && (mesh.vertices[other] - point).norm() < within_mm) match = other;
      }
    }
    to[i] = match;
    if (match == i) kept[hash_of(cell_of(point))].push_back(i);
  }
  return renumbered(mesh, to);
}

TriangleMesh without_duplicates(const TriangleMesh& mesh) {
  std::vector<std::pair<std::array<std::uint32_t, 3>, std::size_t>> keys;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    auto key = mesh.triangles[t];
    std::rotate(key.begin(), std::min_element(key.begin(), key.end()), key.end());
    keys.emplace_back(key, t);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<bool> drop(mesh.triangles.size(), false);
  for (std::size_t i = 1; i < keys.size(); ++i)
    drop[keys[i].second] = keys[i].first == keys[i - 1].first;
  TriangleMesh result;
  result.vertices = mesh.vertices;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!drop[t]) result.triangles.push_back(mesh.triangles[t]);
  }
  return result;
}

EdgeFaults edge_faults(const TriangleMesh& mesh) {
  EdgeFaults faults;
  std::optional<Vec3> first_crowded;
  const auto edges = half_edges(mesh);
  for_edges(edges, [&](std::size_t from, std::size_t to) {
    const Vec3 middle = (mesh.vertices[edges[from].low] + mesh.vertices[edges[from].high]) / 2;
    if (to - from == 1) {
      if (faults.open++ == 0) faults.first = middle;
    } else if (to - from > 2) {
      if (faults.crowded++ == 0) first_crowded = middle;
    } else if (edges[from].forward == edges[from + 1].forward) {
      ++faults.against;
    }
  });
  if (!faults.first) faults.first = first_crowded;
  return faults;
}

bool is_closed(const TriangleMesh& mesh) {
  const auto edges = half_edges(mesh);
  bool closed = true;
  for_edges(edges, [&](std::size_t from, std::size_t to) {
    int balance = 0;
    for (std::size_t i = from; i < to; ++i) balance += edges[i].forward ? 1 : -1;
    closed = closed && balance == 0;
  });
  return closed;
}

std::optional<Vec3> pinched_vertex(const TriangleMesh& mesh) {
  // Corners (triangle, k) around one vertex are joined across shared edges; one set left is one
  // fan.
  std::vector<std::uint32_t> parent(3 * mesh.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto corner_at = [&](std::uint32_t triangle, std::uint32_t vertex) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (mesh.triangles[triangle][k] == vertex) return 3 * triangle + k;
    }
    assert(false);
    return 3 * triangle;
  };
  const auto edges = half_edges(mesh);
  for_edges(edges, [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from + 1; i < to; ++i) {
      for (const auto vertex : {edges[from].low, edges[from].high}) {
        const auto a = root_of(parent, corner_at(edges[from].triangle, vertex));
        const auto b = root_of(parent, corner_at(edges[i].triangle, vertex));
        parent[std::max(a, b)] = std::min(a, b);
      }
    }
  });
  constexpr auto kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> fan(mesh.vertices.size(), kNone);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      const auto vertex = mesh.triangles[t][k];
      const auto root = root_of(parent, 3 * t + k);
      if (fan[vertex] == kNone) fan[vertex] = root;
      if (fan[vertex] != root) return mesh.vertices[vertex];
    }
  }
  return std::nullopt;
}

std::vector<std::uint32_t> pieces(const TriangleMesh& mesh, std::uint32_t& count) {
  std::vector<std::uint32_t> parent(mesh.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto edges = half_edges(mesh);
  for_edges(edges, [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from + 1; i < to; ++i) {
      const auto a = root_of(parent, edges[from].triangle), b = root_of(parent, edges[i].triangle);
      parent[std::max(a, b)] = std::min(a, b);
    }
  });
  count = 0;
  std::vector<std::uint32_t> piece(mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto root = root_of(parent, t);  // the lowest of its piece, so root <= t
    piece[t] = root == t ? count++ : piece[root];
  }
  return piece;
}

std::vector<TriangleMesh> split_pieces(const TriangleMesh& mesh) {
  std::uint32_t count = 0;
  const auto piece = pieces(mesh, count);
  std::vector<TriangleMesh> parts(count);
  std::vector<std::uint32_t> same(mesh.vertices.size());
  std::iota(same.begin(), same.end(), 0u);
  std::vector<std::vector<std::array<std::uint32_t, 3>>> triangles(count);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    triangles[piece[t]].push_back(mesh.triangles[t]);
  TriangleMesh part;
  part.vertices = mesh.vertices;
  for (std::uint32_t p = 0; p < count; ++p) {
    part.triangles = std::move(triangles[p]);
    parts[p] = renumbered(part, same);
  }
  return parts;
}

std::optional<std::size_t> orient(TriangleMesh& mesh) {
  struct Link {
    std::uint32_t triangle;
    bool agrees;
  };
  std::vector<std::vector<Link>> links(mesh.triangles.size());
  const auto edges = half_edges(mesh);
  for_edges(edges, [&](std::size_t from, std::size_t to) {
    assert(to - from == 2);
    if (to - from != 2) return;
    const bool agrees = edges[from].forward != edges[from + 1].forward;
    links[edges[from].triangle].push_back({edges[from + 1].triangle, agrees});
    links[edges[from + 1].triangle].push_back({edges[from].triangle, agrees});
  });
  enum : std::uint8_t { kUnseen, kKept, kTurned };
  std::vector<std::uint8_t> state(mesh.triangles.size(), kUnseen);
  std::size_t turned = 0;
  for (std::uint32_t start = 0; start < mesh.triangles.size(); ++start) {
    if (state[start] != kUnseen) continue;
    std::vector<std::uint32_t> piece{start};
    state[start] = kKept;
    std::size_t turned_here = 0;
    for (std::size_t next = 0; next < piece.size(); ++next) {
      const auto t = piece[next];
      for (const Link& link : links[t]) {
        const auto wanted = (state[t] == kKept) == link.agrees ? kKept : kTurned;
        if (state[link.triangle] == kUnseen) {
          state[link.triangle] = wanted;
          turned_here += wanted == kTurned;
          piece.push_back(link.triangle);
        } else if (state[link.triangle] != wanted) {
          return std::nullopt;
        }
      }
    }
    // The majority was right, or (inside out as a whole) the caller turns all by its volume.
    const bool majority_turned = 2 * turned_here > piece.size();
    for (const auto t : piece) {
      if ((state[t] == kTurned) != majority_turned) {
        std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
        ++turned;
      }
    }
  }
  return turned;
}

TriangleMesh flipped(TriangleMesh mesh) {
  for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  return mesh;
}

TriangleMesh joined(const TriangleMesh& a, const TriangleMesh& b) {
  TriangleMesh result = a;
  const auto shift = static_cast<std::uint32_t>(a.vertices.size());
  result.vertices.insert(result.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& [i, j, k] : b.triangles)
    result.triangles.push_back({i + shift, j + shift, k + shift});
  return result;
}

bool contains(const TriangleMesh& solid, const Vec3& point) {
  // The solid angle under which the surface is seen: 4 pi inside, 0 outside (Van Oosterom,
  // Strackee).
  double angle = 0;
  for (const auto& triangle : solid.triangles) {
    const Vec3 a = solid.vertices[triangle[0]] - point, b = solid.vertices[triangle[1]] - point,
               c = solid.vertices[triangle[2]] - point;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)),
                            la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return angle > 2 * M_PI;
}

}  // namespace reforge
