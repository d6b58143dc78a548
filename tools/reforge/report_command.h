// `reforge report JOB`: what was planned, what was simulated, what the machine did, in one table.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

// Reads the job folder, the daemon's answer to `status --json` and the rig's trace. Refuses (exit
// 1) when the job is not done, or when the filament that moved is over 1 % off what the orders
// asked for.
void add_report_command(CLI::App& app, Outcome& outcome);

}  // namespace reforge
