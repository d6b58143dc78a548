#include "planner/verify/verify.h"

#include <cmath>
#include <fstream>

#include "planner/geometry/mesh_io.h"
#include "planner/verify/left_over.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

using namespace verify;

constexpr double kFinePitch = 0.1;
constexpr double kCoarsePitch = 0.2;
constexpr double kColumnsMax = 1.2e7;
constexpr double kBareShare = 0.05;   // of the added volume that may be without beads: thin edges
constexpr double kBareLeast = 5.0;    // mm^3, likewise
constexpr double kMissingArea = 0.5;  // mm^2 of surface that lacks more than 0.15 mm

const TriangleMesh* pointer(const std::optional<TriangleMesh>& mesh) {
  return mesh ? &*mesh : nullptr;
}

double pitch_for(const VerifyInputs& inputs) {
  Box3 box;
  for (const Vec3& p : inputs.initial.vertices) box.extend(p);
  if (inputs.target) {
    for (const Vec3& p : inputs.target->vertices) box.extend(p);
  }
  if (box.isEmpty()) return kFinePitch;
  // The widest view is at most as wide as the box's two longest edges.
  Vec3 s = box.sizes();
  const double widest = std::max({s.x() * s.y(), s.y() * s.z(), s.z() * s.x()});
  return widest / (kFinePitch * kFinePitch) > kColumnsMax ? kCoarsePitch : kFinePitch;
}

void judge_deviation(const PartOutcome& part, Findings& findings) {
  const auto judge = [&](const std::optional<Deviation>& d, const char* surface) {
    if (!d || d->missing_mm2 <= kMissingArea) return;
    findings.add(Fault::kDeviation, 0, 0, d->worst, -d->least, [&] {
      return "the finished part lacks material on " + millimetres(d->missing_mm2) + " mm2 of " +
             surface + " surface, " + millimetres(-d->least) + " mm at most, at X" +
             millimetres(d->worst.x()) + " Y" + millimetres(d->worst.y()) + " Z" +
             millimetres(d->worst.z());
    });
  };
  judge(part.milled, "milled");
  judge(part.kept, "kept");
}

void judge_added(const PartOutcome& part, const VerifyInputs& inputs, Findings& findings) {
  if (!inputs.added) return;
  const double planned = volume(*inputs.added);
  const double bare = planned - part.plan_covered;
  if (bare <= std::max(kBareShare * planned, kBareLeast)) return;
  findings.add(Fault::kNotPrinted, 0, 0, Vec3::Zero(), 0, [&] {
    return "of the " + millimetres(planned) + " mm3 to be added " + millimetres(bare) +
           " mm3 have no bead within an infill gap";
  });
}

std::map<std::string, double> numbers(const Deviation& d) {
  return {{"samples", static_cast<double>(d.samples)},
          {"min", d.least},
          {"p01", d.p01},
          {"p05", d.p05},
          {"p50", d.p50},
          {"p95", d.p95},
          {"p99", d.p99},
          {"max", d.most},
          {"missing_mm2", d.missing_mm2}};
}

Result<std::optional<TriangleMesh>> read_if_there(const std::filesystem::path& file,
                                                  const std::string& name, Certificate& hashes) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::optional<TriangleMesh>();
  Result<std::string> hash = sha256_of_file(file);
  if (!hash) return hash.error();
  hashes.sha256[name] = *hash;
  Result<TriangleMesh> mesh = read_mesh(file);
  if (!mesh) return mesh.error();
  return std::optional<TriangleMesh>(std::move(*mesh));
}

// The mode the header names; strict when it names none.
Result<Mode> mode_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in)
    return Result<Mode>::fail(Code::kUnreadable, file.string() + ": the program cannot be read");
  std::string line;
  while (std::getline(in, line) && (line.empty() || line.front() == ';' || line.front() == '(')) {
    const std::size_t at = line.find("mode: ");
    if (at != std::string::npos) {
      return line.compare(at + 6, 5, "paper") == 0 ? Mode::kPaper : Mode::kStrict;
    }
  }
  return Mode::kStrict;
}

}  // namespace

Result<Verification> verify_program(std::istream& program, const VerifyInputs& inputs,
                                    const VerifyOptions& options) {
  Verification v;
  v.pitch_mm = options.pitch_mm > 0 ? options.pitch_mm : pitch_for(inputs);
  const SceneSolids solids{&inputs.initial, pointer(inputs.target), pointer(inputs.reused),
                           pointer(inputs.fixture)};
  const ToolBodies tools = tools_of(inputs.rig, inputs.mode);
  Scene scene(solids, tools, inputs.mode, v.pitch_mm, bridge_length(inputs.rig.extrusion),
              v.findings);
  Replay replay(inputs.rig, inputs.mode, inputs.initial_sha256, pointer(inputs.fixture), scene,
                v.findings);
  Result<ReplayOutcome> outcome = replay.run(program, {options.progress, options.should_stop});
  if (!outcome) return outcome.error();
  if (outcome->stopped) {
    return Result<Verification>::fail(Code::kInterrupted, "the verification was stopped");
  }
  v.program = *outcome;
  v.clearance_mm = scene.clearances();
  v.part = judge_part(
      scene.stock(),
      {&inputs.initial, pointer(inputs.target), pointer(inputs.reused), pointer(inputs.added),
       inputs.rig.extrusion.bead_width_mm / std::max(inputs.rig.extrusion.infill, 0.05)},
      v.pitch_mm);
  judge_deviation(v.part, v.findings);
  judge_added(v.part, inputs, v.findings);
  if (inputs.reused) {
    const TriangleMesh* fixture = inputs.mode == Mode::kStrict ? pointer(inputs.fixture) : nullptr;
    const LeftOver left =
        find_left_over(scene.stock(), {inputs.initial, *inputs.reused,
                                       fixture && !fixture->empty() ? fixture : nullptr, tools,
                                       scene.milled_from()});
    v.left_over_lumps_mm3 = left.volume_mm3;
    if (left.volume_mm3 > 0) {
      v.findings.add(Fault::kLeftOver, 0, 0, left.where, left.thickness_mm, [&] {
        return "a lump that was to be milled away, and could have been, is still there: " +
               millimetres(left.thickness_mm) + " mm thick at X" + millimetres(left.where.x()) +
               " Y" + millimetres(left.where.y()) + " Z" + millimetres(left.where.z()) + ", " +
               millimetres(left.volume_mm3) + " mm3 in all";
      });
    }
  }
  v.pass = v.findings.total() == 0;
  return v;
}

Certificate certificate_of(const Verification& v, const VerifyInputs& inputs) {
  Certificate c;
  c.mode = inputs.mode;
  c.verifier = REFORGE_VERSION;
  c.pitch_mm = v.pitch_mm;
  c.pass = v.pass;
  c.lines = v.program.lines;
  c.moves = v.program.moves;
  c.blocks = v.program.blocks;
  c.seconds = v.program.seconds;
  c.filament_mm = v.program.filament_mm;
  c.clearance_mm = v.clearance_mm;
  for (std::size_t k = 0; k < kFaults; ++k) {
    const auto fault = static_cast<Fault>(k);
    const Findings::Kind& kind = v.findings.of(fault);
    if (kind.count == 0) continue;
    const Finding& f = kind.worst;
    c.findings.push_back({std::string(name_of(fault)),
                          kind.count,
                          f.line,
                          f.block,
                          {f.position.x(), f.position.y(), f.position.z()},
                          f.depth_mm,
                          f.sentence});
  }
  if (inputs.reused && inputs.removed && inputs.added) {
    c.planned = {volume(*inputs.reused), volume(*inputs.removed), volume(*inputs.added)};
  }
  c.simulated = {v.part.reused, v.part.removed, v.part.added};
  c.volume_details_mm3 = {{"initial", v.part.initial}, {"added_by_flow", v.program.flow_mm3}};
  if (inputs.reused) {
    c.volume_details_mm3["kept_cut"] = v.part.kept_cut;
    c.volume_details_mm3["left_over"] = v.part.left_over;
    c.volume_details_mm3["left_over_lumps"] = v.left_over_lumps_mm3;
  }
  if (inputs.added) {
    c.volume_details_mm3["added_in_plan"] = v.part.added_in_plan;
    c.volume_details_mm3["plan_covered"] = v.part.plan_covered;
  }
  if (v.part.milled) c.deviation_mm["milled"] = numbers(*v.part.milled);
  if (v.part.kept) c.deviation_mm["kept"] = numbers(*v.part.kept);
  if (v.part.printed) c.deviation_mm["printed"] = numbers(*v.part.printed);
  return c;
}

Result<JobVerification> verify_job(const std::filesystem::path& job, const VerifyOptions& options) {
  const std::filesystem::path program_file = job / "program.nc";
  Certificate hashes;
  VerifyInputs inputs;
  Result<RigDescription> rig = read_rig(job / "rig.json");
  if (!rig) return rig.error();
  inputs.rig = std::move(*rig);
  hashes.sha256["rig"] = inputs.rig.sha256;
  Result<Mode> mode = mode_of(program_file);
  if (!mode) return mode.error();
  inputs.mode = *mode;

  const std::array<std::pair<const char*, std::optional<TriangleMesh>*>, 5> meshes{
      {{"target", &inputs.target},
       {"reused", &inputs.reused},
       {"removed", &inputs.removed},
       {"added", &inputs.added},
       {"fixture", &inputs.fixture}}};
  for (const auto& [name, mesh] : meshes) {
    auto read = read_if_there(job / (std::string(name) + ".stl"), name, hashes);
    if (!read) return read.error();
    *mesh = std::move(*read);
  }
  auto initial = read_if_there(job / "initial.stl", "initial", hashes);
  if (!initial) return initial.error();
  if (!*initial) {
    return Result<JobVerification>::fail(Code::kUnreadable,
                                         (job / "initial.stl").string() + ": no such file");
  }
  inputs.initial = std::move(**initial);
  inputs.initial_sha256 = hashes.sha256["initial"];

  Result<std::string> program_hash = sha256_of_file(program_file);
  if (!program_hash) return program_hash.error();
  hashes.sha256["program"] = *program_hash;
  std::ifstream program(program_file, std::ios::binary);
  Result<Verification> verification = verify_program(program, inputs, options);
  if (!verification) return verification.error();
  JobVerification result{std::move(*verification), {}};
  result.certificate = certificate_of(result.verification, inputs);
  result.certificate.sha256 = hashes.sha256;
  return result;
}

}  // namespace reforge
