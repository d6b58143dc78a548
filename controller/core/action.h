// What the core wants done: values, carried out by io in the order given.
//
// Bytes for a port are Send; io paces them by its own clock and keeps few in the kernel. An urgent
// Send (hold, reset, M73) goes before every byte io still holds for that link. Horizon,
// Acknowledged and JobChanged are the journal's. Nothing here waits: answers come back as events.
#pragma once

#include <string>
#include <variant>

#include "controller/core/job.h"
#include "controller/core/rig_state.h"

namespace reforge {

enum class Link : std::uint8_t { kCnc, kExtruder };
constexpr int kLinkCount = 2;

std::string_view name(Link link);  // "CNC", "extruder"

struct Send {
  Link link;
  std::string bytes;
  bool urgent = false;  // overtakes what io holds unsent for this link
};

// Discard what io still holds unsent for the link (bytes handed to the kernel are gone). Comes
// before the urgent Send it belongs to; the line cut short is cleared by the reset that follows.
struct DropUnsent {
  Link link;
};

// Close the port and open it again, after the urgent bytes have left. The UNO must not be reset by
// it (HUPCL off); answer with link_opened or keep trying.
struct Reopen {
  Link link;
  std::string sentence;  // why
};

// Make "lines up to `line` may be sent" durable, then answer with horizon_durable(job, line).
struct RequestHorizon {
  JobId job;
  LineNumber line;
};

// Lines up to `certainty.acknowledged` are acknowledged; to be journalled (batches are fine).
struct Acknowledged {
  JobId job;
  LineCertainty certainty;
  std::int64_t relayed;  // M-codes the extruder has done in this job
};

// The job entered a state. Final states carry what is known of the lines and a sentence.
struct JobChanged {
  JobId job;
  JobState state;
  LineCertainty certainty;
  std::string sentence;
  std::int64_t relayed;
};

// The rig entered a state (for clients and the journal).
struct StateChanged {
  RigState from;
  RigState to;
  std::string sentence;  // why, when there is a why
};

// Something a person should read: device messages, garbage on a link, retries.
struct Note {
  enum class Level : std::uint8_t { kInfo, kWarning, kError };
  Level level;
  std::string sentence;
};

using Action = std::variant<Send, DropUnsent, Reopen, RequestHorizon, Acknowledged, JobChanged,
                            StateChanged, Note>;

}  // namespace reforge
