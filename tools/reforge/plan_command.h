// `reforge plan`: two meshes and a rig file in, a job folder out.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

void add_plan_command(CLI::App& app, Outcome& outcome);

}  // namespace reforge
