// The interlock while filament is pushed: the CNC runs, or extrusion stops.
//
// From M72 done to M73, any CNC state but Run is a violation at once, with two exceptions for Idle:
// before the first motion it may last as long as the dwells that are under way (priming) and
// `grace`; and once the drain's dwell is on its way behind the last bead, `grace` from the first
// such Idle. With polls every 200 ms a violation is acted upon within 250 ms.
#pragma once

#include <optional>
#include <string>

#include "controller/core/instant.h"
#include "controller/devices/cnc_device.h"

namespace reforge {

class DepositWatch {
 public:
  explicit DepositWatch(Duration grace) : grace_(grace) {}

  void extrusion_on(Instant now);
  void extrusion_off();
  bool depositing() const { return depositing_; }

  // A status report arrived. `draining`: a barrier or the end is next and nothing is left to send;
  // `dwells`: the G4 handed over and not yet acknowledged. Returns why extrusion must stop, if so.
  std::optional<std::string> judge(Instant now, CncRunState state, bool draining, Duration dwells);

 private:
  Duration grace_;
  bool depositing_ = false;
  bool has_run_ = false;
  Instant on_at_{};
  Instant idle_until_{};
  bool idle_while_draining_ = false;
};

}  // namespace reforge
