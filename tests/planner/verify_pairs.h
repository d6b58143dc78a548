// Four small pairs with good programs, for mutation tests: the toolpath rooms and the
// post-processor make the programs (under 5,000 lines each), on tables of both kinds. Part frame,
// mm.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

#include "planner/geometry/shapes.h"
#include "planner/program/post.h"
#include "planner/program/program_writer.h"
#include "planner/toolpath/finishing.h"
#include "planner/toolpath/roughing.h"
#include "planner/verify/verify.h"

namespace reforge::mutation {

struct SmallPair {
  std::string name;
  VerifyInputs inputs;
  std::string program;
};

inline void join(TriangleMesh& all, const TriangleMesh& more) {
  const auto shift = static_cast<std::uint32_t>(all.vertices.size());
  all.vertices.insert(all.vertices.end(), more.vertices.begin(), more.vertices.end());
  for (auto t : more.triangles) {
    for (auto& corner : t) corner += shift;
    all.triangles.push_back(t);
  }
}

inline TriangleMesh joined(const std::vector<TriangleMesh>& parts) {
  TriangleMesh all;
  for (const TriangleMesh& part : parts) join(all, part);
  return all;
}

// A convex polygon in x and z (counter-clockwise seen from -y), from y0 to y1.
inline TriangleMesh prism(const std::vector<std::pair<double, double>>& corners, double y0,
                          double y1) {
  TriangleMesh mesh;
  const auto n = static_cast<std::uint32_t>(corners.size());
  for (const double y : {y0, y1}) {
    for (const auto& [x, z] : corners) mesh.vertices.push_back({x, y, z});
  }
  for (std::uint32_t k = 1; k + 1 < n; ++k) {
    mesh.triangles.push_back({0, k, k + 1});
    mesh.triangles.push_back({n, n + k + 1, n + k});
  }
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t next = (k + 1) % n;
    mesh.triangles.push_back({k, n + next, next});
    mesh.triangles.push_back({k, n + k, n + next});
  }
  return mesh;
}

// Solids of a pair, and the directions it is milled and printed from.
struct Recipe {
  std::string name;
  RigDescription rig;
  TriangleMesh initial, reused, removed, added;
  std::vector<Vec3> milled_from;
  Vec3 printed_from = Vec3::UnitZ();
};

// A pad that is a box in the frame, filled with beads to and fro; two paths a layer, the second
// from the far side.
inline std::vector<Path> zigzag(const TriangleMesh& pad, const Frame& frame, const Extrusion& e) {
  Box3 box;
  for (const Vec3& p : pad.vertices) box.extend(frame.to_local(p));
  const double w = e.bead_width_mm, lift = 1;
  const double u0 = box.min().x() + 0.5 * w, u1 = box.max().x() - 0.5 * w;
  const int rows = static_cast<int>(std::floor((box.sizes().y() + 1e-6) / w));
  const int layers = static_cast<int>(std::floor((box.sizes().z() + 1e-6) / e.layer_height_mm));
  std::vector<Path> paths;
  Vec3 at = Vec3::Zero();
  for (int layer = 1; layer <= layers; ++layer) {
    const double z = box.min().z() + layer * e.layer_height_mm;
    for (const bool second : {false, true}) {
      Path path;
      const int count = second ? rows - rows / 2 : rows / 2;
      for (int k = 0; k < count; ++k) {
        const int row = second ? rows - 1 - k : k;
        const double v = box.min().y() + (row + 0.5) * w;
        const double a = k % 2 == 0 ? u0 : u1, b = k % 2 == 0 ? u1 : u0;
        if (k > 0) {
          path.moves.push_back({{a, v, z}, Motion::kDeposit});
        } else {
          if (!paths.empty()) path.moves.push_back({at + Vec3(0, 0, lift), Motion::kRapid});
          path.moves.push_back({{a, v, z + lift}, Motion::kRapid});
          path.moves.push_back({{a, v, z}, Motion::kRapid});
        }
        const double stop = b > a ? b - e.coast_mm : b + e.coast_mm;
        const bool last = k + 1 == count;
        path.moves.push_back({{last ? stop : b, v, z}, Motion::kDeposit});
        if (last) path.moves.push_back({{b, v, z}, Motion::kCoast});
        at = {b, v, z};
      }
      path.first_layer = layer == 1;
      paths.push_back(std::move(path));
    }
  }
  return paths;
}

inline SmallPair make_pair(const Recipe& recipe) {
  const auto go_on = [] { return false; };
  SmallPair pair{recipe.name, {}, {}};
  VerifyInputs& in = pair.inputs;
  in.rig = recipe.rig;
  in.initial = recipe.initial;
  in.reused = recipe.reused;
  in.removed = recipe.removed;
  in.added = recipe.added;
  in.target = joined({recipe.reused, recipe.added});
  in.fixture =
      joined({make_box({-4, -4, -50}, {4, 4, 0}), make_cylinder({0, 0, -62}, {0, 0, -50}, 25, 32)});
  std::vector<BlockToolpath> blocks;
  const MillingOptions milling = milling_options(in.rig, Mode::kStrict);
  const Surroundings solids{in.initial, *in.reused, *in.fixture};
  PartStock stock = part_stock(in.initial, *in.reused, 2e5);
  const std::vector<MachinedSample> samples = machined_surface(*in.reused, *in.removed, 0.4);
  std::vector<char> done(samples.size(), 0);
  for (const Vec3& d : recipe.milled_from) {
    BlockToolpath path{BlockKind::kMill, Frame::along(d), {}};
    BlockStock block(stock, solids, path.frame, milling.cutter);
    path.paths = rough(milling, solids, go_on, block);
    const TipFloor floor(solids, path.frame, milling, 0);
    const Clearance clearance(block.standing(), milling.cutter);
    std::vector<char> wanted;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      wanted.push_back(!done[k] && touchable(samples[k], path.frame, floor, clearance,
                                             milling.cutter.ball_radius_mm));
    }
    finish(milling, solids, samples, wanted, go_on, block, done, path.paths);
    block.commit(stock);
    blocks.push_back(std::move(path));
  }
  BlockToolpath print{BlockKind::kPrint, Frame::along(recipe.printed_from), {}};
  print.paths = zigzag(*in.added, print.frame, in.rig.extrusion);
  blocks.push_back(std::move(print));
  const PostJob job{
      recipe.name, Mode::kStrict, std::string(64, 'a'), {&in.initial, &*in.target, &*in.fixture}};
  const Result<Program> program = post_program(in.rig, job, blocks);
  if (!program) {
    std::fprintf(stderr, "%s: %s\n", recipe.name.c_str(), program.error().sentence.c_str());
    std::abort();
  }
  pair.program = program->text;
  return pair;
}

inline RigDescription shipped_rig() {
  Result<RigDescription> rig =
      read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
  if (!rig) {
    std::fprintf(stderr, "%s\n", rig.error().sentence.c_str());
    std::abort();
  }
  return std::move(*rig);
}

// A block faced, one side cut back, a pad printed on top.
inline Recipe pad() {
  return {"pad",
          shipped_rig(),
          make_box({-6, -6, 0}, {6, 6, 6}),
          make_box({-6, -6, 0}, {5, 6, 4}),
          joined({make_box({-6, -6, 4}, {6, 6, 6}), make_box({5, -6, 0}, {6, 6, 4})}),
          make_box({-3, -3, 4}, {3, 3, 5.2}),
          {Vec3::UnitX(), Vec3::UnitZ()}};
}

// A step down to half, with a wall printed on it; an AC table with turned signs and pivots.
inline Recipe step() {
  Recipe r{"step",
           shipped_rig(),
           make_box({-6, -6, 0}, {6, 6, 7}),
           joined({make_box({-6, 0, 0}, {6, 6, 7}), make_box({-6, -6, 0}, {6, 0, 3})}),
           make_box({-6, -6, 3}, {6, 0, 7}),
           make_box({-4, -4.6, 3}, {4, -2.6, 5}),
           {Vec3::UnitZ()}};
  r.rig.kinematics.table = RotaryTable::kAC;
  r.rig.kinematics.sign_c = -1;
  r.rig.kinematics.c_axis_point_mm = {1, -2, 0};
  r.rig.kinematics.tilt_offset_mm = {0, 3, -10};
  r.milled_from = {-Vec3::UnitY(), Vec3::UnitZ()};
  return r;
}

// A chamfer milled and printed upon along its own normal.
inline Recipe chamfer() {
  const Vec3 d = Vec3(1, 0, 1).normalized();
  // The pad on the chamfer, in its own frame: along the slope, y, and 0 to 1 mm outwards.
  const double s = std::sqrt(0.5);
  const auto at = [&](double along, double out) {
    return std::pair(3 + s * (along + out), 5 + s * (out - along));
  };
  return {"chamfer",
          shipped_rig(),
          prism({{-6, 0}, {6, 0}, {6, 8}, {-6, 8}}, -5, 5),
          prism({{-6, 0}, {6, 0}, {6, 2}, {0, 8}, {-6, 8}}, -5, 5),
          prism({{6, 2}, {6, 8}, {0, 8}}, -5, 5),
          prism({at(-2.5, 0), at(2.5, 0), at(2.5, 1), at(-2.5, 1)}, -3, 3),
          {d},
          d};
}

// A groove cut into the top, ribs standing; a rib of its own printed on one of them.
inline Recipe groove() {
  Recipe r{"groove",
           shipped_rig(),
           make_box({-7, -5, 0}, {7, 5, 7}),
           joined({make_box({-7, -5, 0}, {7, 5, 3}), make_box({-7, -5, 3}, {-2.5, 5, 6}),
                   make_box({2.5, -5, 3}, {7, 5, 6})}),
           joined({make_box({-7, -5, 6}, {7, 5, 7}), make_box({-2.5, -5, 3}, {2.5, 5, 6})}),
           make_box({-6, -4, 6}, {-3.4, 4, 7}),
           {Vec3::UnitZ()}};
  r.rig.kinematics.c_axis_point_mm = {2, 1, 0};
  r.rig.kinematics.tilt_offset_mm = {4, 0, -10};
  return r;
}

inline std::vector<Recipe> recipes() {
  return {pad(), step(), chamfer(), groove()};
}

inline Verification verify_pair(const VerifyInputs& inputs, const std::string& program,
                                double pitch) {
  std::istringstream in(program);
  VerifyOptions options;
  options.pitch_mm = pitch;
  Result<Verification> v = verify_program(in, inputs, options);
  if (!v) {
    std::fprintf(stderr, "%s\n", v.error().sentence.c_str());
    std::abort();
  }
  return std::move(*v);
}

inline std::string findings_of(const Verification& v) {
  std::string text;
  for (std::size_t k = 0; k < verify::kFaults; ++k) {
    const verify::Findings::Kind& kind = v.findings.of(static_cast<verify::Fault>(k));
    if (kind.count == 0) continue;
    text += std::string(verify::name_of(static_cast<verify::Fault>(k))) + " x" +
            std::to_string(kind.count) + " line " + std::to_string(kind.worst.line) + ": " +
            kind.worst.sentence + "\n";
  }
  return text;
}

}  // namespace reforge::mutation
