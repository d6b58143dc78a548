// The blocks and toolpaths measured: for each pair, by block, what is worked and what it costs;
// then the finished part, as the verifier finds it, against what was planned.
//
// Pairs: names out of --pairs-file (a list like the shared models' pairs.json, meshes beside it);
// coral_coral when none is named.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "planner/program/fabricate.h"
#include "planner/program/post.h"
#include "planner/reuse/reuse.h"
#include "planner/verify/verify.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;

struct Question {
  fs::path initial, target;
  RigDescription rig;
  ReuseOptions options;
};

void print_blocks(const Fabrication& made, const Program& program) {
  std::printf("  %3s %-5s %26s %10s %10s %7s %7s %6s\n", "", "block", "direction", "mm3", "path mm",
              "min", "paths", "air %");
  for (std::size_t i = 0; i < made.toolpaths.size(); ++i) {
    const BlockToolpath& toolpath = made.toolpaths[i];
    const BlockFigures& figures = program.blocks[i];
    const Vec3& d = toolpath.frame.d;
    std::printf("  %3zu %-5s %8.3f %8.3f %8.3f %10.1f %10.1f %7.1f %7d %6.1f\n", i + 1,
                toolpath.kind == BlockKind::kMill ? "mill" : "print", d.x(), d.y(), d.z(),
                made.solids[i].volume_mm3, figures.path_mm, figures.seconds / 60, figures.paths,
                100 * figures.air_mm / std::max(1e-9, figures.air_mm + figures.path_mm));
  }
}

void print_part(const Verification& v, const Fabrication& made) {
  std::printf("  verification: %s\n", v.pass ? "passes" : "DOES NOT PASS");
  for (const auto& [name, deviation] :
       {std::pair{"milled", v.part.milled}, std::pair{"printed", v.part.printed}}) {
    if (!deviation) continue;
    std::printf(
        "  %-8s %zu places: least %.3f  1%% %.3f  50%% %.3f  95%% %.3f  99%% %.3f  most %.3f mm\n",
        name, deviation->samples, deviation->least, deviation->p01, deviation->p50, deviation->p95,
        deviation->p99, deviation->most);
  }
  std::printf("  V_R cut into %.2f mm3; of V_S left %.1f mm3, in lumps %.2f mm3\n", v.part.kept_cut,
              v.part.left_over, v.left_over_lumps_mm3);
  std::printf("  printed: slices ask %.1f mm3, beads lay %.1f mm3 (%+.1f %%), simulated %.1f mm3\n",
              made.printed_plan_mm3, made.printed_beads_mm3,
              100 * (made.printed_beads_mm3 / std::max(1e-9, made.printed_plan_mm3) - 1),
              v.part.added);
}

int measure(const Question& q) {
  const auto failed = [](const Error& error) {
    std::printf("  %s\n", error.sentence.c_str());
    return 1;
  };
  Result<LoadedPart> initial = load_part(q.initial, q.rig), target = load_part(q.target, q.rig);
  if (!initial) return failed(initial.error());
  if (!target) return failed(target.error());
  StageTimes times;
  const auto reuse = plan_reuse(*initial, *target, q.rig, q.options, times);
  if (!reuse) return failed(reuse.error());
  if (const auto* why = std::get_if<Infeasible>(&*reuse)) {
    for (const std::string& reason : why->reasons) std::printf("  no plan: %s\n", reason.c_str());
    return 1;
  }
  const ReusePlan& plan = std::get<ReusePlan>(*reuse);
  const Result<Fabrication> made = fabricate(plan, q.rig, q.options.mode, {}, times);
  if (!made) return failed(made.error());
  PostJob job{"bench", q.options.mode, std::string(64, '0'), {&plan.initial, &plan.target}};
  if (!plan.fixture.empty()) job.solids.push_back(&plan.fixture);
  Result<Program> program = [&] {
    const StageTimer timer(times, "program");
    return post_program(q.rig, job, made->toolpaths);
  }();
  if (!program) return failed(program.error());
  print_blocks(*made, *program);
  std::printf("  R_F %.3f, %zu lines, %d toggles, %d retracts\n", plan.ratio_final, program->lines,
              program->toggles, program->retracts);
  for (const std::string& note : made->notes) std::printf("  note: %s\n", note.c_str());
  VerifyInputs inputs;
  inputs.rig = q.rig;
  inputs.mode = q.options.mode;
  inputs.initial = plan.initial;
  inputs.target = plan.target;
  inputs.reused = plan.reused;
  inputs.removed = plan.removed;
  inputs.added = plan.added;
  if (!plan.fixture.empty()) inputs.fixture = plan.fixture;
  std::istringstream text(program->text);
  const Result<Verification> verification = verify_program(text, inputs, {});
  if (!verification) return failed(verification.error());
  for (const CertificateFinding& finding : certificate_of(*verification, inputs).findings)
    std::printf("  finding: %s (%zu)\n", finding.sentence.c_str(),
                static_cast<std::size_t>(finding.count));
  print_part(*verification, *made);
  std::printf("  CPU s:");
  for (const StageTime& time : times.stages)
    std::printf("  %s %.2f", time.stage.c_str(), time.cpu_seconds);
  std::printf("\n");
  return verification->pass ? 0 : 1;
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  using namespace reforge;
  CLI::App app("Blocks and toolpaths, measured");
  const fs::path source = REFORGE_SOURCE_DIR;
  fs::path pairs_file = source / ".." / "shared" / "models" / "pairs.json";
  fs::path rig_file = source / "config" / "rigs" / "mx220.json";
  std::vector<std::string> names{"coral_coral"};
  Question q;
  q.options.mode = Mode::kPaper;
  q.options.setup = Setup::kCentroids;
  q.options.effort = Effort::kFast;
  app.add_option("pairs", names, "names of pairs")->capture_default_str();
  app.add_option("--pairs-file", pairs_file)->capture_default_str();
  app.add_option("--rig", rig_file)->capture_default_str();
  app.add_option("--seed", q.options.seed)->capture_default_str();
  app.add_option("--mode", q.options.mode)
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Mode>{{"strict", Mode::kStrict}, {"paper", Mode::kPaper}}));
  app.add_option("--setup", q.options.setup)
      ->transform(CLI::CheckedTransformer(std::map<std::string, Setup>{
          {"centroids", Setup::kCentroids}, {"stored", Setup::kStored}}));
  CLI11_PARSE(app, argc, argv);
  Result<RigDescription> rig = read_rig(rig_file);
  if (!rig) {
    std::fprintf(stderr, "%s\n", rig.error().sentence.c_str());
    return 2;
  }
  q.rig = std::move(*rig);
  std::ifstream in(pairs_file);
  const auto list = nlohmann::json::parse(in, nullptr, false);
  if (list.is_discarded() || !list.contains("pairs")) {
    std::fprintf(stderr, "%s: no list of pairs\n", pairs_file.c_str());
    return 2;
  }
  int bad = 0;
  for (const std::string& name : names) {
    bool known = false;
    for (const auto& pair : list.at("pairs")) {
      if (pair.at("name") != name) continue;
      known = true;
      q.initial = pairs_file.parent_path() / pair.at("initial").get<std::string>();
      q.target = pairs_file.parent_path() / pair.at("target").get<std::string>();
      std::printf("%s\n", name.c_str());
      bad += measure(q);
    }
    if (!known) std::printf("%s: not in the list\n", name.c_str());
    bad += !known;
  }
  return bad == 0 ? 0 : 1;
}
