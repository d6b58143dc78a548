// The job that has the rig, while it has it: its stream, where its barrier stands, its bead.
#pragma once

#include <optional>
#include <string>

#include "controller/core/instant.h"
#include "controller/core/job.h"
#include "controller/core/streamer.h"

namespace reforge {

struct Verdict {
  JobState state;
  std::string sentence;
};

// A drain and the M-code behind it. Survives a hold, so that what is done is not done twice.
struct Barrier {
  bool dwell_sent = false;
  bool dwell_acknowledged = false;
  bool idle_seen = false;  // after the dwell; forgotten by a hold
  bool relayed = false;    // the extruder has been given the order
  bool done = false;       // and has done it
};

struct JobRun {
  JobRun(JobOrder job, Point<MachineFrame> origin, const CncDevice& device,
         const RigDescription& rig, StreamerOptions streaming)
      : order(std::move(job)), g54(origin), streamer(order.program, device, rig, streaming) {}

  JobOrder order;
  Point<MachineFrame> g54;  // of the program's header
  Streamer streamer;
  Barrier barrier;
  std::optional<ExtruderOrder> bead;              // the M72 that is on, by the program
  std::optional<ExtruderOrder> interrupted_bead;  // the M72 a hold has ended; Resume gives it again
  bool offsets_answered = false;
  std::string start_refusal;
  std::optional<Verdict> verdict;  // the first cause of its end
  std::int64_t relayed = 0;        // M-codes done
  LineNumber reported = 0;         // acknowledged lines told to the journal
  Instant started_at{};
  Instant acknowledged_at{};          // the last acknowledgement, or release from a hold
  std::optional<Instant> idle_since;  // the CNC says Idle with lines outstanding
};

}  // namespace reforge
