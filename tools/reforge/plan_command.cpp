#include "tools/reforge/plan_command.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>

#include "planner/program/plan.h"

namespace reforge {
namespace {

std::atomic<bool> stop_asked{false};

void ask_to_stop(int) {
  stop_asked = true;
}

// What is going on, on stderr, once the whole has taken two seconds, and then once a second.
class ProgressLine {
 public:
  void operator()(std::string_view stage, std::string_view what) {
    const std::lock_guard lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (now - start_ < std::chrono::seconds(2) || now - last_ < std::chrono::seconds(1)) return;
    last_ = now;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::fprintf(stderr, "reforge: %5.0f s  %.*s: %.*s\n", seconds, static_cast<int>(stage.size()),
                 stage.data(), static_cast<int>(what.size()), what.data());
  }

 private:
  std::mutex mutex_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_{};
};

void print_summary(const nlohmann::json& plan) {
  const auto& r = plan.at("results");
  const auto& v = plan.at("volumes_mm3");
  std::printf(
      "reused %.1f mm3 (R_F %.3f of the target; ideal R_V %.3f), removed %.1f mm3, added %.1f "
      "mm3\n",
      v.at("reused").get<double>(), r.at("R_F").get<double>(), r.at("R_V").get<double>(),
      v.at("removed").get<double>(), v.at("added").get<double>());
  std::printf("\n%3s %-6s %26s %12s %12s %8s\n", "", "block", "direction", "volume mm3", "path mm",
              "min");
  int number = 0;
  for (const auto& block : plan.at("blocks")) {
    const auto& d = block.at("direction");
    std::printf("%3d %-6s %8.3f %8.3f %8.3f %12.1f %12.1f %8.1f\n", ++number,
                block.at("kind").get<std::string>().c_str(), d[0].get<double>(), d[1].get<double>(),
                d[2].get<double>(), block.at("volume_mm3").get<double>(),
                block.at("path_mm").get<double>(), block.at("seconds").get<double>() / 60);
  }
  const auto& e = plan.at("extrusion");
  std::printf("\nfilament %.1f mm, %d toggles, %d retracts; planned in %.1f s, %.0f MiB\n",
              e.at("filament_mm").get<double>(), e.at("toggles").get<int>(),
              e.at("retracts").get<int>(), plan.at("seconds").at("total").get<double>(),
              plan.at("peak_mib").get<double>());
  for (const auto& note : plan.at("notes"))
    std::printf("note: %s\n", note.get<std::string>().c_str());
}

void run(PlanRequest request, bool as_json, Outcome& outcome) {
  const auto progress = std::make_shared<ProgressLine>();
  request.progress = [progress](std::string_view stage, std::string_view what) {
    (*progress)(stage, what);
  };
  request.should_stop = [] { return stop_asked.load(); };
  std::signal(SIGINT, ask_to_stop);
  std::signal(SIGTERM, ask_to_stop);
  const Result<PlanOutcome> result = plan(request);
  if (!result) return report(outcome, result.error());
  if (as_json) std::fputs(result->json.c_str(), stdout);
  if (!result->feasible) {
    for (const std::string& reason : result->reasons)
      std::fprintf(stderr, "reforge: no plan: %s\n", reason.c_str());
    outcome.code = ExitCode::kInfeasibleOrRefused;
    return;
  }
  if (!as_json) print_summary(nlohmann::json::parse(result->json));
  if (result->verified) return;
  for (const std::string& reason : result->reasons) {
    std::fprintf(stderr, "reforge: the program does not pass: %s\n", reason.c_str());
  }
  outcome.code = ExitCode::kInfeasibleOrRefused;
}

// An option that takes one of a few words; `chosen` outlives the command line.
template <typename T>
void add_choice(CLI::App& command, const std::string& name, const std::string& help,
                const std::map<std::string, T>& words, T& chosen) {
  command
      .add_option_function<std::string>(
          name, [words, &chosen](const std::string& word) { chosen = words.at(word); }, help)
      ->check(CLI::IsMember(words));
}

}  // namespace

void add_plan_command(CLI::App& app, Outcome& outcome) {
  auto request = std::make_shared<PlanRequest>();
  auto as_json = std::make_shared<bool>(false);
  CLI::App* command = app.add_subcommand("plan", "Plan how one part becomes another: a job folder");
  command->add_option("initial", request->initial, "the part there is (STL, OFF, OBJ, PLY; mm)")
      ->required();
  command->add_option("target", request->target, "the part wanted")->required();
  command->add_option("-o,--out", request->job, "the job folder to write")->required();
  command->add_option("--rig", request->rig, "the rig file")->required();
  command->add_option("--seed", request->seed, "same seed, same plan")->capture_default_str();
  add_choice<Effort>(
      *command, "--effort", "how long to look for a better plan",
      {{"fast", Effort::kFast}, {"default", Effort::kDefault}, {"high", Effort::kHigh}},
      request->effort);
  command
      ->add_option("--time-limit", request->time_limit_s, "seconds; the best plan so far is kept")
      ->check(CLI::PositiveNumber);
  add_choice<Mode>(*command, "--mode", "strict: the whole rig; paper: the paper's constraints",
                   {{"strict", Mode::kStrict}, {"paper", Mode::kPaper}}, request->mode);
  add_choice<Setup>(*command, "--setup", "how the target is placed in the part",
                    {{"search", Setup::kSearch},
                     {"paper", Setup::kPaper},
                     {"centroids", Setup::kCentroids},
                     {"stored", Setup::kStored}},
                    request->setup);
  command->add_flag("--force", request->replace, "replace a job folder that is there already");
  command->add_flag("--json", *as_json, "print plan.json");
  command->callback([request, as_json, &outcome] { run(*request, *as_json, outcome); });
}

}  // namespace reforge
