// The operator's commands: submit, confirm, admit, recover, reheat, start, watch, hold, resume,
// abort, emergency, clear, status, jobs. Each talks to the daemon's socket (--socket, else
// REFORGE_SOCKET, else the installed one).
#pragma once

#include <CLI/CLI.hpp>

#include "tools/reforge/outcome.h"

namespace reforge {

void add_daemon_commands(CLI::App& app, Outcome& outcome);

}  // namespace reforge
