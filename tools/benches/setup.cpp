// Setups and volumes measured: for each pair the share V~_R / M* of every candidate, by samples and
// exactly, beside the reference ratios of the pairs' file; poses tried a second; processor seconds.
//
// Each pair also says whether its exact volumes are closed and balance, and what was dropped.
// Pairs: the file given (a list like the shared models' pairs.json, meshes beside it), else the
// shared models where they are. `tools/bench setup --setup paper` measures the published procedure.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "planner/geometry/mesh_topology.h"
#include "planner/reuse/setup.h"
#include "planner/reuse/setup_search.h"
#include "planner/reuse/volumes.h"

namespace reforge {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

double cpu_now() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

double better_reference(const Json& pair) {
  double best = 0;
  if (!pair.contains("reference")) return best;
  for (const Json& entry : pair.at("reference")) {
    if (entry.is_object()) best = std::max(best, entry.value("ratio_to_target", 0.0));
  }
  return best;
}

// One line for a candidate: its exact volumes, and whether they are sound.
void measure(const LoadedPart& initial, const PlacedTarget& placed) {
  const double sampled = common_share(initial.mesh, placed.mesh).all;
  const double before = cpu_now();
  const auto volumes = ideal_volumes(initial.mesh, placed.mesh);
  const double seconds = cpu_now() - before;
  if (!volumes) {
    std::printf("    %-9s no volumes (%.2f CPU s): %s\n", placed.setup.c_str(), seconds,
                volumes.error().sentence.c_str());
    return;
  }
  CellComplex complex = volumes->complex;
  const double of_initial = volume(initial.mesh), of_target = volume(placed.mesh);
  const double reused = volume_of(complex, kReused), removed = volume_of(complex, kRemoved),
               added = volume_of(complex, kAdded);
  bool closed = true;
  for (const Region region : {kReused, kRemoved, kAdded}) {
    closed = closed && is_closed(surface_of(complex, in(region)));
  }
  const double fault =
      std::max(std::abs(reused + removed + volumes->dropped_initial_mm3 - of_initial) / of_initial,
               std::abs(reused + added + volumes->dropped_mm3 - of_target) / of_target);
  const double loose = set_loose_pieces_free(complex);
  std::printf(
      "    %-9s R_V %.4f, standing %.4f, by samples %.4f (%+.4f); volumes %.2f CPU s, %s, balance "
      "%.0e, dropped %.3f of %.1f allowed mm3\n",
      placed.setup.c_str(), reused / of_target, (reused - loose) / of_target, sampled,
      sampled - reused / of_target, seconds, closed ? "closed" : "NOT CLOSED", fault,
      std::max(std::abs(volumes->dropped_mm3), std::abs(volumes->dropped_initial_mm3)),
      kMachineTolerance * volumes->coincident_area_mm2);
}

void measure_pair(const Json& pair, const fs::path& folder, const RigDescription& rig,
                  Setup setup) {
  const std::string name = pair.at("name");
  const auto initial = load_part(folder / pair.at("initial").get<std::string>(), rig);
  const auto target = load_part(folder / pair.at("target").get<std::string>(), rig);
  if (!initial || !target) {
    std::printf("%s: %s\n", name.c_str(), (initial ? target : initial).error().sentence.c_str());
    return;
  }
  std::vector<std::string> why;
  const double before = cpu_now();
  const auto candidates = place_target(*initial, *target, rig, setup, why);
  const double seconds = cpu_now() - before;
  std::printf("%s: reference %.4f, setup %.2f CPU s", name.c_str(), better_reference(pair),
              seconds);
  if (setup == Setup::kSearch) {
    const PoseSampler sampler(initial->mesh, target->in_file);
    const double start = cpu_now();
    const PoseSearch found =
        search_poses(sampler, *initial, *target, 1, [](const Box3&) { return true; });
    std::printf(", %.0f poses a second",
                static_cast<double>(found.poses_tried) / std::max(1e-9, cpu_now() - start));
  }
  std::printf("\n");
  for (const PlacedTarget& placed : candidates) measure(*initial, placed);
  for (const std::string& sentence : why) std::printf("    %s\n", sentence.c_str());
  std::fflush(stdout);
}

int run(int argc, char** argv) {
  CLI::App app("Measures setups and exact volumes pair by pair");
  fs::path list = fs::path(REFORGE_SOURCE_DIR) / "../shared/models/pairs.json";
  std::vector<std::string> names;
  Setup setup = Setup::kSearch;
  app.add_option("names", names, "pairs; without any, all");
  app.add_option("--pairs-file", list, "a list like the shared models' pairs.json");
  app.add_option("--setup", setup, "search, paper, centroids, stored")
      ->transform(
          CLI::CheckedTransformer(std::map<std::string, Setup>{{"search", Setup::kSearch},
                                                               {"paper", Setup::kPaper},
                                                               {"centroids", Setup::kCentroids},
                                                               {"stored", Setup::kStored}}));
  CLI11_PARSE(app, argc, argv);
  const auto rig = read_rig(fs::path(REFORGE_SOURCE_DIR) / "config/rigs/mx220.json");
  std::ifstream in(list);
  const Json json = Json::parse(in, nullptr, false);
  if (!rig || json.is_discarded()) {
    std::fprintf(
        stderr, "%s\n",
        rig ? (list.string() + ": no list of pairs.").c_str() : rig.error().sentence.c_str());
    return 2;
  }
  for (const Json& pair : json.at("pairs")) {
    if (!names.empty() && std::find(names.begin(), names.end(), pair.at("name")) == names.end()) {
      continue;
    }
    measure_pair(pair, list.parent_path(), *rig, setup);
  }
  return 0;
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  return reforge::run(argc, argv);
}
