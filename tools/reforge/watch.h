// Following a job by the daemon's notifications.
#pragma once

#include <cstdint>

#include "tools/reforge/daemon_link.h"
#include "tools/reforge/outcome.h"

namespace reforge {

// Returns when the job has left the states before `ready`; what it is then is start's to judge.
Status wait_until_verified(DaemonLink& link, std::int64_t job);

// Shows progress until the job is over: one line in place on a terminal, a line a change otherwise,
// or the notifications themselves as JSON. The outcome is 0 only for `done`, 1 for `aborted`, 4
// else. Job 0: the one that has the rig, else the newest.
Status watch(DaemonLink& link, std::int64_t job, bool as_json, Outcome& outcome);

}  // namespace reforge
