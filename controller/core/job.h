// What the core knows of a job: its number, its state, and how sure we are of each line.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "controller/core/program.h"
#include "protocols/operator_api.h"
#include "protocols/rig.h"

namespace reforge {

enum class JobId : std::int64_t {};

// The queue owns the states up to kReady; the core reports the others. kHeld: at rest by a hold;
// kDone: every line executed and drained; kFailed: a device or the program was at fault; kAborted:
// by the operator; kInterrupted: by the loss of a link, of an acknowledgement or of the daemon.
using api::JobState;

// How far a program is known to have come. Invariant:
// executed <= acknowledged <= sent <= horizon.
struct LineCertainty {
  LineNumber executed = 0;      // drained behind it: certainly executed (M-code barriers included)
  LineNumber acknowledged = 0;  // parsed and queued by the CNC, not necessarily executed
  LineNumber sent = 0;          // handed to the port
  LineNumber horizon = 0;       // durable: no line above was ever sent
  friend bool operator==(const LineCertainty&, const LineCertainty&) = default;
};

// A job as handed to the core to be run. The queue has verified it: hashes match and the
// certificate says `pass`; `mode` is the certificate's.
struct JobOrder {
  JobId id{};
  std::string name;
  Mode mode = Mode::kStrict;
  std::shared_ptr<ProgramSource> program;
  LineNumber first_line = 1;  // a recovered job begins with its preamble (recovery_plan.h)
  bool recovers() const { return first_line > 1; }
};

}  // namespace reforge
