// The interlock while filament is pushed: the CNC runs, or extrusion stops.
//
// From M72 done to M73, any CNC state but Run is a violation at once; Idle alone is allowed before
// the first motion (prime dwell and `grace`), and once the drain's dwell is on its way behind the
// last bead (`grace` from the first such Idle). With polls every 200 ms a violation is seen within
// 250 ms.
#pragma once

#include <optional>
#include <string>

#include "controller/core/instant.h"
#include "controller/devices/cnc_device.h"

namespace reforge {

class DepositWatch {
 public:
  explicit DepositWatch(Duration grace) : grace_(grace) {}

  void extrusion_on(Instant now, Duration prime_dwell);
  void extrusion_off();
  bool depositing() const { return depositing_; }

  // A status report arrived. `draining`: a barrier or the end is next and nothing is left to send.
  // Returns why extrusion must stop, if it must.
  std::optional<std::string> judge(Instant now, CncRunState state, bool draining);

 private:
  Duration grace_;
  bool depositing_ = false;
  Instant idle_until_ = kNever;  // Idle is allowed so long
  bool draining_idle_ = false;
};

}  // namespace reforge
