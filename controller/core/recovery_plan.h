// How an interrupted job goes on: from which checkpoint, and by what preamble.
//
// Pure: the program's text and the journal's certainty in, the text of a new program out. The new
// program holds, in this order,
//   1. the lines before the checkpoint, as they were: done, never sent again;
//   2. the bridge: spindle off, Z clear, module closed; never sent, it says what the interruption
//      has left, so that a verifier that starts from the whole stock simulates the stock of now;
//   3. the preamble: sent first. Reheat before any axis moves, Z clear, rotary axes, purge clear of
//      the part or spindle at speed, X and Y, then Z at feed;
//   4. the lines from the checkpoint on.
// One verification of the whole therefore judges preamble and rest against the simulated stock of
// that moment. Line numbers count in the new program; it is run from `first_line` on.
//
// Checkpoints are the program's "; block" and "; path" lines (FORMATS.md): drained and retracted
// places. A milling path may be cut again: the last checkpoint before which everything is certainly
// executed. No bead is laid twice and none is left out silently: a bead that is certainly whole is
// behind the checkpoint; one that may be half laid needs the operator's word.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "controller/core/job.h"
#include "controller/core/program.h"
#include "protocols/rig.h"

namespace reforge {

// Of a bead that may be half laid: taken off (it is laid again), or good as it is (it counts as
// laid).
enum class BeadWord : std::uint8_t { kNone, kRemoved, kAccepted };

struct RecoveryRequest {
  LineCertainty certainty;
  bool sent_known = false;
  LineNumber first_line = 1;  // of the interrupted job; what stands before it was done before
  BeadWord bead = BeadWord::kNone;
  std::optional<std::int64_t>
      path;  // run from this path on, whatever the certainty says of milling
};

struct RecoveryPlan {
  LineNumber from = 0;  // the checkpoint: the first line of the old program that is run again
  std::vector<std::string> bridge;
  std::vector<std::string> preamble;
  LineNumber first_line = 0;  // of the new program, where the preamble begins
  LineNumber lines = 0;       // of the new program
  bool printing = false;      // the module was open: M70 comes before any motion
  std::string sentence;       // what is done again, and why from there
};

Result<RecoveryPlan> plan_recovery(ProgramSource& program, const RigDescription& rig,
                                   const RecoveryRequest& request);

// The new program's text, a line at a time.
Status write_recovered(ProgramSource& program, const RecoveryPlan& plan,
                       const std::function<void(std::string_view)>& write_line);

}  // namespace reforge
