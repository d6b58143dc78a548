#include "tools/reforge/report_command.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "protocols/rig.h"
#include "tools/reforge/filament_account.h"

namespace reforge {
namespace {

using nlohmann::json;

constexpr double kFilamentTolerance = 0.01;

struct ReportOptions {
  std::filesystem::path job;
  std::filesystem::path status;
  std::filesystem::path trace;
  double wall_seconds = 0;
  bool as_json = false;
};

Result<json> read_json(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return Error{Code::kUnreadable, "cannot open " + file.string()};
  json parsed = json::parse(in, nullptr, false);
  if (parsed.is_discarded()) return Error{Code::kMalformed, file.string() + ": expected JSON"};
  return parsed;
}

// The report's own JSON; the table is printed from it.
Result<json> gather(const ReportOptions& options) {
  const Result<json> plan = read_json(options.job / "plan.json");
  if (!plan) return plan.error();
  const Result<json> certificate = read_json(options.job / "certificate.json");
  if (!certificate) return certificate.error();
  const Result<json> status = read_json(options.status);
  if (!status) return status.error();
  const Result<RigDescription> rig = read_rig(options.job / "rig.json");
  if (!rig) return rig.error();
  const Result<FilamentAccount> filament =
      read_filament_account(options.trace, rig->extrusion.steps_per_mm, rig->extrusion.retract_mm);
  if (!filament) return filament.error();
  try {
    const json& job = status->at("job");
    return json{
        {"results", plan->at("results")},
        {"volumes_mm3", certificate->at("volumes_mm3")},
        {"verdict", certificate->at("verdict")},
        {"estimated_s", certificate->at("seconds")},
        {"state", job.at("state")},
        {"lines", job.at("lines")},
        {"acknowledged", job.at("acknowledged")},
        {"toggles", job.at("toggles")},
        {"machine_s", job.at("machine_s")},
        {"wall_s", options.wall_seconds},
        {"filament",
         {{"beads", filament->beads},
          {"retractions", filament->retractions},
          {"ordered_mm", filament->ordered_mm},
          {"extruded_mm", filament->extruded_mm},
          {"net_ordered_mm", filament->ordered_mm - filament->retract_ordered_mm},
          {"net_counted_mm", filament->net_mm},
          {"error", filament->error()}}},
    };
  } catch (const json::exception& e) {
    return Error{Code::kMalformed, std::string("the job or its status lacks a key: ") + e.what()};
  }
}

void print_table(const json& report) {
  const json& planned = report["volumes_mm3"]["planned"];
  const json& simulated = report["volumes_mm3"]["simulated"];
  const json& details = report["volumes_mm3"]["details"];
  const auto row = [](const char* name, const json& plan, const json& simulation) {
    std::printf("  %-10s mm^3 %11.1f %11.1f\n", name, plan.get<double>(), simulation.get<double>());
  };
  std::printf("                    planned   simulated\n");
  row("reused", planned["reused"], simulated["reused"]);
  row("removed", planned["removed"], simulated["removed"]);
  // A print is walls, skins and sparse infill: the solid that they fill, and the plastic they take.
  row("added", planned["added"], details["plan_covered"]);
  row("  plastic", details["added_by_flow"], simulated["added"]);
  const json& results = report["results"];
  const json& filament = report["filament"];
  std::printf("  reused of the target  R_V %.3f (ideal)  R_F %.3f\n", results["R_V"].get<double>(),
              results["R_F"].get<double>());
  std::printf("  blocks                %d milled, %d printed\n", results["B_S"].get<int>(),
              results["B_A"].get<int>());
  std::printf("  lines streamed        %lld of %lld\n", report["acknowledged"].get<long long>(),
              report["lines"].get<long long>());
  std::printf("  extruder toggles      %lld (%d beads, %d retractions)\n",
              report["toggles"].get<long long>(), filament["beads"].get<int>(),
              filament["retractions"].get<int>());
  std::printf(
      "  filament              %.1f mm ordered, %.1f mm counted on the STEP pin (%+.2f %%)\n",
      filament["net_ordered_mm"].get<double>(), filament["net_counted_mm"].get<double>(),
      100 * filament["error"].get<double>());
  std::printf("  machine time          %.0f s (estimated %.0f s), wall %.0f s\n",
              report["machine_s"].get<double>(), report["estimated_s"].get<double>(),
              report["wall_s"].get<double>());
  std::printf("  verdict               %s\n", report["verdict"].get<std::string>().c_str());
  std::printf("  state                 %s\n", report["state"].get<std::string>().c_str());
}

Status run(const ReportOptions& options) {
  Result<json> gathered = gather(options);
  if (!gathered) return gathered.error();
  const json report = std::move(gathered).value();
  try {
    if (options.as_json) {
      std::printf("%s\n", report.dump(2).c_str());
    } else {
      print_table(report);
    }
    if (report["state"] != "done") {
      return Status::fail(Code::kRefused,
                          "the job is " + report["state"].get<std::string>() + ", not done");
    }
    if (std::abs(report["filament"]["error"].get<double>()) > kFilamentTolerance) {
      return Status::fail(Code::kRefused,
                          "the filament that moved is over 1 % off what was ordered");
    }
  } catch (const json::exception& e) {
    return Status::fail(Code::kMalformed,
                        std::string("the job's files lack a number: ") + e.what());
  }
  return Unit{};
}

}  // namespace

void add_report_command(CLI::App& app, Outcome& outcome) {
  auto options = std::make_shared<ReportOptions>();
  CLI::App* report_command = app.add_subcommand(
      "report", "What was planned, simulated and done: one table for a job run on the virtual rig");
  report_command->add_option("job", options->job, "the job folder")
      ->required()
      ->check(CLI::ExistingDirectory);
  report_command->add_option("--status", options->status, "what `reforge status --json` said")
      ->required();
  report_command->add_option("--trace", options->trace, "the rig's trace")->required();
  report_command->add_option("--wall", options->wall_seconds, "seconds the run took on the clock");
  report_command->add_flag("--json", options->as_json, "print the report as JSON");
  report_command->callback([options, &outcome] {
    if (const Status done = run(*options); !done) report(outcome, done.error());
  });
}

}  // namespace reforge
