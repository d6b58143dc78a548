#include "planner/program/plan.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>

#include "planner/geometry/mesh_io.h"
#include "planner/program/fabricate.h"
#include "planner/program/job_folder.h"
#include "planner/program/plan_report.h"
#include "planner/program/post.h"
#include "planner/verify/verify.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

constexpr double kSearchShare = 0.6;  // of a time limit

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

class Chain {
 public:
  Chain(const PlanRequest& request, StageTimes& times) : request_(request), times_(times) {}

  Result<PlanOutcome> run();

 private:
  bool stopped() const { return request_.should_stop && request_.should_stop(); }
  void say(std::string_view stage, std::string_view what) const {
    if (request_.progress) request_.progress(stage, what);
  }
  Result<PlanOutcome> finish(const ReusePlan& plan, const Fabrication& made, JobDraft& draft);
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
};

Result<PlanOutcome> Chain::finish(const ReusePlan& plan, const Fabrication& made, JobDraft& draft) {
  const std::pair<const char*, const TriangleMesh*> meshes[] = {
      {"initial.stl", &plan.initial}, {"target.stl", &plan.target}, {"reused.stl", &plan.reused},
      {"removed.stl", &plan.removed}, {"added.stl", &plan.added},   {"fixture.stl", &plan.fixture}};
  for (const auto& [name, mesh] : meshes) {
    if (const Status done = draft.write(name, *mesh); !done) return done.error();
  }
  std::vector<BlockReport> blocks;
  for (size_t i = 0; i < made.toolpaths.size(); ++i) {
    const BlockToolpath& toolpath = made.toolpaths[i];
    char name[48];
    std::snprintf(name, sizeof name, "blocks/%02zu-%s.stl", i + 1,
                  toolpath.kind == BlockKind::kMill ? "mill" : "print");
    blocks.push_back({toolpath.kind, toolpath.frame.d, made.solids[i].volume_mm3, name, {}});
    if (const Status done = draft.write(name, made.solids[i].solid); !done) return done.error();
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
    Result<Program> posted = post_program(rig_, job, made.toolpaths);
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
  for (size_t i = 0; i < blocks.size(); ++i) blocks[i].figures = program.blocks[i];

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
  notes.insert(notes.end(), made.notes.begin(), made.notes.end());
  notes.insert(notes.end(), program.notes.begin(), program.notes.end());
  total_.reset();
  outcome.json =
      feasible_report(facts(sha256_hex(program.text), std::move(notes)), plan, blocks, program);
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
    const Result<Fabrication> made =
        fabricate(plan, rig_, request_.mode, {request_.progress, request_.should_stop}, times_);
    if (!made) return made.error();
    return finish(plan, *made, *draft);
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
