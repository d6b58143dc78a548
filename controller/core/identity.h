// Who and how the devices are, asked before anything moves; and the operator's clear.
//
// Order: the extruder greets, its settings agree, it is well; then the CNC says its state and its
// axes. With a clear, on the way: the extruder's fault is cleared, its module retreats if the
// operator gave leave, a CNC in hold or alarm is reset (a moving one held first) and unlocked.
// Without a clear nothing is changed: a hold or a fault found is reported.
#pragma once

#include <string>

#include "controller/devices/cnc_session.h"
#include "controller/devices/extruder_link.h"
#include "protocols/rig.h"

namespace reforge {

class Identity {
 public:
  struct Outcome {
    enum class Kind : std::uint8_t { kPending, kIdentified, kHolding, kFault };
    Kind kind = Kind::kPending;
    std::string sentence;   // what it waits for, or what was found
    bool hold_cnc = false;  // to be sent now; the caller tells the session
    bool reset_cnc = false;
  };

  void begin() { *this = Identity(); }
  void begin_clear(bool module_may_retreat);

  // To be called after every event until it is no longer pending.
  Outcome step(Instant now, const RigDescription& rig, CncSession& cnc, ExtruderLink& extruder);

  void answered(const CncSession::Answered& answer);
  void order_refused(std::string sentence) { refusal_ = std::move(sentence); }
  // A banner: true if it answers a reset of ours.
  bool banner();

 private:
  Outcome step_extruder(Instant now, ExtruderLink& extruder);
  Outcome step_cnc(Instant now, const RigDescription& rig, CncSession& cnc);
  Outcome clear_cnc(Instant now, CncRunState state, CncSession& cnc);

  bool clear_ = false;
  bool may_retreat_ = false;
  bool fault_clear_sent_ = false;
  bool retreat_sent_ = false;
  bool hold_sent_ = false;
  bool reset_sent_ = false;
  bool reset_answered_ = false;
  bool unlock_sent_ = false;
  bool cnc_asked_ = false;
  bool cnc_answered_ = false;
  std::string refusal_;
};

}  // namespace reforge
