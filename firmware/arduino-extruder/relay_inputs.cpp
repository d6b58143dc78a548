#include "firmware/arduino-extruder/relay_inputs.h"

#include "firmware/arduino-extruder/limits.h"

namespace reforge {
namespace firmware {

using wire::Fault;
using wire::Reason;
using wire::State;

bool RelayInputs::Debounced::tick(bool raw) {
  different_ = raw == level_ ? 0 : static_cast<uint8_t>(different_ + 1);
  if (different_ >= kDebounce) {
    level_ = raw;
    different_ = 0;
  }
  return level_;
}

void RelayInputs::tick(const Levels& raw, uint32_t now_ms) {
  const bool open = inputs_[0].tick(raw.open);
  const bool extrude = inputs_[1].tick(raw.extrude);
  const bool retract = inputs_[2].tick(raw.retract);
  const bool running = inputs_[3].tick(raw.running);
  if (!settings_.get(wire::Setting::kInStream)) return;
  extruder_.refresh(Authority::kInStream, now_ms);
  if (extruder_.state() == State::kFault) {
    // Nothing is repeated by itself once the fault is cleared: every relay must first fall.
    open_ = open;
    extrude_ = extrude;
    retract_ = retract;
    return;
  }
  if (extrude && retract) return extruder_.fault(Fault::kInputConflict);

  if (!extrude && extrude_) order(73, extrude_, false, now_ms);
  if (!open && open_) order(71, open_, false, now_ms);
  if (extrude && extrude_ && !running) return extruder_.fault(Fault::kCncStopped);

  // Heating up takes minutes: whoever does not wait for it may not extrude late.
  const bool opening = extruder_.state() == State::kOpening;
  if (extruder_.under_way() && !opening) return;
  if (open && !open_) order(70, open_, true, now_ms);
  if (!retract && retract_) order(75, retract_, false, now_ms);
  if (retract && !retract_) order(74, retract_, true, now_ms);
  if (extrude && !extrude_) {
    if (!running) return extruder_.fault(Fault::kCncStopped);
    order(72, extrude_, true, now_ms);
  }
}

void RelayInputs::order(uint8_t m_code, bool& acted, bool level, uint32_t now_ms) {
  acted = level;
  if (extruder_.command(m_code, wire::kUseSetting, now_ms) != Reason::kNone) {
    extruder_.fault(Fault::kRefusedInput);
  }
}

bool RelayInputs::ready() const {
  return !extruder_.under_way() && extruder_.state() != State::kFault;
}

}  // namespace firmware
}  // namespace reforge
