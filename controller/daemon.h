// reforged: ports, clock, journal, operators and core put together in one io_context.
//
// The core decides, everybody else reports to it and carries out what it wants: bytes, time,
// durable horizons and operators' orders go in, actions come out (core/action.h). After every event
// the core's actions are performed in order and its next deadline is set on the machine's clock.
//
// When the journal cannot be written the running job is held and nothing new is accepted until it
// can; stopping is always accepted. SIGTERM and SIGINT: the core is told to end the job safely,
// then the daemon leaves.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "controller/config.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

// What the daemon ends as: an exit code of sysexits.h, and a sentence when it is not 0.
struct DaemonEnd {
  int exit_code = 0;
  std::string sentence;
};

// Runs until SIGTERM, SIGINT or an administrator's shutdown. SIGHUP reads `file` again: who may do
// what at once, bounds and verifier when no job has the rig, everything else at the next start.
DaemonEnd run_daemon(DaemonConfig config, const std::filesystem::path& file);

// Also what `reforged --check` looks at: the rig file, and whether it allows these ports.
Result<RigDescription> rig_for(const DaemonConfig& config);

}  // namespace reforge
