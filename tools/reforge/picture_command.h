// `reforge picture JOB -o FILE.png`: what a plan does, at a glance.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

// Four panels: the initial model; what is reused of it, with what is removed behind it; reused and
// added; the target.
void add_picture_command(CLI::App& app, Outcome& outcome);

}  // namespace reforge
