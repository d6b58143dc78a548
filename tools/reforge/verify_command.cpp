#include "tools/reforge/verify_command.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>

#include "planner/geometry/mesh_io.h"
#include "planner/verify/verify.h"
#include "protocols/sha256.h"
#include "tools/reforge/bead_trace.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;

struct Chosen {
  std::string path;  // a job folder or a program
  std::string rig, stock, target, fixture, trace, mode = "strict";
  double pitch_mm = 0;
  bool as_json = false;
  bool write = false;
};

constexpr std::size_t kWorst = 5;
constexpr double kBeadTolerance = 0.3;  // mm, of a bead's start and end

void print_volumes(const Certificate& c) {
  std::printf("volumes mm3        reused    removed      added\n");
  if (c.planned) {
    std::printf("  planned    %12.1f %10.1f %10.1f\n", c.planned->reused, c.planned->removed,
                c.planned->added);
  }
  std::printf("  simulated  %12.1f %10.1f %10.1f\n", c.simulated.reused, c.simulated.removed,
              c.simulated.added);
  const auto detail = [&](const char* key) {
    const auto it = c.volume_details_mm3.find(key);
    return it == c.volume_details_mm3.end() ? 0.0 : it->second;
  };
  if (c.planned) {
    std::printf("  of the part to keep %.1f was cut; %.1f beyond it was left\n", detail("kept_cut"),
                detail("left_over"));
    std::printf("  beads %.1f by flow; %.1f within an infill gap of a bead, of %.1f planned\n",
                detail("added_by_flow"), detail("plan_covered"), c.planned->added);
  }
}

void print_certificate(const Certificate& c) {
  std::printf("%s  %zu lines, %zu moves, %d blocks, mode %s, stock at %.2f mm\n",
              c.pass ? "PASS" : "FAIL", c.lines, c.moves, c.blocks,
              c.mode == Mode::kPaper ? "paper" : "strict", c.pitch_mm);
  std::vector<CertificateFinding> worst = c.findings;
  std::stable_sort(worst.begin(), worst.end(),
                   [](const auto& a, const auto& b) { return a.depth_mm > b.depth_mm; });
  for (std::size_t k = 0; k < std::min(worst.size(), kWorst); ++k) {
    const CertificateFinding& f = worst[k];
    std::printf("  %s, %llu times; worst in line %zu, block %d:\n    %s\n", f.kind.c_str(),
                static_cast<unsigned long long>(f.count), f.line, f.block, f.sentence.c_str());
  }
  if (worst.size() > kWorst) std::printf("  and %zu kinds more\n", worst.size() - kWorst);
  print_volumes(c);
  for (const auto& [surface, values] : c.deviation_mm) {
    std::printf(
        "deviation of %s surface, mm: min %.3f, 1%% %.3f, median %.3f, 99%% %.3f, max %.3f\n",
        surface.c_str(), values.at("min"), values.at("p01"), values.at("p50"), values.at("p99"),
        values.at("max"));
  }
  for (const auto& [body, gap] : c.clearance_mm) {
    std::printf("clearance %s: %.2f mm\n", body.c_str(), gap);
  }
  std::printf("time %.0f s (%.1f min), filament %.0f mm\n", c.seconds, c.seconds / 60,
              c.filament_mm);
}

void finish(const Certificate& certificate, const Chosen& chosen, Outcome& outcome) {
  if (chosen.as_json) {
    std::fputs(canonical_json(certificate).c_str(), stdout);
  } else {
    print_certificate(certificate);
  }
  outcome.code = certificate.pass ? ExitCode::kOk : ExitCode::kInfeasibleOrRefused;
  if (certificate.pass) return;
  // The last words, for whoever runs this as a child: the deepest fault.
  const auto deepest =
      std::max_element(certificate.findings.begin(), certificate.findings.end(),
                       [](const auto& a, const auto& b) { return a.depth_mm < b.depth_mm; });
  std::fprintf(stderr, "reforge: the program does not pass: line %zu: %s\n", deepest->line,
               deepest->sentence.c_str());
}

Status write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << text;
  out.close();
  if (!out) return Status::fail(Code::kUnreadable, file.string() + ": cannot be written");
  return Unit{};
}

// The run that the trace recorded, against the program it ran.
Status check_trace(const fs::path& program, const fs::path& rig_file, const Chosen& chosen,
                   Outcome& outcome) {
  const Result<RigDescription> rig = read_rig(rig_file);
  if (!rig) return rig.error();
  const Result<TraceComparison> compared = compare_trace(program, *rig, chosen.trace);
  if (!compared) return compared.error();
  const TraceComparison& c = *compared;
  const bool good = c.good(kBeadTolerance);
  const BeadComparison *start = c.worst_start(), *end = c.worst_end();
  double planned = 0, counted = 0, lag = 0;
  for (const BeadComparison& bead : c.beads) {
    planned += bead.planned_mm;
    counted += bead.counted_mm;
    lag = std::max(lag, bead.lag_mm);
  }
  if (chosen.as_json) {
    nlohmann::json beads = nlohmann::json::array();
    for (const BeadComparison& b : c.beads) {
      beads.push_back({{"line", b.line},
                       {"length_mm", b.length_mm},
                       {"start_error_mm", b.start_error_mm},
                       {"end_error_mm", b.end_error_mm},
                       {"lag_mm", c.flow_recorded ? nlohmann::json(b.lag_mm) : nlohmann::json()},
                       {"planned_mm", b.planned_mm},
                       {"counted_mm", b.counted_mm}});
    }
    const nlohmann::json all{{"verdict", good ? "pass" : "fail"},
                             {"program_beads", c.program_beads},
                             {"trace_beads", c.trace_beads},
                             {"tolerance_mm", kBeadTolerance},
                             {"beads", std::move(beads)}};
    std::printf("%s\n", all.dump().c_str());
  } else {
    std::printf("trace %s: %zu beads ran, %zu are in the program\n", good ? "PASS" : "FAIL",
                c.trace_beads, c.program_beads);
    if (start && end) {
      std::printf("  filament begins within %.3f mm of its place (worst: line %zu)\n",
                  start->start_error_mm, start->line);
      std::printf("  filament ends within %.3f mm of its place (worst: line %zu)\n",
                  end->end_error_mm, end->line);
    }
    if (c.flow_recorded) std::printf("  along the beads it is at most %.3f mm off\n", lag);
    std::printf("  filament by the program's feeds %.1f mm, counted %.1f mm (ramps included)\n",
                planned, counted);
  }
  if (good) return Unit{};
  outcome.code = ExitCode::kInfeasibleOrRefused;
  std::fprintf(stderr,
               "reforge: the trace is not what the program asks for: beads off by more than %.1f mm"
               " or not as many\n",
               kBeadTolerance);
  return Unit{};
}

Status verify_folder(const Chosen& chosen, Outcome& outcome) {
  VerifyOptions options;
  options.pitch_mm = chosen.pitch_mm;
  Result<JobVerification> job = verify_job(chosen.path, options);
  if (!job) return job.error();
  const fs::path file = fs::path(chosen.path) / "certificate.json";
  const std::string bytes = canonical_json(job->certificate);
  std::ifstream in(file, std::ios::binary);
  const bool exists = in.good();
  const std::string old{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (chosen.write) {
    const Status written = write_text(file, bytes);
    if (!written) return written;
  }
  if (!chosen.as_json) {
    std::printf("certificate.json: %s\n", chosen.write   ? "written"
                                          : !exists      ? "none in this job"
                                          : old == bytes ? "the same, byte for byte"
                                                         : "DIFFERS from this verification");
  }
  finish(job->certificate, chosen, outcome);
  if (exists && !chosen.write && old != bytes) outcome.code = ExitCode::kInfeasibleOrRefused;
  if (chosen.trace.empty()) return Unit{};
  const fs::path folder(chosen.path);
  return check_trace(folder / "program.nc", folder / "rig.json", chosen, outcome);
}

Status read_into(const std::string& path, const char* name, std::optional<TriangleMesh>& mesh,
                 Certificate& hashes) {
  if (path.empty()) return Unit{};
  Result<std::string> hash = sha256_of_file(path);
  if (!hash) return hash.error();
  Result<TriangleMesh> read = read_mesh(path);
  if (!read) return read.error();
  hashes.sha256[name] = *hash;
  mesh = std::move(*read);
  return Unit{};
}

Status verify_file(const Chosen& chosen, Outcome& outcome) {
  if (!std::filesystem::exists(chosen.path)) {
    return Status::fail(Code::kUnreadable,
                        chosen.path + ": there is no such job folder or program");
  }
  if (chosen.rig.empty() || chosen.stock.empty()) {
    return Status::fail(Code::kUsage, "a bare program needs --rig and --stock");
  }
  VerifyInputs inputs;
  Certificate hashes;
  Result<RigDescription> rig = read_rig(chosen.rig);
  if (!rig) return rig.error();
  inputs.rig = std::move(*rig);
  hashes.sha256["rig"] = inputs.rig.sha256;
  inputs.mode = chosen.mode == "paper" ? Mode::kPaper : Mode::kStrict;
  std::optional<TriangleMesh> stock;
  for (const Status& read : {read_into(chosen.stock, "initial", stock, hashes),
                             read_into(chosen.target, "target", inputs.target, hashes),
                             read_into(chosen.fixture, "fixture", inputs.fixture, hashes)}) {
    if (!read) return read.error();
  }
  inputs.initial = std::move(*stock);
  inputs.initial_sha256 = hashes.sha256["initial"];
  Result<std::string> hash = sha256_of_file(chosen.path);
  if (!hash) return hash.error();
  hashes.sha256["program"] = *hash;
  std::ifstream program(chosen.path, std::ios::binary);
  VerifyOptions options;
  options.pitch_mm = chosen.pitch_mm;
  Result<Verification> verification = verify_program(program, inputs, options);
  if (!verification) return verification.error();
  Certificate certificate = certificate_of(*verification, inputs);
  certificate.sha256 = hashes.sha256;
  finish(certificate, chosen, outcome);
  if (chosen.trace.empty()) return Unit{};
  return check_trace(chosen.path, chosen.rig, chosen, outcome);
}

}  // namespace

void add_verify_command(CLI::App& app, Outcome& outcome) {
  auto chosen = std::make_shared<Chosen>();
  CLI::App* verify = app.add_subcommand("verify", "Simulate a program and judge it");
  verify->add_option("path", chosen->path, "A job folder, or a program")->required();
  verify->add_option("--rig", chosen->rig, "Rig file (a bare program)");
  verify->add_option("--stock", chosen->stock, "Initial model, in the part frame (a bare program)");
  verify->add_option("--target", chosen->target,
                     "Wanted model, in the part frame (a bare program)");
  verify->add_option("--fixture", chosen->fixture, "Fixture, in the part frame (a bare program)");
  verify->add_option("--mode", chosen->mode, "Obstacles that count (a bare program)")
      ->check(CLI::IsMember({"strict", "paper"}))
      ->capture_default_str();
  verify->add_option("--pitch", chosen->pitch_mm, "Columns of the simulated stock, mm; 0: by size")
      ->check(CLI::Range(0.0, 1.0));
  verify->add_option("--trace", chosen->trace,
                     "Trace of a run on the virtual rig, compared with the program bead by bead");
  verify->add_flag("--json", chosen->as_json, "Print the certificate");
  verify->add_flag("--write", chosen->write, "Write certificate.json into the job");
  verify->callback([chosen, &outcome] {
    std::error_code error;
    const Status done = fs::is_directory(chosen->path, error) ? verify_folder(*chosen, outcome)
                                                              : verify_file(*chosen, outcome);
    if (!done) report(outcome, done.error());
  });
}

}  // namespace reforge
