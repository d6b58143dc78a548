// `reforge extruder …`: manual commands to the extruder board, for setting up and calibrating
// (firmware/arduino-extruder/WIRING.md). Works only while the daemon does not hold the port. Each
// command is a conversation of its own, and an open module that nobody speaks to cools down after
// three seconds; `session` keeps it company.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

void add_extruder_command(CLI::App& app, Outcome& outcome);

}  // namespace reforge
