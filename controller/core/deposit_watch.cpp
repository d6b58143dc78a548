#include "controller/core/deposit_watch.h"

#include <algorithm>

namespace reforge {

void DepositWatch::extrusion_on(Instant now) {
  depositing_ = true;
  has_run_ = false;
  idle_while_draining_ = false;
  on_at_ = now;
  idle_until_ = now + grace_;
}

void DepositWatch::extrusion_off() {
  depositing_ = false;
}

std::optional<std::string> DepositWatch::judge(Instant now, CncRunState state, bool draining,
                                               Duration dwells) {
  if (!depositing_) return std::nullopt;
  if (state == CncRunState::kRun) {
    has_run_ = true;
    idle_while_draining_ = false;
    idle_until_ = now;
    return std::nullopt;
  }
  if (!has_run_) idle_until_ = std::max(idle_until_, on_at_ + dwells + grace_);
  if (state == CncRunState::kIdle && draining && !idle_while_draining_) {
    idle_while_draining_ = true;
    idle_until_ = std::max(idle_until_, now + grace_);
  }
  if (state == CncRunState::kIdle && now < idle_until_) return std::nullopt;
  return "The CNC says " + std::string(name(state)) +
         " while filament is being pushed: extrusion is stopped and the CNC held.";
}

}  // namespace reforge
