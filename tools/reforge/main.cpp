// `reforge`: the command line of the operator and the process engineer. A thin main: each
// subcommand lives in a file of its own and only calls the planner library or the daemon's socket.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "tools/reforge/daemon_commands.h"
#include "tools/reforge/extruder_command.h"
#include "tools/reforge/outcome.h"
#include "tools/reforge/picture_command.h"
#include "tools/reforge/report_command.h"
#include "tools/reforge/verify_command.h"

#if __has_include("tools/reforge/plan_command.h")
#include "tools/reforge/plan_command.h"
#endif

int main(int argc, char** argv) {
  CLI::App app{"Reforge: plan, prove and run hybrid remanufacturing jobs"};
  app.require_subcommand(1);
  app.set_version_flag("--version", "reforge " REFORGE_VERSION);
  app.failure_message(CLI::FailureMessage::help);

  reforge::Outcome outcome;
  reforge::add_picture_command(app, outcome);
  reforge::add_report_command(app, outcome);
#if __has_include("tools/reforge/plan_command.h")
  reforge::add_plan_command(app, outcome);
#endif
  reforge::add_verify_command(app, outcome);
  reforge::add_daemon_commands(app, outcome);
  reforge::add_extruder_command(app, outcome);

  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    return app.exit(e);
  } catch (const CLI::CallForVersion& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    app.exit(e);
    return static_cast<int>(reforge::ExitCode::kUsage);
  }
  return static_cast<int>(outcome.code);
}
