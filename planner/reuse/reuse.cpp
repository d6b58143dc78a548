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
constexpr int kRounds = 5;             // search, audit, learn
constexpr std::size_t kAuditsARound = 4;
constexpr double kGoodEnough = 0.97;  // of the best the search found, for a proven plan to end it

using Outcome = std::variant<ReusePlan, Infeasible>;

struct Work {  // by effort
  int chains, steps;
  double samples;  // of V~_R
};
Work work_for(Effort effort) {
  switch (effort) {
    case Effort::kFast:
      return {2, 1200, 6000};
    case Effort::kDefault:
      return {4, 4000, 9000};
    case Effort::kHigh:
      return {12, 8000, 14000};
  }
  return {4, 4000, 9000};
}

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
  ClippingModel make_model(int round) const;
  Clipping start_of(const ClippingModel& model, int round);
  bool prove(const ClippingModel& model, const Clipping& clipping);
  void prove_best(const ClippingModel& model, const std::vector<Clipping>& found);
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

  // What failed audits taught.
  std::vector<SurfaceSample> blocked_;
  std::vector<std::uint32_t> bad_origins_;
  std::vector<std::string> faults_;
  std::vector<std::shared_ptr<Cut>> best_cuts_;

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
  const std::vector<Vec3> directions = directions_with_bases();
  reach_ =
      reach_table(samples_, BitSet(samples_.size()), directions, obstacles, tools_, kReachPitch);
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

ClippingModel Planning::make_model(int round) const {
  ClippingOptions options;
  options.clearance_mm = 0.3 + 0.05 * round;
  const double pitch = std::max(0.4, std::cbrt(volume(standing_) / work_.samples));
  const std::vector<Vec3> directions = directions_with_bases();
  ClippingModel model(standing_, pitch, tools_, fixture_, directions, options);
  for (const auto& base : bases_) model.add_base(base, candidate_normals(base, kEvenDirections));
  model.require(bad_origins_);
  model.watch(samples_, reach_, false);
  model.watch(blocked_, reach_, true);
  model.add_blocker_slots(8);
  model.add_top_slot();
  return model;
}

// Where the search begins: the set cover's choice, later what the last round ended with.
Clipping Planning::start_of(const ClippingModel& model, int round) {
  std::vector<std::shared_ptr<Cut>> cuts(model.slots().size());
  if (round == 0 || best_cuts_.empty()) {
    cuts = first_choice(model).cuts;
  } else {
    for (std::size_t s = 0; s < std::min(cuts.size(), best_cuts_.size()); ++s) {
      if (s < bases_.size() && best_cuts_[s]) cuts[s] = model.cut(s, best_cuts_[s]->plane);
    }
  }
  Clipping start = model.combine(std::move(cuts));
  model.count_blocked(start);
  if (round > 0) return start;
  for (const auto& cut : start.cuts) plan_.global_planes += cut != nullptr;
  if (auto exact = realise(complex_, model, start)) {
    plan_.ratio_initialised = volume_of(exact->complex, kReused) / target_volume_;
  }
  return start;
}

// Whether the exact volumes of a clipping stand the audit. If not, what was wrong is remembered.
bool Planning::prove(const ClippingModel& model, const Clipping& clipping) {
  auto exact = realise(complex_, model, pruned(model, clipping));
  if (!exact) {
    faults_ = {exact.error().sentence};
    return false;
  }
  const AuditSettings settings{
      tools_,          fixture_,    directions_,      is_skin_, options_.mode == Mode::kPaper,
      kSampleDistance, kReachPitch, options_.seed + 1};
  AuditResult audited = audit(exact->complex, settings);
  if (!audited.passed()) {
    faults_ = audited.faults;
    blocked_.insert(blocked_.end(), audited.blocked.begin(), audited.blocked.end());
    bad_origins_.insert(bad_origins_.end(), audited.bad_origins.begin(), audited.bad_origins.end());
    return false;
  }
  const double share = volume_of(exact->complex, kReused) / target_volume_;
  if (share > proven_) {
    proven_ = share;
    exact_ = std::move(*exact);
    proof_ = std::move(audited);
  }
  return true;
}

// Audits the best clippings, clearly different ones, until one passes.
void Planning::prove_best(const ClippingModel& model, const std::vector<Clipping>& found) {
  std::size_t audits = 0, last_kept = 0;
  for (const Clipping& clipping : found) {
    const double share =
        static_cast<double>(clipping.kept) * model.samples().voxel_volume() / target_volume_;
    if (audits >= kAuditsARound || share < proven_) return;
    if (audits > 0 && static_cast<double>(clipping.kept) > 0.99 * static_cast<double>(last_kept))
      continue;
    last_kept = clipping.kept;
    ++audits;
    report("audit", proven_);
    if (prove(model, clipping)) return;
  }
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

Result<Outcome> Planning::search() {
  for (int round = 0; round < kRounds; ++round) {
    std::optional<ClippingModel> model;
    std::optional<Clipping> start;
    {
      StageTimer timer(times_, "init");
      model = make_model(round);
      start = start_of(*model, round);
    }
    StageTimer timer(times_, "search");
    std::vector<Clipping> found;
    const bool nothing_to_do = start->feasible() && start->kept == model->samples().size();
    if (nothing_to_do) {
      found.push_back(*start);
    } else {
      report("search", proven_);
      SearchOptions search;
      search.seed = options_.seed + static_cast<std::uint64_t>(round) * 101;
      search.chains = work_.chains;
      search.steps = round == 0 ? work_.steps : work_.steps / 2;
      search.heat = round == 0 ? 1 : 0.25;  // later rounds mend what the audit found
      search.should_stop = [this] { return stop(); };
      found = local_search(*model, *start, search, 40);
      if (auto offset = feasible_offset(*model, *start)) found.push_back(std::move(*offset));
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const Clipping& a, const Clipping& b) { return a.kept > b.kept; });
    if (!found.empty()) best_cuts_ = found.front().cuts;
    prove_best(*model, found);
    // A better one that only the audit refused may be mended now that more is known.
    const double hoped = found.empty() ? 0
                                       : static_cast<double>(found.front().kept) *
                                             model->samples().voxel_volume() / target_volume_;
    if (proven_ > 0 && (proven_ >= kGoodEnough * hoped || stop())) break;
    if (found.empty() && faults_.empty()) {
      faults_.push_back("With every position of the planes tried, " +
                        std::to_string(start->blocked) + " points stay out of reach and " +
                        std::to_string(start->uncovered) + " printing bases cannot be replaced.");
    }
    if (proven_ == 0 && options_.should_stop && options_.should_stop()) {
      return Error{Code::kInterrupted, "Stopped before a feasible plan was found."};
    }
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
  if (options.setup == Setup::kPaper) {
    return Error{Code::kUsage,
                 "The published setup procedure is not offered yet; use --setup search, centroids "
                 "or stored."};
  }
  std::vector<std::string> reasons;
  std::vector<PlacedTarget> candidates;
  {
    StageTimer timer(times, "setup");
    candidates = place_target(initial, target, rig, options.setup, reasons);
  }
  std::optional<Outcome> answer;
  for (const PlacedTarget& candidate : candidates) {
    auto outcome = Planning(initial, candidate, rig, options, times).run();
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
