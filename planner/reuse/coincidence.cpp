#include "planner/reuse/coincidence.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <map>
#include <optional>

#include "planner/geometry/triangle_tree.h"

namespace reforge {
namespace {

constexpr double kFacing = 0.9;          // cosine between normals of one surface, 26 degrees
constexpr double kFacingNear = 0.995;    // the same for contacts seen only close to a corner
constexpr double kClearance = 1. / 200;  // of the tolerance
constexpr double kLongest = 6;           // greatest move at a sharp edge, in hairs

enum class Contact : std::uint8_t { kNone, kSame, kOpposite };

struct Touch {
  Contact contact = Contact::kNone;
  double distance = 0;  // along the normal, mm
};

const Vec3& corner(const TriangleMesh& mesh, std::size_t t, int k) {
  return mesh.vertices[mesh.triangles[t][k]];
}
Vec3 centre(const TriangleMesh& mesh, std::size_t t) {
  return (corner(mesh, t, 0) + corner(mesh, t, 1) + corner(mesh, t, 2)) / 3;
}
double area_of(const TriangleMesh& mesh, std::size_t t) {
  return (corner(mesh, t, 1) - corner(mesh, t, 0))
             .cross(corner(mesh, t, 2) - corner(mesh, t, 0))
             .norm() /
         2;
}

// Whether another surface lies within reach of a point that has this normal. The distance is along
// the normal: beside a rim the other surface goes on at the same height.
Touch touch(const TriangleTree& other, const Vec3& point, const Vec3& normal, double reach,
            double cosine, std::uint32_t* triangle = nullptr) {
  for (const auto contact : {Contact::kSame, Contact::kOpposite}) {
    const Vec3 direction = contact == Contact::kSame ? normal : Vec3(-normal);
    if (const auto found = other.closest_facing(point, reach, {direction, cosine})) {
      if (triangle) *triangle = found->triangle;
      return {contact, std::abs((found->point - point).dot(normal))};
    }
  }
  return {};
}

// Whether the surface around a corner of a triangle, on that triangle's side, lies on the other.
Touch corner_touch(const TriangleTree& other, const TriangleTree& self, std::uint32_t t, int k,
                   double tolerance) {
  const Vec3& normal = self.normal(t);
  const Vec3& tip = corner(self.mesh(), t, k);
  if (normal.isZero()) return {};
  const Vec3 inwards = centre(self.mesh(), t) - tip;
  const double length = inwards.norm();
  const auto both = [&](double into, double reach, double cosine) {
    const Touch at_tip = touch(other, tip, normal, reach, cosine);
    if (at_tip.contact == Contact::kNone) return Touch{};
    const Touch inside =
        touch(other, tip + std::min(0.5, into / length) * inwards, normal, reach, cosine);
    if (inside.contact != at_tip.contact) return Touch{};
    return Touch{at_tip.contact, std::max(at_tip.distance, inside.distance)};
  };
  const Touch far = both(5 * tolerance, tolerance, kFacing);
  if (far.contact != Contact::kNone) return far;
  const Touch near = both(tolerance, tolerance / 10, kFacingNear);
  return near.contact != Contact::kNone ? near : both(tolerance / 5, tolerance / 50, kFacingNear);
}

// For one mesh: contact of each corner (3 * triangle + k), how far the other surface is at most,
// and whether it was met at every point looked at.
struct Contacts {
  std::vector<Touch> corners;
  std::vector<double> distance;  // by triangle
  std::vector<bool> throughout;  // by triangle
};

std::array<Vec3, 4> inner_samples(const TriangleMesh& mesh, std::size_t t) {
  const Vec3 &a = corner(mesh, t, 0), &b = corner(mesh, t, 1), &c = corner(mesh, t, 2);
  return {(a + b + c) / 3, (a + b) / 2, (b + c) / 2, (c + a) / 2};
}

Contacts find_contacts(const TriangleTree& self, const TriangleTree& other, double tolerance) {
  const TriangleMesh& mesh = self.mesh();
  std::vector<bool> near(mesh.vertices.size());
  for (std::size_t v = 0; v < near.size(); ++v) {
    near[v] = other.closest(mesh.vertices[v], tolerance).has_value();
  }
  Contacts contacts;
  contacts.corners.assign(3 * mesh.triangles.size(), {});
  contacts.distance.assign(mesh.triangles.size(), 0);
  contacts.throughout.assign(mesh.triangles.size(), false);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    int met = 0;
    if (self.normal(t).isZero()) {  // a needle follows the triangles around it
      const auto& [a, b, c] = mesh.triangles[t];
      contacts.throughout[t] = near[a] && near[b] && near[c];
      for (const Vec3& at : inner_samples(mesh, t)) {
        if (!other.closest(at, tolerance)) contacts.throughout[t] = false;
      }
      continue;
    }
    for (int k = 0; k < 3; ++k) {
      if (!near[mesh.triangles[t][k]]) continue;
      const Touch found = corner_touch(other, self, t, k, tolerance);
      contacts.corners[3 * t + static_cast<std::uint32_t>(k)] = found;
      contacts.distance[t] = std::max(contacts.distance[t], found.distance);
      met += found.contact != Contact::kNone;
    }
    if (met == 0) continue;
    for (const Vec3& at : inner_samples(mesh, t)) {
      const Touch found = touch(other, at, self.normal(t), tolerance, kFacing);
      contacts.distance[t] = std::max(contacts.distance[t], found.distance);
      met += found.contact != Contact::kNone;
    }
    contacts.throughout[t] = met == 7;
  }
  return contacts;
}

// Points of the initial surface that lie on triangles of the target which are in contact only in
// part: inside, by triangle; on an edge (lower vertex first), by the way along it.
struct Insertions {
  std::map<std::uint32_t, std::vector<Vec3>> inside;
  std::map<std::array<std::uint32_t, 2>, std::vector<double>> on_edge;
};

// Notes a point for insertion. Nearer than the margin to a corner it is left out, nearer than that
// to an edge it goes onto the edge.
void note_point(Insertions& insertions, const TriangleMesh& mesh, std::uint32_t t,
                const Vec3& point, double margin) {
  for (int k = 0; k < 3; ++k) {
    if ((corner(mesh, t, k) - point).norm() < margin) return;
  }
  for (int k = 0; k < 3; ++k) {
    auto i = mesh.triangles[t][k], j = mesh.triangles[t][(k + 1) % 3];
    if (i > j) std::swap(i, j);
    const Vec3 along = mesh.vertices[j] - mesh.vertices[i];
    const double way = (point - mesh.vertices[i]).dot(along) / along.squaredNorm();
    if ((mesh.vertices[i] + way * along - point).norm() >= margin) continue;
    insertions.on_edge[{i, j}].push_back(way);
    return;
  }
  insertions.inside[t].push_back(point);
}

// Widens the target's distances by what the initial surface sees, and collects the points to
// insert.
Insertions see_from_initial(Contacts& contacts, const TriangleTree& target,
                            const TriangleTree& initial, const Contacts& of_initial,
                            double tolerance) {
  Insertions insertions;
  const TriangleMesh& mesh = initial.mesh();
  const auto note = [&](const Vec3& at, const Vec3& normal, bool insert) {
    std::uint32_t t = 0;
    const Touch found = touch(target, at, normal, tolerance, kFacing, &t);
    if (found.contact == Contact::kNone) return;
    contacts.distance[t] = std::max(contacts.distance[t], found.distance);
    if (!insert) return;
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (contacts.corners[3 * t + k].contact != Contact::kNone) continue;
      note_point(insertions, target.mesh(), t, at, tolerance);
      return;
    }
  };
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    bool any = false;
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (of_initial.corners[3 * t + k].contact == Contact::kNone) continue;
      note(corner(mesh, t, static_cast<int>(k)), initial.normal(t), true);
      any = true;
    }
    if (!any) continue;
    for (const Vec3& at : inner_samples(mesh, t)) note(at, initial.normal(t), false);
  }
  return insertions;
}

// The parts a triangle has been divided into, itself first.
using Parts = std::map<std::uint32_t, std::vector<std::uint32_t>>;

// Divides the edge of each triangle around it.
void insert_on_edges(TriangleMesh& mesh, const Insertions& insertions, double margin,
                     Parts& parts) {
  std::map<std::array<std::uint32_t, 2>, std::vector<std::uint32_t>> around;
  for (const auto& entry : insertions.on_edge) around[entry.first];
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const auto i = mesh.triangles[t][k], j = mesh.triangles[t][(k + 1) % 3];
      const auto found = around.find({std::min(i, j), std::max(i, j)});
      if (found != around.end()) found->second.push_back(t);
    }
  }
  for (const auto& [edge, unsorted] : insertions.on_edge) {
    auto ways = unsorted;
    std::sort(ways.begin(), ways.end());
    const Vec3 start = mesh.vertices[edge[0]], along = mesh.vertices[edge[1]] - start;
    auto last = edge[0];
    double last_way = 0;
    for (const double way : ways) {
      if ((way - last_way) * along.norm() < margin) continue;
      last_way = way;
      const auto created = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(start + way * along);
      for (const auto t : around.at(edge)) {
        auto& of_t = parts.try_emplace(t, 1, t).first->second;
        const auto has_edge = [&](std::uint32_t part) {
          const auto& corners = mesh.triangles[part];
          return std::count(corners.begin(), corners.end(), last) == 1 &&
                 std::count(corners.begin(), corners.end(), edge[1]) == 1;
        };
        const auto part = *std::find_if(of_t.begin(), of_t.end(), has_edge);
        auto rest = mesh.triangles[part];
        std::replace(mesh.triangles[part].begin(), mesh.triangles[part].end(), edge[1], created);
        std::replace(rest.begin(), rest.end(), last, created);
        of_t.push_back(static_cast<std::uint32_t>(mesh.triangles.size()));
        mesh.triangles.push_back(rest);
      }
      last = created;
    }
  }
}

double distance_to_edge(const TriangleMesh& mesh, std::uint32_t t, int k, const Vec3& p) {
  const Vec3 &a = corner(mesh, t, k), &b = corner(mesh, t, (k + 1) % 3);
  const Vec3 normal = (b - a).cross(corner(mesh, t, (k + 2) % 3) - a);
  return (b - a).cross(p - a).dot(normal) / (normal.norm() * (b - a).norm());
}

// Puts points into the parts of a triangle that they lie in, dividing them in three.
void insert_inside(TriangleMesh& mesh, std::vector<std::uint32_t>& parts,
                   const std::vector<Vec3>& points, double margin) {
  for (const Vec3& point : points) {
    for (const auto part : parts) {
      const double inside =
          std::min({distance_to_edge(mesh, part, 0, point), distance_to_edge(mesh, part, 1, point),
                    distance_to_edge(mesh, part, 2, point)});
      if (!(inside > margin)) continue;
      const Vec3 a = corner(mesh, part, 0);
      const Vec3 normal = (corner(mesh, part, 1) - a).cross(corner(mesh, part, 2) - a).normalized();
      const auto [i, j, k] = mesh.triangles[part];
      const auto created = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(point - (point - a).dot(normal) * normal);
      mesh.triangles[part] = {i, j, created};
      for (const auto& child : {std::array{j, k, created}, std::array{k, i, created}}) {
        parts.push_back(static_cast<std::uint32_t>(mesh.triangles.size()));
        mesh.triangles.push_back(child);
      }
      break;
    }
  }
}

void insert_points(TriangleMesh& mesh, const Insertions& insertions, double tolerance) {
  Parts parts;
  insert_on_edges(mesh, insertions, tolerance, parts);
  for (const auto& [t, points] : insertions.inside) {
    insert_inside(mesh, parts.try_emplace(t, 1, t).first->second, points, tolerance / 20);
  }
}

// At a vertex: move at least `hair` along `normal`, or (a slide) not at all along it.
struct Wish {
  Vec3 normal;
  double hair;
  bool slide;
};

// The shortest move that fulfils the wishes (Hildreth's method), nothing when they contradict.
std::optional<Vec3> shortest_move(const std::vector<Wish>& wishes, bool with_slides) {
  double longest = 0;
  for (const Wish& wish : wishes) longest = std::max(longest, wish.slide ? 0 : wish.hair);
  std::vector<double> weight(wishes.size(), 0);
  Vec3 move = Vec3::Zero();
  for (int sweep = 0; sweep < 200; ++sweep) {
    double change = 0;
    for (std::size_t i = 0; i < wishes.size(); ++i) {
      const Wish& wish = wishes[i];
      if (wish.slide && !with_slides) continue;
      double step = (wish.slide ? 0 : wish.hair) - wish.normal.dot(move);
      if (!wish.slide) step = std::max(step, -weight[i]);
      weight[i] += step;
      move += step * wish.normal;
      change = std::max(change, std::abs(step));
    }
    if (change < 1e-3 * longest) break;
    if (move.norm() > 2 * kLongest * longest) return std::nullopt;
  }
  for (const Wish& wish : wishes) {
    const double along = wish.normal.dot(move);
    if (wish.slide ? with_slides && std::abs(along) > 0.1 * longest : along < 0.9 * wish.hair) {
      return std::nullopt;
    }
  }
  if (move.norm() > kLongest * longest) return std::nullopt;
  return move;
}

Vec3 move_for(const std::vector<Wish>& wishes) {
  double longest = 0;
  Vec3 mean = Vec3::Zero();
  for (const Wish& wish : wishes) {
    if (wish.slide) continue;
    longest = std::max(longest, std::abs(wish.hair));
    mean += wish.hair * wish.normal;
  }
  if (longest == 0) return Vec3::Zero();
  if (const auto move = shortest_move(wishes, true)) return *move;
  if (const auto move = shortest_move(wishes, false)) return *move;
  return mean.isZero() ? mean : Vec3(2 * longest * mean.normalized());
}

// Triangles around each vertex, as corners (3 * triangle + k).
std::vector<std::vector<std::uint32_t>> corners_at(const TriangleMesh& mesh) {
  std::vector<std::vector<std::uint32_t>> at(mesh.vertices.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t k = 0; k < 3; ++k) at[mesh.triangles[t][k]].push_back(3 * t + k);
  }
  return at;
}

struct Moves {
  std::vector<Vec3> outward, inward;  // by vertex
};

Moves moves_for(const TriangleTree& tree, const Contacts& contacts, double tolerance) {
  const TriangleMesh& mesh = tree.mesh();
  Moves moves;
  moves.outward.assign(mesh.vertices.size(), Vec3::Zero());
  moves.inward = moves.outward;
  const auto around = corners_at(mesh);
  std::vector<std::uint32_t> without_opinion;
  std::vector<Wish> out, in;
  for (std::uint32_t v = 0; v < around.size(); ++v) {
    out.clear();
    in.clear();
    bool any = false, reliable = false;
    for (const auto c : around[v]) {
      const Vec3& normal = tree.normal(c / 3);
      if (normal.isZero()) continue;
      reliable = true;
      const Contact contact = contacts.corners[c].contact;
      const double hair = kClearance * tolerance + 1.25 * contacts.distance[c / 3];
      any = any || contact != Contact::kNone;
      switch (contact) {
        case Contact::kNone:
          out.push_back({normal, 0, true});
          in.push_back({normal, 0, true});
          break;
        case Contact::kSame:
          out.push_back({normal, hair, false});
          in.push_back({-normal, hair, false});
          break;
        case Contact::kOpposite:
          out.push_back({-normal, hair, false});
          in.push_back({-normal, hair, false});
          break;
      }
    }
    if (!reliable) without_opinion.push_back(v);
    if (!any) continue;
    moves.outward[v] = move_for(out);
    moves.inward[v] = move_for(in);
  }
  // A vertex with needles only around it goes with its neighbours.
  for (const auto v : without_opinion) {
    Vec3 outward = Vec3::Zero(), inward = Vec3::Zero();
    int count = 0;
    for (const auto c : around[v]) {
      for (const auto w : mesh.triangles[c / 3]) {
        if (moves.outward[w].isZero() && moves.inward[w].isZero()) continue;
        outward += moves.outward[w];
        inward += moves.inward[w];
        ++count;
      }
    }
    if (count == 0) continue;
    moves.outward[v] = outward / count;
    moves.inward[v] = inward / count;
  }
  return moves;
}

// Whether all corners of a triangle have been moved.
bool is_moved(const Moves& moves, const std::array<std::uint32_t, 3>& triangle) {
  return std::none_of(triangle.begin(), triangle.end(), [&](std::uint32_t v) {
    return moves.outward[v].isZero() || moves.inward[v].isZero();
  });
}

}  // namespace

Separation separate(const TriangleMesh& initial, const TriangleMesh& target, double tolerance_mm) {
  assert(tolerance_mm > 0);
  Separation result;
  result.target = target;
  const TriangleTree initial_tree(initial);
  Contacts contacts, of_initial;
  {
    const TriangleTree tree(target);
    contacts = find_contacts(tree, initial_tree, tolerance_mm);
    of_initial = find_contacts(initial_tree, tree, tolerance_mm);
    insert_points(result.target,
                  see_from_initial(contacts, tree, initial_tree, of_initial, tolerance_mm),
                  tolerance_mm);
  }
  const TriangleTree tree(result.target);
  if (result.target.triangles.size() > target.triangles.size()) {
    contacts = find_contacts(tree, initial_tree, tolerance_mm);
    see_from_initial(contacts, tree, initial_tree, of_initial, tolerance_mm);
  }
  result.initial_settled = of_initial.throughout;
  const Moves moves = moves_for(tree, contacts, tolerance_mm);
  result.target_settled.resize(result.target.triangles.size());
  for (std::uint32_t t = 0; t < result.target_settled.size(); ++t) {
    result.target_settled[t] =
        contacts.throughout[t] && is_moved(moves, result.target.triangles[t]);
  }
  result.grown = result.shrunk = result.target;
  for (std::size_t v = 0; v < result.target.vertices.size(); ++v) {
    result.grown.vertices[v] += moves.outward[v];
    result.shrunk.vertices[v] += moves.inward[v];
  }
  result.moved.resize(result.target.triangles.size());
  for (std::size_t t = 0; t < result.moved.size(); ++t) {
    int moved = 0;
    for (const auto v : result.target.triangles[t]) {
      moved += !moves.outward[v].isZero() || !moves.inward[v].isZero();
    }
    result.moved[t] = moved > 0;
    if (moved == 0) continue;
    result.coincident_area_mm2 += moved / 3. * area_of(result.target, t);
    result.greatest_distance_mm = std::max(result.greatest_distance_mm, contacts.distance[t]);
  }
  return result;
}

}  // namespace reforge
