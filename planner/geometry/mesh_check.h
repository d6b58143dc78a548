// From a file to a part that can be planned: the one way in.
//
// A *part* is one solid (closed, manifold, oriented outward, without self-intersection, of one
// piece without enclosed cavity), plausible as millimetres, inside the rig's working space,
// standing on z = 0 and centred on x = y = 0 by its bounding box. Mended, and said in `notes`:
// corners less than 1e-4 mm apart, triangles listed twice or without
//   area, wrong orientation. Everything else is refused with a sentence that names the file, the
//   fault and where it is. No holes are filled.
// Units: mm. Limits: about 3 microseconds and 400 bytes a triangle; triangles without area whose
// corners
//   are distinct are refused rather than removed when the surface needs them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

// From file coordinates to the part frame: a quarter turn about z, or none, then a rotation (the
// identity but for targets that a setup turns), then a translation. Without rotation, translations
// in x and y are multiples of 2^-10 mm, so that coordinates lose no digits by them.
struct Placement {
  bool turned = false;  // (x, y) -> (-y, x)
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3 translation = Vec3::Zero();

  Vec3 apply(const Vec3& in_file) const;
  TriangleMesh apply(const TriangleMesh& in_file) const;
};

struct LoadedPart {
  std::string name;      // the file, as sentences call it
  TriangleMesh in_file;  // mended, in the file's coordinates: what a stored placement needs
  Placement placement;
  TriangleMesh mesh;               // placement.apply(in_file), rounded to float
  std::vector<std::string> notes;  // sentences
};

Result<LoadedPart> load_part(const std::filesystem::path& file, const RigDescription& rig);
Result<LoadedPart> check_part(TriangleMesh mesh, const std::string& name,
                              const RigDescription& rig);

}  // namespace reforge
