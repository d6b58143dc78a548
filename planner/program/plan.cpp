#include "planner/program/plan.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>

#include "planner/blocks/additive_blocks.h"
#include "planner/blocks/milled_blocks.h"
#include "planner/blocks/subtractive_blocks.h"
#include "planner/blocks/voxel_solid.h"
#include "planner/geometry/mesh_io.h"
#include "planner/program/job_folder.h"
#include "planner/program/plan_report.h"
#include "planner/program/post.h"
#include "planner/toolpath/deposition.h"
#include "planner/verify/verify.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

constexpr double kSurfaceSpacing = 0.5;  // mm between samples of the machined surface
constexpr double kSearchShare = 0.6;     // of a time limit
constexpr double kWorthANote = 0.5;      // mm^3

std::string amount(double mm3) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f mm3", mm3);
  return text;
}

Error interrupted_error() {
  return {Code::kInterrupted, "stopped before the job was complete; nothing was written"};
}

Result<std::string> bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream bytes;
  bytes << in.rdbuf();
  if (!in) return Error{Code::kUnreadable, file.string() + ": cannot be read"};
  return bytes.str();
}

// What the stages after the reuse chain make.
struct Work {
  std::vector<BlockToolpath> toolpaths;
  std::vector<BlockReport> blocks;
  std::vector<TriangleMesh> solids;  // of the blocks
  std::vector<std::string> notes;
};

class Chain {
 public:
  Chain(const PlanRequest& request, StageTimes& times) : request_(request), times_(times) {}

  Result<PlanOutcome> run();

 private:
  bool stopped() const { return request_.should_stop && request_.should_stop(); }
  void say(std::string_view stage, std::string_view what) const {
    if (request_.progress) request_.progress(stage, what);
  }
  Status mill(const ReusePlan& plan, Work& work);
  Status print(const ReusePlan& plan, Work& work);
  Result<PlanOutcome> finish(const ReusePlan& plan, Work work, JobDraft& draft);
  Result<PlanOutcome> give_up(const Infeasible& why, JobDraft& draft);
  PlanFacts facts(const std::string& program_sha256, std::vector<std::string> notes) const {
    return {request_,         rig_,  initial_sha256_, target_sha256_, program_sha256,
            std::move(notes), times_};
  }

  const PlanRequest& request_;
  StageTimes& times_;
  std::optional<StageTimer> total_;  // ends before the report is written
  RigDescription rig_;
  std::string initial_sha256_, target_sha256_;
  std::vector<std::string> load_notes_;
  TriangleMesh leftover_;  // stock that milling had to leave, strict mode's obstacles
};

Status Chain::mill(const ReusePlan& plan, Work& work) {
  const MillingOptions options = milling_options(rig_, request_.mode);
  const Surroundings solids{plan.initial, plan.reused, plan.fixture};
  PartStock stock;
  std::vector<MachinedSample> surface;
  std::vector<Vec3> directions;
  {
    const StageTimer timer(times_, "blocks");
    say("blocks", "finding milling directions");
    stock = part_stock(plan.initial, plan.reused);
    surface = machined_surface(plan.reused, plan.removed, kSurfaceSpacing);
    directions = milling_directions(
        options, solids, stock, surface, plan.cutter_directions, [&](const Vec3& d) {
          return request_.mode == Mode::kPaper || !rotary_solutions(rig_, d, {}).empty();
        });
  }
  Milling milling;
  {
    const StageTimer timer(times_, "toolpaths");
    milling = mill_blocks(
        options, solids, surface, directions, [&] { return stopped(); },
        [&](const std::string& what) { say("toolpaths", what); }, stock);
  }
  if (stopped()) return interrupted_error();
  const StageTimer timer(times_, "blocks");
  for (MilledBlock& block : milling.blocks) {
    work.blocks.push_back({BlockKind::kMill, block.toolpath.frame.d, block.removed_mm3, "", {}});
    work.toolpaths.push_back(std::move(block.toolpath));
    work.solids.push_back(voxel_solid(stock.voxels, block.removed));
  }
  BitSet left = stock.rest();
  left.subtract(stock.near_keep);
  if (request_.mode == Mode::kStrict) leftover_ = voxel_solid(stock.voxels, left);
  if (milling.left_mm3 > kWorthANote) {
    work.notes.push_back("milling leaves " + amount(milling.left_mm3) +
                         " of the removed volume standing, where no chosen direction reaches it");
  }
  if (!surface.empty()) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "of %zu samples of the milled surface the ball can touch %zu; %zu were finished",
                  milling.samples, milling.samples_touchable, milling.samples_finished);
    work.notes.emplace_back(text);
  }
  return Unit{};
}

Status Chain::print(const ReusePlan& plan, Work& work) {
  const DepositionOptions options = deposition_options(rig_, request_.mode);
  const bool strict = request_.mode == Mode::kStrict;
  Result<std::vector<AdditiveBlock>> blocks = [&] {
    const StageTimer timer(times_, "blocks");
    say("blocks", "taking the added volume apart");
    PrintScene scene{plan.target, {&plan.reused}, plan.nozzle_directions, strict};
    if (!plan.fixture.empty()) scene.obstacles.push_back(&plan.fixture);
    return additive_blocks(plan.added, plan.bases, options.nozzle, scene);
  }();
  if (!blocks) return blocks.error();
  const StageTimer timer(times_, "toolpaths");
  std::vector<const TriangleMesh*> ground{&plan.reused};
  // The paper's nozzle minds V_R alone; the rig's minds everything that stands.
  std::vector<const TriangleMesh*> obstacles{&plan.reused};
  if (strict) obstacles.insert(obstacles.end(), {&plan.fixture, &leftover_});
  double unsupported = 0, blocked = 0;
  std::vector<TriangleMesh> solids;
  for (size_t i = 0; i < blocks->size(); ++i) {
    say("toolpaths", "printing " + std::to_string(i + 1) + " of " + std::to_string(blocks->size()));
    const AdditiveBlock& block = (*blocks)[i];
    BlockToolpath toolpath;
    toolpath.kind = BlockKind::kPrint;
    toolpath.frame = Frame::along(block.direction);
    Deposition deposition =
        deposit(options, block.solid, toolpath.frame, ground, obstacles, [&] { return stopped(); });
    if (stopped()) return interrupted_error();
    unsupported += deposition.unsupported_mm3 + deposition.hanging_mm3;
    blocked += deposition.blocked_mm3;
    ground.push_back(&block.solid);
    if (strict) obstacles.push_back(&block.solid);
    if (deposition.paths.empty()) continue;
    toolpath.paths = std::move(deposition.paths);
    work.blocks.push_back({BlockKind::kPrint, block.direction, volume(block.solid), "", {}});
    work.toolpaths.push_back(std::move(toolpath));
    work.solids.push_back(block.solid);
  }
  if (unsupported > kWorthANote) {
    work.notes.push_back(
        amount(unsupported) +
        " of the added volume hang over more than layers can carry and are left out");
  }
  if (blocked > kWorthANote) {
    work.notes.push_back(amount(blocked) +
                         " of the added volume cannot be reached by the nozzle and are left out");
  }
  return Unit{};
}

Result<PlanOutcome> Chain::finish(const ReusePlan& plan, Work work, JobDraft& draft) {
  const std::pair<const char*, const TriangleMesh*> meshes[] = {
      {"initial.stl", &plan.initial}, {"target.stl", &plan.target}, {"reused.stl", &plan.reused},
      {"removed.stl", &plan.removed}, {"added.stl", &plan.added},   {"fixture.stl", &plan.fixture}};
  for (const auto& [name, mesh] : meshes) {
    if (const Status done = draft.write(name, *mesh); !done) return done.error();
  }
  for (size_t i = 0; i < work.blocks.size(); ++i) {
    char name[48];
    std::snprintf(name, sizeof name, "blocks/%02zu-%s.stl", i + 1,
                  work.blocks[i].kind == BlockKind::kMill ? "mill" : "print");
    work.blocks[i].file = name;
    if (const Status done = draft.write(name, work.solids[i]); !done) return done.error();
  }
  const Result<std::string> stock_sha256 = sha256_of_file(draft.folder() / "initial.stl");
  if (!stock_sha256) return stock_sha256.error();

  Program program;
  {
    const StageTimer timer(times_, "program");
    say("program", "writing");
    PostJob job{std::filesystem::absolute(request_.job).lexically_normal().filename().string(),
                request_.mode,
                *stock_sha256,
                {&plan.initial, &plan.target}};
    if (!plan.fixture.empty()) job.solids.push_back(&plan.fixture);
    Result<Program> posted = post_program(rig_, job, work.toolpaths);
    if (!posted) {
      if (posted.error().code != Code::kUnreachable) return posted.error();
      Infeasible why;
      why.reasons = {posted.error().sentence};
      why.initial = plan.initial;
      why.target = plan.target;
      why.initial_placement = plan.initial_placement;
      why.target_placement = plan.target_placement;
      why.ratio_ideal = plan.ratio_ideal;
      return give_up(why, draft);
    }
    program = std::move(*posted);
    if (const Status done = draft.write("program.nc", program.text); !done) return done.error();
  }
  for (size_t i = 0; i < work.blocks.size(); ++i) work.blocks[i].figures = program.blocks[i];
  work.notes.insert(work.notes.end(), program.notes.begin(), program.notes.end());

  PlanOutcome outcome;
  outcome.feasible = true;
  {
    const StageTimer timer(times_, "verify");
    VerifyOptions options;
    options.should_stop = request_.should_stop;
    options.progress = [&](size_t line) {
      say("verify", std::to_string(line) + " of " + std::to_string(program.lines) + " lines");
    };
    const Result<JobVerification> proof = verify_job(draft.folder(), options);
    if (!proof) return proof.error();
    outcome.verified = proof->verification.pass;
    for (const CertificateFinding& finding : proof->certificate.findings) {
      outcome.reasons.push_back("block " + std::to_string(finding.block) + ", line " +
                                std::to_string(finding.line) + ": " + finding.sentence + " (" +
                                std::to_string(finding.count) + " of " + finding.kind + ")");
    }
    if (const Status done = draft.write("certificate.json", canonical_json(proof->certificate));
        !done) {
      return done.error();
    }
  }
  std::vector<std::string> notes = load_notes_;
  notes.insert(notes.end(), plan.notes.begin(), plan.notes.end());
  notes.insert(notes.end(), work.notes.begin(), work.notes.end());
  total_.reset();
  outcome.json = feasible_report(facts(sha256_hex(program.text), std::move(notes)), plan,
                                 work.blocks, program);
  return outcome;
}

Result<PlanOutcome> Chain::give_up(const Infeasible& why, JobDraft& draft) {
  std::error_code absent;
  std::filesystem::remove(draft.folder() / "program.nc", absent);
  std::filesystem::remove_all(draft.folder() / "blocks", absent);
  const std::pair<const char*, const TriangleMesh*> meshes[] = {{"initial.stl", &why.initial},
                                                                {"target.stl", &why.target}};
  for (const auto& [name, mesh] : meshes) {
    if (const Status done = draft.write(name, *mesh); !done) return done.error();
  }
  PlanOutcome outcome;
  outcome.reasons = why.reasons;
  total_.reset();
  outcome.json = infeasible_report(facts("", load_notes_), why);
  return outcome;
}

Result<PlanOutcome> Chain::run() {
  Result<JobDraft> draft = JobDraft::begin(request_.job, request_.replace);
  if (!draft) return draft.error();
  total_.emplace(times_, "total");
  Result<PlanOutcome> outcome = [&]() -> Result<PlanOutcome> {
    LoadedPart initial, target;
    {
      const StageTimer timer(times_, "load");
      say("load", request_.initial.filename().string());
      Result<RigDescription> rig = read_rig(request_.rig);
      if (!rig) return rig.error();
      rig_ = std::move(*rig);
      for (const auto& [file, part, hash] :
           {std::tuple{&request_.initial, &initial, &initial_sha256_},
            std::tuple{&request_.target, &target, &target_sha256_}}) {
        Result<LoadedPart> loaded = load_part(*file, rig_);
        if (!loaded) return loaded.error();
        const Result<std::string> sha256 = sha256_of_file(*file);
        if (!sha256) return sha256.error();
        *hash = *sha256;
        *part = std::move(*loaded);
        load_notes_.insert(load_notes_.end(), part->notes.begin(), part->notes.end());
      }
      const Result<std::string> rig_bytes = bytes_of(request_.rig);
      if (!rig_bytes) return rig_bytes.error();
      if (const Status done = draft->write("rig.json", *rig_bytes); !done) return done.error();
    }
    ReuseOptions options;
    options.mode = request_.mode;
    options.setup = request_.setup;
    options.effort = request_.effort;
    options.seed = request_.seed;
    options.time_limit_s = request_.time_limit_s * kSearchShare;
    options.progress = [&](std::string_view what, double best) {
      char text[32] = "";
      if (best > 0) std::snprintf(text, sizeof text, ", best R_F %.3f", best);
      say("reuse", std::string(what) + text);
    };
    options.should_stop = request_.should_stop;
    auto reuse = plan_reuse(initial, target, rig_, options, times_);
    if (!reuse) return reuse.error();
    if (stopped()) return interrupted_error();
    if (const auto* why = std::get_if<Infeasible>(&*reuse)) return give_up(*why, *draft);
    const ReusePlan& plan = std::get<ReusePlan>(*reuse);
    Work work;
    if (const Status done = mill(plan, work); !done) return done.error();
    if (const Status done = print(plan, work); !done) return done.error();
    return finish(plan, std::move(work), *draft);
  }();
  if (!outcome) return outcome;
  if (stopped()) return interrupted_error();
  if (const Status done = draft->write("plan.json", outcome->json); !done) return done.error();
  if (const Status done = draft->publish(); !done) return done.error();
  return outcome;
}

}  // namespace

Result<PlanOutcome> plan(const PlanRequest& request) {
  StageTimes times;
  return Chain(request, times).run();
}

}  // namespace reforge
