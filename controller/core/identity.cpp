#include "controller/core/identity.h"

#include <utility>

#include "controller/core/start_checks.h"
#include "protocols/extruder_text.h"

namespace reforge {

namespace {

using Outcome = Identity::Outcome;
using Kind = Outcome::Kind;

Outcome pending(std::string sentence) {
  return {Kind::kPending, std::move(sentence)};
}

bool stands_still(CncRunState state) {
  return state == CncRunState::kHeld || state == CncRunState::kDoor ||
         state == CncRunState::kAlarm || state == CncRunState::kSleep ||
         state == CncRunState::kCheck || state == CncRunState::kTool;
}

}  // namespace

void Identity::begin_clear(bool module_may_retreat) {
  begin();
  clear_ = true;
  may_retreat_ = module_may_retreat;
}

void Identity::answered(const CncSession::Answered& answer) {
  if (answer.question == CncSession::Question::kIdentity) cnc_answered_ = true;
  if (!answer.error.empty()) refusal_ = answer.error;
}

bool Identity::banner() {
  if (!reset_sent_ || reset_answered_) return false;
  reset_answered_ = true;
  return true;
}

Outcome Identity::step(Instant now, const RigDescription& rig, CncSession& cnc,
                       ExtruderLink& extruder) {
  if (!refusal_.empty()) return {Kind::kFault, std::exchange(refusal_, {})};
  Outcome outcome = step_extruder(now, extruder);
  if (outcome.kind != Kind::kIdentified) return outcome;
  outcome = step_cnc(now, rig, cnc);
  if (outcome.kind == Kind::kIdentified && extruder.status()->fault != wire::Fault::kNone) {
    return {Kind::kFault, "Extruder fault: " + std::string(sentence_of(extruder.status()->fault))};
  }
  return outcome;
}

Outcome Identity::step_extruder(Instant now, ExtruderLink& extruder) {
  if (!extruder.identified()) {
    return pending("Waiting for the extruder board to answer on its port.");
  }
  if (!clear_) return {Kind::kIdentified, {}};
  if (extruder.status()->fault != wire::Fault::kNone && !fault_clear_sent_) {
    extruder.clear_fault(now);
    fault_clear_sent_ = true;
  }
  if (extruder.busy()) return pending("Waiting for the extruder to clear its fault or retreat.");
  if (may_retreat_ && !retreat_sent_ && extruder.status()->state != wire::State::kClosed) {
    extruder.order(now, {71});
    retreat_sent_ = true;
    return pending("Waiting for the extruder module to retreat.");
  }
  return {Kind::kIdentified, {}};
}

Outcome Identity::step_cnc(Instant now, const RigDescription& rig, CncSession& cnc) {
  if (!cnc.facts().status) return pending("Waiting for the CNC to answer on its port.");
  const CncRunState state = cnc.facts().status->state;
  if (state == CncRunState::kHolding) return pending("The CNC is coming to rest.");
  if (clear_ && state != CncRunState::kIdle && !unlock_sent_) return clear_cnc(now, state, cnc);
  if (cnc.asking() != CncSession::Question::kNone) return pending("Waiting for the CNC's answer.");
  if (state == CncRunState::kAlarm && unlock_sent_) {
    return {Kind::kFault, "The CNC stays in alarm: home it, or look for what causes the alarm."};
  }
  if (state != CncRunState::kIdle && state != CncRunState::kAlarm) {
    return {Kind::kHolding, "The CNC says " + std::string(name(state)) +
                                " with work that nobody here is sending: look at the rig, then "
                                "clear it (the CNC is reset)."};
  }
  if (!cnc_asked_) {
    cnc_asked_ = true;
    cnc.ask(now, CncSession::Question::kIdentity);
  }
  if (!cnc_answered_) return pending("Waiting for the CNC to say what it is.");
  if (auto refusal = identity_refusal(cnc.facts(), rig)) return {Kind::kFault, *refusal};
  if (state == CncRunState::kAlarm) {
    return {Kind::kFault,
            "The CNC is in alarm: look at the rig, then clear it; home it if its "
            "position is lost."};
  }
  return {Kind::kIdentified, {}};
}

// The CNC moves, is held, or is in alarm, and the operator has said that it may be reset.
Outcome Identity::clear_cnc(Instant now, CncRunState state, CncSession& cnc) {
  Outcome out = pending("Waiting for the CNC to come to rest and to reset.");
  if (!reset_sent_) {
    out.reset_cnc = reset_sent_ = stands_still(state);
    out.hold_cnc = !reset_sent_ && !std::exchange(hold_sent_, true);
  } else if (reset_answered_ && state == CncRunState::kAlarm &&
             cnc.asking() == CncSession::Question::kNone) {
    unlock_sent_ = true;
    cnc.ask(now, CncSession::Question::kUnlock);
  } else if (reset_answered_ && state != CncRunState::kAlarm) {
    reset_sent_ = reset_answered_ = hold_sent_ = false;  // held again: its input may be active
    clear_ = false;
  }
  return out;
}

}  // namespace reforge
