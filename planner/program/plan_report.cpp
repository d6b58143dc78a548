#include "planner/program/plan_report.h"

#include <sys/resource.h>

#include <cmath>

namespace reforge {
namespace {

using nlohmann::json;

constexpr const char* kStages[] = {"load",   "setup",     "volumes", "init",   "search",
                                   "blocks", "toolpaths", "program", "verify", "total"};

double rounded(double value, double unit) {
  return std::round(value / unit) * unit;
}
double mm3(double value) {
  return std::round(value * 1e4) / 1e4;
}

json vector_of(const Vec3& v) {
  // -0 and rounding noise would differ between compilers.
  const auto clean = [](double x) { return std::round(x * 1e6) / 1e6 + 0.0; };
  return json::array({clean(v.x()), clean(v.y()), clean(v.z())});
}

double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return rounded(static_cast<double>(usage.ru_maxrss) / 1024, 0.1);
}

const char* name_of(Setup setup) {
  switch (setup) {
    case Setup::kSearch:
      return "search";
    case Setup::kPaper:
      return "paper";
    case Setup::kCentroids:
      return "centroids";
    case Setup::kStored:
      return "stored";
  }
  return "";
}
const char* name_of(Effort effort) {
  switch (effort) {
    case Effort::kFast:
      return "fast";
    case Effort::kDefault:
      return "default";
    case Effort::kHigh:
      return "high";
  }
  return "";
}

json rows_of(const Eigen::Matrix3d& rotation) {
  const auto clean = [](double x) { return std::round(x * 1e9) / 1e9 + 0.0; };
  json rows = json::array();
  for (int i = 0; i < 3; ++i) {
    rows.push_back({clean(rotation(i, 0)), clean(rotation(i, 1)), clean(rotation(i, 2))});
  }
  return rows;
}

json common_part(const PlanFacts& facts, const Placement& initial, const Placement& target) {
  json seconds, cpu_seconds;
  for (const char* stage : kStages) seconds[stage] = cpu_seconds[stage] = 0.0;
  for (const StageTime& time : facts.times.stages) {
    seconds[time.stage] = rounded(time.seconds, 1e-3);
    cpu_seconds[time.stage] = rounded(time.cpu_seconds, 1e-3);
  }
  const PlanRequest& request = facts.request;
  return {{"format", "reforge-plan 1"},
          {"mode", request.mode == Mode::kPaper ? "paper" : "strict"},
          {"setup", name_of(request.setup)},
          {"effort", name_of(request.effort)},
          {"seed", request.seed},
          {"seconds", seconds},
          {"cpu_seconds", cpu_seconds},
          {"peak_mib", peak_mib()},
          {"versions", {{"reforge", REFORGE_VERSION}, {"format", 1}}},
          {"sha256",
           {{"initial_input", facts.initial_sha256},
            {"target_input", facts.target_sha256},
            {"rig", facts.rig.sha256},
            {"program", facts.program_sha256}}},
          {"placement",
           {{"initial_translation", vector_of(initial.translation)},
            {"initial_turned_deg", initial.turned ? 90 : 0},
            {"target_rotation", rows_of(target.rotation)},
            {"target_translation", vector_of(target.translation)},
            {"target_turned_deg", target.turned ? 90 : 0}}},
          {"notes", facts.notes}};
}

double ratio(double value) {
  return std::round(value * 1e6) / 1e6;
}

}  // namespace

std::string feasible_report(const PlanFacts& facts, const ReusePlan& plan,
                            const std::vector<BlockReport>& blocks, const Program& program) {
  json report = common_part(facts, plan.initial_placement, plan.target_placement);
  json list = json::array(), milling = json::array(), printing = json::array();
  int milled = 0, printed = 0;
  for (const BlockReport& block : blocks) {
    const bool mill = block.kind == BlockKind::kMill;
    ++(mill ? milled : printed);
    const json direction = vector_of(block.direction);
    json& directions = mill ? milling : printing;
    if (std::find(directions.begin(), directions.end(), direction) == directions.end()) {
      directions.push_back(direction);
    }
    list.push_back({{"kind", mill ? "mill" : "print"},
                    {"direction", direction},
                    {"volume_mm3", mm3(block.volume_mm3)},
                    {"path_mm", rounded(block.figures.path_mm, 1e-3)},
                    {"seconds", rounded(block.figures.seconds, 1e-3)},
                    {"file", block.file}});
  }
  report["setup"] = plan.setup.empty() ? report["setup"] : json(plan.setup);
  report["results"] = {{"B", ratio(plan.base_height_ratio)},
                       {"P_S", plan.inaccessible_cutter_points},
                       {"P_A", plan.inaccessible_nozzle_points},
                       {"R_V", ratio(plan.ratio_ideal)},
                       {"R_I", ratio(plan.ratio_initialised)},
                       {"R_F", ratio(plan.ratio_final)},
                       {"C_b", plan.global_planes},
                       {"C_a", plan.local_planes},
                       {"B_S", milled},
                       {"B_A", printed}};
  report["volumes_mm3"] = {
      {"initial", mm3(volume(plan.initial))}, {"target", mm3(volume(plan.target))},
      {"reused", mm3(volume(plan.reused))},   {"removed", mm3(volume(plan.removed))},
      {"added", mm3(volume(plan.added))},     {"then_added", mm3(volume(plan.then_added))}};
  report["planes"] = json::array();
  for (const LocalPlane& local : plan.planes) {
    report["planes"].push_back({{"normal", vector_of(local.plane.normal)},
                                {"offset", rounded(local.plane.offset, 1e-6)},
                                {"seed", vector_of(local.seed)}});
  }
  report["directions"] = {{"milling", milling}, {"printing", printing}};
  report["blocks"] = list;
  report["extrusion"] = {{"filament_mm", rounded(program.filament_mm, 1e-3)},
                         {"toggles", program.toggles},
                         {"retracts", program.retracts}};
  return report.dump(2) + "\n";
}

std::string infeasible_report(const PlanFacts& facts, const Infeasible& why) {
  json report = common_part(facts, why.initial_placement, why.target_placement);
  report["sha256"].erase("program");
  report["volumes_mm3"] = {{"initial", mm3(volume(why.initial))},
                           {"target", mm3(volume(why.target))}};
  report["results"] = {{"R_V", ratio(why.ratio_ideal)}};
  report["infeasible"] = {{"reasons", why.reasons}};
  return report.dump(2) + "\n";
}

}  // namespace reforge
