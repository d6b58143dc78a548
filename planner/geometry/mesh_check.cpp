#include "planner/geometry/mesh_check.h"

#include <cmath>
#include <cstdio>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"

namespace reforge {
namespace {

constexpr double kWeld = 1e-4;         // mm
constexpr double kLargest = 1e6;       // mm; beyond it floats no longer resolve a tenth
constexpr double kSmallestExtent = 1;  // mm; a part smaller than this was not meant in mm
constexpr double kThinnest = 1e-3;     // mm

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}
std::string at(const Vec3& p) {
  return "(" + number(p.x()) + ", " + number(p.y()) + ", " + number(p.z()) + ") mm";
}
std::string extents(const Vec3& size) {
  return number(size.x()) + " x " + number(size.y()) + " x " + number(size.z()) + " mm";
}
std::string plural(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

bool is_clean(const TriangleMesh& mesh) {
  const auto faults = edge_faults(mesh);
  return faults.open == 0 && faults.crowded == 0;
}

TriangleMesh without_zero_areas(const TriangleMesh& mesh) {
  TriangleMesh result;
  result.vertices = mesh.vertices;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[1]] - mesh.vertices[t[0]];
    const Vec3 b = mesh.vertices[t[2]] - mesh.vertices[t[0]];
    if (a.cross(b).norm() > 1e-12 * (a.squaredNorm() + b.squaredNorm()))
      result.triangles.push_back(t);
  }
  return result;
}

// Mends what can be mended without guessing, each step only if the surface is not whole without it.
TriangleMesh mended(const TriangleMesh& mesh, std::vector<std::string>& notes) {
  TriangleMesh best = without_duplicates(welded(mesh));
  const auto exact = best.triangles.size();
  if (exact < mesh.triangles.size()) {
    notes.push_back(plural(mesh.triangles.size() - exact, "triangle") +
                    " listed twice or without area left out.");
  }
  if (is_clean(best)) return best;
  TriangleMesh next = without_zero_areas(best);
  if (next.triangles.size() < exact && is_clean(next)) {
    notes.push_back(plural(exact - next.triangles.size(), "triangle") + " without area left out.");
    return welded(next);
  }
  next = without_duplicates(welded_within(best, kWeld));
  if (is_clean(next)) {
    notes.push_back("Corners up to " + number(kWeld) + " mm apart were joined (" +
                    std::to_string(best.vertices.size() - next.vertices.size()) + " vertices" +
                    " fewer); before, the surface was open.");
    return next;
  }
  return best;
}

Error refuse(const std::string& name, const std::string& what, Code code = Code::kBadMesh) {
  return {code, name + ": " + what};
}

Status check_coordinates(const TriangleMesh& mesh, const std::string& name) {
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (!mesh.vertices[i].allFinite()) {
      return refuse(name, "vertex " + std::to_string(i) + " is not finite: (" +
                              number(mesh.vertices[i].x()) + ", " + number(mesh.vertices[i].y()) +
                              ", " + number(mesh.vertices[i].z()) + ").");
    }
    if (mesh.vertices[i].cwiseAbs().maxCoeff() > kLargest) {
      return refuse(name,
                    "vertex " + std::to_string(i) + " lies at " + at(mesh.vertices[i]) +
                        ", more than a kilometre away: the file is damaged or not in millimetres.",
                    Code::kDoesNotFit);
    }
  }
  return Unit{};
}

Status check_surface(const TriangleMesh& mesh, const std::string& name) {
  const auto faults = edge_faults(mesh);
  if (faults.open > 0) {
    return refuse(name, "the surface is not closed: " + plural(faults.open, "open edge") +
                            ", one near " + at(*faults.first) +
                            ". Close the holes in a modelling program.");
  }
  if (faults.crowded > 0) {
    return refuse(name, plural(faults.crowded, "edge") +
                            " with more than two triangles, one near " + at(*faults.first) +
                            ": the surface does not bound a solid there.");
  }
  if (const auto pinch = pinched_vertex(mesh)) {
    return refuse(name, "the surface touches itself in a single vertex at " + at(*pinch) +
                            ": two bodies joined at a point are no solid.");
  }
  return Unit{};
}

// Outward orientation for a mesh of one or more closed pieces.
Status orient_outward(TriangleMesh& mesh, const std::string& name,
                      std::vector<std::string>& notes) {
  const auto turned = orient(mesh);
  if (!turned) return refuse(name, "the surface has only one side, so it bounds no solid.");
  if (*turned > 0) {
    notes.push_back(plural(*turned, "triangle") +
                    " faced the other way than their neighbours and were turned.");
  }
  if (volume(mesh) < 0) {
    mesh = flipped(mesh);
    notes.push_back("The surface was inside out and has been turned.");
  }
  return Unit{};
}

Status check_pieces(const TriangleMesh& mesh, const std::string& name) {
  const auto parts = split_pieces(mesh);
  if (parts.size() == 1) return Unit{};
  const std::size_t count = parts.size();
  if (self_intersects(mesh)) {
    return refuse(name, "it consists of " + std::to_string(count) +
                            " closed surfaces that pass through each other: unite them first.");
  }
  std::size_t largest = 0;
  for (std::size_t i = 1; i < count; ++i) {
    if (std::abs(volume(parts[i])) > std::abs(volume(parts[largest]))) largest = i;
  }
  const TriangleMesh outer = volume(parts[largest]) < 0 ? flipped(parts[largest]) : parts[largest];
  for (std::size_t i = 0; i < count; ++i) {
    if (i == largest || !contains(outer, parts[i].vertices.front())) continue;
    return refuse(name, "it encloses a cavity around " + at(bounds(parts[i]).center()) +
                            " that no tool can reach from outside; fill it or open it.");
  }
  return refuse(name, "it consists of " + std::to_string(count) +
                          " separate solids; a part is one piece. Keep one of them in the file.");
}

Status check_size(const Vec3& size, const std::string& name) {
  if (size.minCoeff() < kThinnest) {
    return refuse(name, "it has no volume: its extent is " + extents(size) + ".");
  }
  if (size.maxCoeff() < kSmallestExtent) {
    return refuse(
        name,
        "its largest extent is " + number(size.maxCoeff()) +
            " mm, so it was probably exported in metres or inches: export it in millimetres.",
        Code::kDoesNotFit);
  }
  return Unit{};
}

Result<Placement> place(const TriangleMesh& mesh, const std::string& name,
                        const RigDescription& rig, std::vector<std::string>& notes) {
  const Vec3 room(rig.working_space_mm.x, rig.working_space_mm.y, rig.working_space_mm.z);
  const Vec3 size = bounds(mesh).sizes();
  const auto fits = [&room](double x, double y, double z) {
    return x <= room.x() && y <= room.y() && z <= room.z();
  };
  Placement placement;
  placement.turned = !fits(size.x(), size.y(), size.z());
  if (placement.turned) {
    if (!fits(size.y(), size.x(), size.z())) {
      return refuse(name,
                    "it measures " + extents(size) + " and does not fit the working space of " +
                        extents(room) + ", turned by 90 degrees or not.",
                    Code::kDoesNotFit);
    }
    notes.push_back("Turned by 90 degrees about z to fit the working space.");
  }
  const Box3 box = bounds(placement.apply(mesh));
  const auto rounded = [](double x) { return std::round(x * 1024) / 1024; };
  placement.translation =
      Vec3(-rounded(box.center().x()), -rounded(box.center().y()), -box.min().z());
  return placement;
}

}  // namespace

Vec3 Placement::apply(const Vec3& in_file) const {
  const Vec3 base = turned ? Vec3(-in_file.y(), in_file.x(), in_file.z()) : in_file;
  if (rotation.isIdentity(0)) return base + translation;
  return rotation * base + translation;
}

TriangleMesh Placement::apply(const TriangleMesh& in_file) const {
  TriangleMesh mesh = in_file;
  for (Vec3& vertex : mesh.vertices) vertex = apply(vertex);
  return mesh;
}

Result<LoadedPart> load_part(const std::filesystem::path& file, const RigDescription& rig) {
  auto mesh = read_mesh(file);
  if (!mesh) return mesh.error();
  return check_part(std::move(*mesh), file.string(), rig);
}

Result<LoadedPart> check_part(TriangleMesh mesh, const std::string& name,
                              const RigDescription& rig) {
  LoadedPart part;
  part.name = name;
  if (mesh.empty()) return refuse(name, "it has no triangles.");
  if (const auto ok = check_coordinates(mesh, name); !ok) return ok.error();
  if (const auto ok = check_size(bounds(mesh).sizes(), name); !ok) return ok.error();
  part.in_file = mended(mesh, part.notes);
  if (part.in_file.empty()) return refuse(name, "it has no triangle with an area.");
  if (const auto ok = check_surface(part.in_file, name); !ok) return ok.error();
  if (const auto ok = orient_outward(part.in_file, name, part.notes); !ok) return ok.error();
  if (const auto ok = check_pieces(part.in_file, name); !ok) return ok.error();
  if (!(volume(part.in_file) > 1e-9 * area(part.in_file))) return refuse(name, "it has no volume.");
  const auto placement = place(part.in_file, name, rig, part.notes);
  if (!placement) return placement.error();
  if (const auto where = self_intersects(part.in_file)) {
    return refuse(name, "the surface passes through itself, near " + at(*where) +
                            ": mend it in a modelling program.");
  }
  part.placement = *placement;
  part.mesh = rounded_to_float(part.placement.apply(part.in_file));
  return part;
}

}  // namespace reforge
