// reforged: the daemon that runs jobs on the rig. Exit codes are those of sysexits.h.
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sysexits.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>

#include "controller/config.h"
#include "controller/daemon.h"
#include "controller/dry_run.h"
#include "controller/io/service.h"

namespace {

// As a service the journal of the system takes the lines and knows their time; otherwise stderr.
void choose_log() {
  const bool as_service = std::getenv("JOURNAL_STREAM") != nullptr;
  if (as_service) {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("reforged", reforge::service::journal_sink()));
  } else {
    spdlog::set_default_logger(spdlog::stderr_logger_mt("reforged"));
    spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %v");
  }
  spdlog::flush_on(spdlog::level::info);
}

int print_dry_run(const std::string& folder) {
  const auto run = reforge::dry_run(folder);
  if (!run) {
    std::fprintf(stderr, "reforged: %s\n", run.error().sentence.c_str());
    return EX_DATAERR;
  }
  std::printf(
      "%s: %s\n%lld lines executed, %lld toggles, %lld bytes, at most %d unacknowledged, "
      "%.1f s simulated\ndigest %s\n",
      reforge::api::name_of(run->state), run->sentence.c_str(),
      static_cast<long long>(run->certainty.executed), static_cast<long long>(run->relayed),
      static_cast<long long>(run->bytes), run->unacknowledged_peak, run->machine_s,
      run->digest.c_str());
  return run->state == reforge::JobState::kDone ? EX_OK : EX_DATAERR;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"reforged: runs hybrid jobs on the rig"};
  std::string file = "/etc/reforge/reforged.json";
  bool check = false;
  app.add_option("--config", file, "The configuration")->capture_default_str();
  std::string job;
  app.add_option("--dry-run", job, "Run a job folder against a rig simulated in process, and end");
  app.add_flag("--check", check, "Only read configuration and rig file");
  app.set_version_flag("--version", "reforged " REFORGE_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? EX_OK : EX_USAGE;
  }
  if (!job.empty()) return print_dry_run(job);
  choose_log();
  const auto config = reforge::read_config(file);
  if (!config) {
    spdlog::critical("{}", config.error().sentence);
    return EX_CONFIG;
  }
  if (check) {
    const auto rig = reforge::rig_for(*config);
    if (!rig) spdlog::critical("{}", rig.error().sentence);
    return rig ? EX_OK : EX_CONFIG;
  }
  const reforge::DaemonEnd end = reforge::run_daemon(*config, file);
  if (end.exit_code != EX_OK) spdlog::critical("{}", end.sentence);
  return end.exit_code;
}
