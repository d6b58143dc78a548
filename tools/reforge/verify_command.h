// `reforge verify JOB` and `reforge verify program.nc --rig R --stock M.stl ...`: the proof, on a
// program of ours or anybody's. Exit 0: it passes; 1: it does not; 3: the inputs cannot be read.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

// Adds the subcommand; `outcome` receives how it ended.
void add_verify_command(CLI::App& app, Outcome& outcome);

}  // namespace reforge
