// `reforged --dry-run JOB`: the daemon's own core runs the job's program against a CNC and an
// extruder board simulated in process, in simulated time, from the first line to the last.
//
// What it shows: the stream, barriers and orders the real run would send, and that it comes to its
// end. Deterministic: the same job gives the same bytes at the same simulated times, hence the same
// digest. What it does not show: collisions (the verifier's), travel, acceleration, temperatures.
#pragma once

#include <filesystem>
#include <string>

#include "controller/core/job.h"
#include "protocols/job.h"
#include "protocols/result.h"

namespace reforge {

struct DryRun {
  JobState state = JobState::kReady;  // how the job ended
  std::string sentence;
  LineCertainty certainty;
  std::int64_t relayed = 0;     // M70-M75 done
  double machine_s = 0;         // simulated
  std::int64_t bytes = 0;       // sent to the CNC
  int unacknowledged_peak = 0;  // bytes; never above the receiver
  std::string digest;           // SHA-256 over all that was sent, with link and time
};

// `folder` is a finished job, checked against its certificate first; its own rig.json is used.
Result<DryRun> dry_run(const std::filesystem::path& folder);

// The same for a program that is at hand.
DryRun dry_run(const RigDescription& rig, const JobOrder& job);

}  // namespace reforge
