#include "planner/reuse/reuse.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "planner/machine/kinematics.h"
#include "planner/reuse/candidate_planes.h"
#include "planner/reuse/exact_plan.h"
#include "planner/reuse/feasible_offset.h"
#include "planner/reuse/fixture.h"
#include "planner/reuse/local_search.h"
#include "planner/reuse/setup.h"
#include "planner/reuse/volumes.h"

namespace reforge {
namespace {

constexpr int kEvenDirections = 100;
constexpr double kSampleDistance = 2;  // mm, of S_S and S_A
constexpr double kReachPitch = 0.5;    // mm
// The search keeps clear of its sampled obstacles by these shares of their pitch; after a failed
// audit by another step where it failed.
constexpr double kClearance = 0.3, kLowered = 0.3, kLearningStep = 0.25;

using Outcome = std::variant<ReusePlan, Infeasible>;

struct Work {  // by effort
  int chains, steps;
  double samples;  // of V~_R
  int audits;      // at most
};
Work work_for(Effort effort) {
  switch (effort) {
    case Effort::kFast:
      return {2, 1500, 6000, 10};
    case Effort::kDefault:
      return {4, 5000, 9000, 12};
    case Effort::kHigh:
      return {16, 20000, 14000, 30};
  }
  return {4, 5000, 9000, 12};
}

// The paper asks only that something still stands on the base.
constexpr double kPaperFoot = 0.1;

// One placed pair on its way to a plan.
class Planning {
 public:
  Planning(const LoadedPart& initial, const PlacedTarget& target, const RigDescription& rig,
           const ReuseOptions& options, StageTimes& times)
      : initial_(initial),
        target_(target),
        rig_(rig),
        options_(options),
        times_(times),
        tools_(tool_bodies(rig, options.mode)),
        work_(work_for(options.effort)),
        deadline_(std::chrono::steady_clock::now() +
                  std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                      std::chrono::duration<double>(options.time_limit_s))) {}

  Result<Outcome> run();

 private:
  void report(std::string_view what, double best = 0) const {
    if (options_.progress) options_.progress(what, best);
  }
  bool stop() const {
    if (options_.should_stop && options_.should_stop()) return true;
    return options_.time_limit_s > 0 && std::chrono::steady_clock::now() > deadline_;
  }
  Infeasible infeasible(std::vector<std::string> reasons) const;
  std::optional<Infeasible> prepare();
  std::vector<Vec3> directions_with_bases() const;
  ClippingModel make_model() const;
  Clipping first_stage(const ClippingModel& model);
  std::vector<Clipping> searched(const ClippingModel& model, const std::vector<Clipping>& starts,
                                 const SearchOptions& options);
  bool prove(ClippingModel& model, const Clipping& clipping);
  void prove_best(ClippingModel& model, std::vector<Clipping> found);
  void prove_lower_and_lower(ClippingModel& model);
  Outcome finish();
  Result<Outcome> search();

  const LoadedPart& initial_;
  const PlacedTarget& target_;
  const RigDescription& rig_;
  const ReuseOptions& options_;
  StageTimes& times_;
  ToolBodies tools_;
  Work work_;
  std::chrono::steady_clock::time_point deadline_;

  CellComplex complex_;  // V~_R, V~_S, V~_A; loose pieces of V~_R are V_T already
  std::vector<bool> is_skin_;
  TriangleMesh standing_;  // V~_R without loose pieces
  TriangleMesh fixture_;
  double target_volume_ = 0;
  std::vector<BaseComponent> bases_;
  std::vector<Vec3> directions_;
  std::vector<SurfaceSample> samples_;
  ReachTable reach_;
  ReusePlan plan_;  // filled as things become known

  std::vector<std::string> faults_;  // of the last audit

  // The best that stood the audit so far.
  ExactClipping exact_;
  AuditResult proof_;
  double proven_ = 0;  // its V_R / M*
};

Infeasible Planning::infeasible(std::vector<std::string> reasons) const {
  Infeasible answer;
  answer.reasons = std::move(reasons);
  answer.initial = plan_.initial;
  answer.target = plan_.target;
  answer.ideal_reused = plan_.ideal_reused;
  answer.ideal_removed = plan_.ideal_removed;
  answer.ideal_added = plan_.ideal_added;
  answer.initial_placement = plan_.initial_placement;
  answer.target_placement = plan_.target_placement;
  answer.setup = plan_.setup;
  answer.ratio_ideal = plan_.ratio_ideal;
  return answer;
}

// Everything the search needs. An answer means that there is nothing to search for.
std::optional<Infeasible> Planning::prepare() {
  plan_.ideal_reused = surface_of(complex_, in(kReused));
  plan_.ideal_removed = surface_of(complex_, in(kRemoved));
  plan_.ideal_added = surface_of(complex_, in(kAdded));
  target_volume_ = volume(target_.mesh);
  plan_.ratio_ideal = volume(plan_.ideal_reused) / target_volume_;
  const double loose = set_loose_pieces_free(complex_);
  standing_ = surface_of(complex_, in(kReused));
  if (standing_.empty()) {
    return infeasible(
        {"Nothing that both parts have in common stands on the base, so nothing can be reused."});
  }
  if (loose > 0) {
    plan_.notes.push_back("Pieces of the common volume that do not stand on the base (" +
                          std::to_string(loose) + " mm^3) are removed and printed anew.");
  }
  if (options_.mode == Mode::kStrict) {
    auto fixture = make_fixture(standing_, rig_);
    if (!fixture) {
      return infeasible(
          {"The foot that both parts have in common is too small for the pedestal: it must be "
           "wider than " +
           std::to_string(rig_.pedestal.minimum_width_mm + 2 * rig_.pedestal.inset_mm) + " mm."});
    }
    fixture_ = std::move(*fixture);
  }
  for (const Vec3& direction : hemisphere_directions(kEvenDirections)) {
    const bool reachable =
        options_.mode == Mode::kPaper || !rotary_solutions(rig_, direction, {}).empty();
    if (reachable) directions_.push_back(direction);
  }
  if (directions_.empty())
    return infeasible({"The rotary axes cannot turn the part to any tool direction."});
  bases_ = printing_bases(complex_, is_skin_);
  double lowest = bounds(initial_.mesh).max().z();
  for (const auto& base : bases_) lowest = std::min(lowest, base.lowest_z);
  plan_.base_height_ratio = lowest / bounds(initial_.mesh).max().z();
  samples_ = sample_borders(complex_, is_skin_, kSampleDistance, options_.seed);
  const TriangleMesh* obstacles[] = {&standing_, &fixture_};
  BitSet to_cut(samples_.size()), to_print(samples_.size());
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const bool may_go = samples_[i].borders_reused();
    if (samples_[i].needs_cutter(false) || (may_go && samples_[i].needs_cutter(true)))
      to_cut.set(i);
    if (samples_[i].needs_nozzle(false) || (may_go && samples_[i].needs_nozzle(true)))
      to_print.set(i);
  }
  reach_ =
      reach_of(samples_, to_cut, to_print, directions_with_bases(), obstacles, tools_, kReachPitch);
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    if (is_beneath_base(samples_[i], tools_.ball_radius_mm)) reach_.cutter_anywhere.set(i);
    plan_.inaccessible_cutter_points +=
        samples_[i].needs_cutter(false) && !reach_.cutter_anywhere.test(i);
    plan_.inaccessible_nozzle_points +=
        samples_[i].needs_nozzle(false) && !reach_.nozzle_anywhere.test(i);
  }
  return std::nullopt;
}

std::vector<Vec3> Planning::directions_with_bases() const {
  std::vector<Vec3> directions = directions_;
  const auto own = facet_directions(bases_);
  directions.insert(directions.end(), own.begin(), own.end());
  return directions;
}

ClippingModel Planning::make_model() const {
  const double pitch = std::max(0.4, std::cbrt(volume(standing_) / work_.samples));
  ClippingOptions options;
  options.clearance_mm = kClearance * pitch;
  options.lowered_mm = kLowered * pitch;
  if (options_.mode == Mode::kPaper) options.foot_kept = kPaperFoot;
  // Points on V~_R's own surface are judged as the audit judges them: samples lie within it.
  options.watched_extra_mm = -2 * kClearance * pitch;
  ClippingModel model(standing_, pitch, tools_, fixture_, directions_with_bases(), options);
  for (const auto& base : bases_) model.add_base(base, candidate_normals(base, kEvenDirections));
  model.watch(samples_, reach_);
  model.add_blocker_slots(8);
  model.add_top_slot();
  return model;
}

// Where the search begins: the set cover's choice.
Clipping Planning::first_stage(const ClippingModel& model) {
  Clipping start = model.combine(first_choice(model).cuts);
  model.count_blocked(start);
  for (const auto& cut : start.cuts) plan_.global_planes += cut != nullptr;
  plan_.ratio_initialised = static_cast<double>(start.kept) /
                            static_cast<double>(model.samples().size()) * volume(standing_) /
                            target_volume_;
  return start;
}

// Whether the exact volumes of a clipping stand the audit. If not, the model learns what was wrong.
bool Planning::prove(ClippingModel& model, const Clipping& clipping) {
  ++plan_.effort_spent.audits;
  const Clipping lean = pruned(model, clipping);
  auto exact = realise(complex_, model, lean);
  if (!exact) {
    ++plan_.effort_spent.audits_failed;
    faults_ = {exact.error().sentence};
    return false;
  }
  const AuditSettings settings{
      tools_,
      fixture_,
      directions_,
      is_skin_,
      options_.mode == Mode::kPaper,
      kSampleDistance,
      kReachPitch,
      options_.seed + static_cast<std::uint64_t>(plan_.effort_spent.audits)};
  AuditResult audited = audit(exact->complex, settings);
  if (!audited.passed()) {
    ++plan_.effort_spent.audits_failed;
    faults_ = audited.faults;
    // What fails again and again is given more and more room.
    const double step = kLearningStep * model.samples().grid.pitch_mm *
                        std::pow(1.2, plan_.effort_spent.audits_failed - 1);
    model.require(audited.bad_origins);
    model.watch_closely(audited.blocked, step - kClearance * model.samples().grid.pitch_mm);
    std::sort(audited.blocked_caps.begin(), audited.blocked_caps.end());
    audited.blocked_caps.erase(
        std::unique(audited.blocked_caps.begin(), audited.blocked_caps.end()),
        audited.blocked_caps.end());
    for (const auto slot : audited.blocked_caps) model.widen_caps(slot, step);
    return false;
  }
  const double share = volume_of(exact->complex, kReused) / target_volume_;
  if (share > proven_) {
    proven_ = share;
    plan_.sampled_error =
        static_cast<double>(lean.kept) * model.samples().voxel_volume() / (share * target_volume_) -
        1;
    exact_ = std::move(*exact);
    proof_ = std::move(audited);
  }
  return true;
}

Outcome Planning::finish() {
  const AuditResult& audited = proof_;
  plan_.reused = surface_of(exact_.complex, in(kReused));
  plan_.removed = surface_of(exact_.complex, in(kRemoved) | in(kThenAdded));
  plan_.added = surface_of(exact_.complex, in(kAdded) | in(kThenAdded));
  plan_.then_added = surface_of(exact_.complex, in(kThenAdded));
  plan_.planes = exact_.planes;
  plan_.bases = audited.bases;
  plan_.cutter_directions = audited.cutter_directions;
  plan_.nozzle_directions = audited.nozzle_directions;
  plan_.audit = audited.counts;
  plan_.ratio_final = volume(plan_.reused) / target_volume_;
  plan_.local_planes = static_cast<int>(plan_.planes.size());
  if (options_.mode == Mode::kStrict) {
    auto fixture = make_fixture(plan_.reused, rig_);
    if (!fixture) {
      return infeasible(
          {"The foot that would be left is too small for the pedestal: it must be wider than " +
           std::to_string(rig_.pedestal.minimum_width_mm + 2 * rig_.pedestal.inset_mm) + " mm."});
    }
    plan_.fixture = std::move(*fixture);
  }
  if (audited.counts.beneath_base > 0) {
    plan_.notes.push_back(
        std::to_string(audited.counts.beneath_base) +
        " sample points lie so near the table that no ball cutter can touch them; material up "
        "to " +
        std::to_string(tools_.ball_radius_mm) + " mm high may stay there.");
  }
  return plan_;
}

// All clippings again under what the model has learned; those still feasible, the best first.
std::vector<Clipping> reconsidered(const ClippingModel& model, std::vector<Clipping> clippings) {
  for (Clipping& clipping : clippings) {
    for (auto& cut : clipping.cuts) {
      if (cut) cut = model.afresh(*cut);
    }
    clipping = model.combine(std::move(clipping.cuts));
    model.count_blocked(clipping);
  }
  std::erase_if(clippings, [](const Clipping& clipping) { return !clipping.feasible(); });
  std::stable_sort(clippings.begin(), clippings.end(),
                   [](const Clipping& a, const Clipping& b) { return a.kept > b.kept; });
  return clippings;
}

// Audits the best clipping; what fails is mended by a short search near it, until the best that is
// left has been proven.
void Planning::prove_best(ClippingModel& model, std::vector<Clipping> found) {
  for (int attempt = 0; attempt < work_.audits && !found.empty(); ++attempt) {
    const Clipping best = found.front();
    const double share =
        static_cast<double>(best.kept) * model.samples().voxel_volume() / target_volume_;
    if (share <= proven_) return;
    {
      StageTimer timer(times_, "audit");
      report("audit", proven_);
      if (prove(model, best)) return;
    }
    StageTimer timer(times_, "search");
    SearchOptions mend;
    mend.seed = options_.seed + 101 * static_cast<std::uint64_t>(attempt + 1);
    mend.chains = 2;
    mend.steps = work_.steps / 8;
    mend.heat = 0.15;
    mend.should_stop = [this] { return stop(); };
    Clipping again;
    for (const auto& cut : best.cuts) again.cuts.push_back(cut ? model.afresh(*cut) : nullptr);
    again = model.combine(std::move(again.cuts));
    model.count_blocked(again);
    auto mended = searched(model, {again}, mend);
    if (found.size() > 20) found.resize(20);
    found.insert(found.end(), std::make_move_iterator(mended.begin()),
                 std::make_move_iterator(mended.end()));
    found = reconsidered(model, std::move(found));
    if (found.empty()) {
      // Not mended nearby: from farther away, and from what is surely feasible.
      std::vector<Clipping> starts{again};
      if (auto offset = feasible_offset(model, again)) starts.push_back(std::move(*offset));
      mend.steps = work_.steps / 2;
      mend.heat = 1;
      mend.seed += 53;
      found = searched(model, starts, mend);
    }
  }
}

// When nothing else stands the audit: one level cut through everything, deeper until it does.
void Planning::prove_lower_and_lower(ClippingModel& model) {
  StageTimer timer(times_, "audit");
  constexpr int kLevels = 12;
  const std::size_t top = model.slots().size() - 1;  // added last
  const double height = model.highest_offset(model.slots()[top], Vec3::UnitZ());
  for (int level = 0; level < kLevels && proven_ == 0; ++level) {
    std::vector<std::shared_ptr<Cut>> cuts(model.slots().size());
    cuts[top] = model.cut(top, {Vec3::UnitZ(), height * (kLevels - level) / (kLevels + 1.0)});
    if (!cuts[top]) continue;
    Clipping clipping = model.combine(std::move(cuts));
    model.count_blocked(clipping);
    if (clipping.kept > 0 && clipping.uncovered == 0) prove(model, clipping);
  }
}

std::vector<Clipping> Planning::searched(const ClippingModel& model,
                                         const std::vector<Clipping>& starts,
                                         const SearchOptions& options) {
  SearchResult result = local_search(model, starts, options, 40);
  plan_.effort_spent.volume_evaluations += result.volume_evaluations;
  plan_.effort_spent.feasibility_checks += result.feasibility_checks;
  return std::move(result.found);
}

Result<Outcome> Planning::search() {
  std::optional<ClippingModel> model;
  std::optional<Clipping> start;
  {
    StageTimer timer(times_, "init");
    model = make_model();
    start = first_stage(*model);
  }
  std::vector<Clipping> found;
  if (start->feasible() && start->kept == model->samples().size()) {
    found.push_back(*start);
  } else {
    StageTimer timer(times_, "search");
    report("search", 0);
    SearchOptions search;
    search.seed = options_.seed;
    search.chains = work_.chains;
    search.steps = work_.steps;
    search.should_stop = [this] { return stop(); };
    // Half of the chains begin with what is wanted, half with what is feasible.
    std::vector<Clipping> starts{*start};
    if (auto offset = feasible_offset(*model, *start)) starts.push_back(std::move(*offset));
    found = searched(*model, starts, search);
  }
  if (found.empty()) {
    faults_.push_back("With every position of the planes tried, " + std::to_string(start->blocked) +
                      " points stay out of reach and " + std::to_string(start->uncovered) +
                      " printing bases cannot be replaced.");
  }
  prove_best(*model, std::move(found));
  if (proven_ == 0) prove_lower_and_lower(*model);
  if (proven_ == 0 && options_.should_stop && options_.should_stop()) {
    return Error{Code::kInterrupted, "Stopped before a feasible plan was found."};
  }
  if (proven_ > 0) return finish();
  return Outcome(infeasible(faults_));
}

Result<Outcome> Planning::run() {
  plan_.initial = initial_.mesh;
  plan_.target = target_.mesh;
  plan_.initial_placement = initial_.placement;
  plan_.target_placement = target_.placement;
  plan_.setup = target_.setup;
  {
    StageTimer timer(times_, "volumes");
    report("volumes");
    auto volumes = ideal_volumes(initial_.mesh, target_.mesh);
    if (!volumes) return volumes.error();
    complex_ = std::move(volumes->complex);
    is_skin_ = std::move(volumes->is_skin);
    plan_.dropped_mm3 = volumes->dropped_mm3;
  }
  {
    StageTimer timer(times_, "init");
    report("init");
    if (auto answer = prepare()) return Outcome(std::move(*answer));
  }
  return search();
}

}  // namespace

Result<Outcome> plan_reuse(const LoadedPart& initial, const LoadedPart& target,
                           const RigDescription& rig, const ReuseOptions& options,
                           StageTimes& times) {
  std::vector<std::string> reasons;
  std::vector<PlacedTarget> candidates;
  {
    StageTimer timer(times, "setup");
    candidates = place_target(initial, target, rig, options.setup, reasons);
  }
  std::optional<Outcome> answer;
  for (const PlacedTarget& candidate : candidates) {
    auto outcome = Planning(initial, candidate, rig, options, times).run();
    if (!outcome && outcome.error().code == Code::kBooleanFailed &&
        &candidate != &candidates.back()) {
      continue;  // another pose may have volumes
    }
    if (!outcome) return outcome.error();
    if (std::holds_alternative<ReusePlan>(*outcome)) return outcome;
    if (!answer) answer = std::move(*outcome);
  }
  if (answer) return std::move(*answer);
  Infeasible infeasible;
  infeasible.reasons = std::move(reasons);
  infeasible.initial = initial.mesh;
  infeasible.target = target.mesh;
  return Outcome(std::move(infeasible));
}

}  // namespace reforge
