// The reuse planner measured: for each pair the paper's columns, seconds by stage, memory, audits.
//
// From two mesh files to blocks (no toolpaths), each run in a process of its own so that memory and
// processor time are its own. Columns as in the paper's Tables 1 and 2. Beside Coral stand the
// paper's row and what the published code was measured to do on a machine like ours. Pairs: the
// file given by --pairs-file (a list like the shared models' pairs.json, meshes beside it), else
// the shared models where they are.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "planner/blocks/additive_blocks.h"
#include "planner/blocks/subtractive_blocks.h"
#include "planner/geometry/mesh_io.h"
#include "planner/machine/kinematics.h"
#include "planner/reuse/reuse.h"
#include "planner/toolpath/deposition.h"

namespace reforge {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

struct Request {
  fs::path initial, target, rig;
  ReuseOptions options;
};

// Sec. 6 without toolpaths: where to mill from, and V_A taken apart.
void make_blocks(const ReusePlan& plan, const RigDescription& rig, Mode mode, Json& row) {
  const MillingOptions milling = milling_options(rig, mode);
  const PartStock stock = part_stock(plan.initial, plan.reused);
  const auto surface = machined_surface(plan.reused, plan.removed, 0.5);
  const auto directions = milling_directions(
      milling, {plan.initial, plan.reused, plan.fixture}, stock, surface, plan.cutter_directions,
      [&](const Vec3& d) { return mode == Mode::kPaper || !rotary_solutions(rig, d, {}).empty(); });
  row["B_S"] = directions.size();
  const DepositionOptions deposition = deposition_options(rig, mode);
  PrintScene scene{plan.target, {&plan.reused}, plan.nozzle_directions, mode == Mode::kStrict};
  if (!plan.fixture.empty()) scene.obstacles.push_back(&plan.fixture);
  const auto blocks = additive_blocks(plan.added, plan.bases, deposition.nozzle, scene);
  row["B_A"] = blocks ? static_cast<int>(blocks->size()) : -1;
}

Json plan_pair(const Request& request) {
  Json row;
  const auto failed = [&](const std::string& why) {
    row["error"] = why;
    return row;
  };
  StageTimes times;
  const auto rig = read_rig(request.rig);
  if (!rig) return failed(rig.error().sentence);
  Result<LoadedPart> initial = Error{}, target = Error{};
  {
    const StageTimer timer(times, "load");
    initial = load_part(request.initial, *rig);
    target = load_part(request.target, *rig);
  }
  if (!initial) return failed(initial.error().sentence);
  if (!target) return failed(target.error().sentence);
  const auto outcome = plan_reuse(*initial, *target, *rig, request.options, times);
  if (!outcome) return failed(outcome.error().sentence);
  if (const auto* none = std::get_if<Infeasible>(&*outcome)) {
    row["R_V"] = none->ratio_ideal;
    row["infeasible"] = none->reasons;
  } else {
    const auto& plan = std::get<ReusePlan>(*outcome);
    const Vec3 size = bounds(plan.target).sizes();
    row["size"] = {size.x(), size.y(), size.z()};
    row["setup"] = plan.setup;
    row["B"] = plan.base_height_ratio;
    row["P_S"] = plan.inaccessible_cutter_points;
    row["P_A"] = plan.inaccessible_nozzle_points;
    row["R_V"] = plan.ratio_ideal;
    row["R_I"] = plan.ratio_initialised;
    row["R_F"] = plan.ratio_final;
    row["C_b"] = plan.global_planes;
    row["C_a"] = plan.local_planes;
    row["audit_points"] = plan.audit.cutter_points + plan.audit.nozzle_points;
    row["audit_blocked"] = plan.audit.cutter_blocked + plan.audit.nozzle_blocked;
    row["audits"] = plan.effort_spent.audits;
    row["audits_failed"] = plan.effort_spent.audits_failed;
    row["volume_evaluations"] = plan.effort_spent.volume_evaluations;
    row["feasibility_checks"] = plan.effort_spent.feasibility_checks;
    row["sampled_error"] = plan.sampled_error;
    const StageTimer timer(times, "blocks");
    make_blocks(plan, *rig, request.options.mode, row);
  }
  for (const StageTime& stage : times.stages) row["cpu_s"][stage.stage] = stage.cpu_seconds;
  return row;
}

// In a child process: what it wrote, its processor time and its greatest memory.
Json measured(const Request& request) {
  int ends[2];
  if (pipe(ends) != 0) return {{"error", "no pipe"}};
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    close(ends[0]);
    const std::string text = plan_pair(request).dump();
    const bool written =
        write(ends[1], text.data(), text.size()) == static_cast<ssize_t>(text.size());
    _exit(written ? 0 : 1);
  }
  close(ends[1]);
  std::string text;
  char buffer[4096];
  for (ssize_t got; (got = read(ends[0], buffer, sizeof buffer)) > 0;)
    text.append(buffer, static_cast<std::size_t>(got));
  close(ends[0]);
  int status = 0;
  rusage used{};
  wait4(child, &status, 0, &used);
  Json row = Json::parse(text, nullptr, false);
  if (row.is_discarded()) row = {{"error", "ended by signal " + std::to_string(WTERMSIG(status))}};
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  row["cpu_total_s"] = seconds(used.ru_utime) + seconds(used.ru_stime);
  row["mib"] = static_cast<double>(used.ru_maxrss) / 1024;
  return row;
}

double number(const Json& row, const char* key) {
  return row.contains(key) ? row.at(key).get<double>() : 0;
}

double stage(const Json& row, const char* key) {
  return row.contains("cpu_s") ? number(row.at("cpu_s"), key) : 0;
}

void print_header() {
  std::printf(
      "%-22s %4s %-11s %5s %4s %4s %5s %5s %5s %3s %3s %3s %3s | %6s %6s %6s %6s %6s %6s %6s"
      " | %4s %7s %7s %5s\n",
      "pair", "seed", "size", "B", "P_S", "P_A", "R_V", "R_I", "R_F", "C_b", "C_a", "B_S", "B_A",
      "setup", "volum", "init", "search", "audit", "blocks", "CPU s", "MiB", "vol/s", "check/s",
      "aud");
}

void print_row(const std::string& name, std::uint64_t seed, const Json& row) {
  if (row.contains("error") || row.contains("infeasible")) {
    const std::string why = row.contains("error") ? row.at("error").get<std::string>()
                                                  : row.at("infeasible").at(0).get<std::string>();
    std::printf("%-22s %4llu no plan (R_V %.3f, %.1f CPU s): %s\n", name.c_str(),
                static_cast<unsigned long long>(seed), number(row, "R_V"),
                number(row, "cpu_total_s"), why.c_str());
    return;
  }
  char size[40];
  std::snprintf(size, sizeof size, "%.0fx%.0fx%.0f", row.at("size")[0].get<double>(),
                row.at("size")[1].get<double>(), row.at("size")[2].get<double>());
  const double searching = std::max(1e-9, stage(row, "search"));
  std::printf(
      "%-22s %4llu %-11s %5.2f %4.0f %4.0f %5.3f %5.3f %5.3f %3.0f %3.0f %3.0f %3.0f | %6.2f "
      "%6.2f %6.2f %6.2f %6.2f %6.2f %6.2f | %4.0f %7.0f %7.0f %2.0f/%-2.0f\n",
      name.c_str(), static_cast<unsigned long long>(seed), size, number(row, "B"),
      number(row, "P_S"), number(row, "P_A"), number(row, "R_V"), number(row, "R_I"),
      number(row, "R_F"), number(row, "C_b"), number(row, "C_a"), number(row, "B_S"),
      number(row, "B_A"), stage(row, "setup"), stage(row, "volumes"), stage(row, "init"),
      stage(row, "search"), stage(row, "audit"), stage(row, "blocks"), number(row, "cpu_total_s"),
      number(row, "mib"), number(row, "volume_evaluations") / searching,
      number(row, "feasibility_checks") / searching, number(row, "audits_failed"),
      number(row, "audits"));
}

struct Pair {
  std::string name;
  fs::path initial, target;
};

std::vector<Pair> pairs_in(const fs::path& list) {
  std::vector<Pair> pairs;
  std::ifstream in(list);
  const Json json = Json::parse(in, nullptr, false);
  if (json.is_discarded()) return pairs;
  for (const Json& entry : json.at("pairs")) {
    pairs.push_back({entry.at("name").get<std::string>(),
                     list.parent_path() / entry.at("initial").get<std::string>(),
                     list.parent_path() / entry.at("target").get<std::string>()});
  }
  return pairs;
}

int run(int argc, char** argv) {
  CLI::App app("Measures the reuse planner pair by pair");
  Request request;
  request.rig = fs::path(REFORGE_SOURCE_DIR) / "config/rigs/mx220.json";
  request.options.mode = Mode::kPaper;
  fs::path list = fs::path(REFORGE_SOURCE_DIR).parent_path() / "shared/models/pairs.json";
  std::vector<std::string> wanted;
  std::vector<std::uint64_t> seeds{1};
  fs::path json_file;
  const std::map<std::string, Effort> efforts{
      {"fast", Effort::kFast}, {"default", Effort::kDefault}, {"high", Effort::kHigh}};
  const std::map<std::string, Mode> modes{{"strict", Mode::kStrict}, {"paper", Mode::kPaper}};
  const std::map<std::string, Setup> setups{{"search", Setup::kSearch},
                                            {"paper", Setup::kPaper},
                                            {"centroids", Setup::kCentroids},
                                            {"stored", Setup::kStored}};
  app.add_option("--pairs-file", list, "a list of pairs, meshes beside it");
  app.add_option("--pairs", wanted, "their names; all without")->delimiter(',');
  app.add_option("--seeds", seeds, "each pair with each")->delimiter(',');
  app.add_option("--effort", request.options.effort)->transform(CLI::CheckedTransformer(efforts));
  app.add_option("--mode", request.options.mode)->transform(CLI::CheckedTransformer(modes));
  app.add_option("--setup", request.options.setup)->transform(CLI::CheckedTransformer(setups));
  app.add_option("--rig", request.rig);
  app.add_option("--json", json_file, "the same figures as a file");
  CLI11_PARSE(app, argc, argv);

  const std::vector<Pair> pairs = pairs_in(list);
  if (pairs.empty()) {
    std::fprintf(stderr, "bench-planner: no pairs in %s\n", list.c_str());
    return 2;
  }
  std::printf(
      "paper: Coral B .41 P_S 2 P_A 57 R_V .92 R_I .63 R_F .62, C_b 2 C_a 6 B_S 8 B_A 5; "
      "published code measured: R_F .59-.63 in 98.9 CPU s (setup 32.5, first stage 18.9, "
      "search 33.6)\n");
  print_header();
  Json all = Json::array();
  double sum = 0;
  int planned = 0;
  for (const Pair& pair : pairs) {
    if (!wanted.empty() && std::find(wanted.begin(), wanted.end(), pair.name) == wanted.end())
      continue;
    request.initial = pair.initial;
    request.target = pair.target;
    for (const auto seed : seeds) {
      request.options.seed = seed;
      Json row = measured(request);
      row["pair"] = pair.name;
      row["seed"] = seed;
      print_row(pair.name, seed, row);
      std::fflush(stdout);
      if (row.contains("R_F") && number(row, "R_V") > 0) {
        sum += number(row, "R_F") / number(row, "R_V");
        ++planned;
      }
      all.push_back(std::move(row));
    }
  }
  if (planned > 0) std::printf("%d plans, mean R_F / R_V %.3f\n", planned, sum / planned);
  if (!json_file.empty()) std::ofstream(json_file) << all.dump(1) << "\n";
  return 0;
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  return reforge::run(argc, argv);
}
