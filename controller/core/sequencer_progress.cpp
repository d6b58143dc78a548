#include <algorithm>

#include "controller/core/sequencer_impl.h"
#include "controller/core/start_checks.h"

namespace reforge {

namespace {

// An Idle right after a hold may be older than the hold.
constexpr Duration kIdleIsRest = std::chrono::milliseconds(100);

Duration seconds(double s) {
  return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(s));
}

}  // namespace

void Sequencer::Impl::advance() {
  for (RigState before = state;; before = state) {
    switch (state) {
      case RigState::kDisconnected:
        if (open(Link::kCnc) && open(Link::kExtruder)) dispatch(RigEvent::kLinksOpen);
        break;
      case RigState::kIdentifying:
        advance_identity();
        break;
      case RigState::kStarting:
        advance_start();
        break;
      case RigState::kRunning:
        advance_stream();
        break;
      case RigState::kDraining:
        advance_drain();
        break;
      case RigState::kBarrier:
        advance_barrier();
        break;
      case RigState::kResuming:
        advance_resume();
        break;
      default:
        break;
    }
    if (state == before) break;
  }
  report_acknowledged();
  collect_output();
}

void Sequencer::Impl::advance_identity() {
  const Identity::Outcome outcome = identity.step(now, rig, cnc, extruder);
  if (outcome.hold_cnc) hold_cnc();
  if (outcome.reset_cnc) reset_cnc();
  switch (outcome.kind) {
    case Identity::Outcome::Kind::kPending:
      waiting = outcome.sentence;
      return;
    case Identity::Outcome::Kind::kIdentified:
      cnc_owed_hold = false;
      return dispatch(RigEvent::kIdentified);
    case Identity::Outcome::Kind::kHolding:
      return dispatch(RigEvent::kFoundHolding, outcome.sentence);
    case Identity::Outcome::Kind::kFault:
      return dispatch(RigEvent::kFoundFault, outcome.sentence);
  }
}

void Sequencer::Impl::advance_start() {
  const bool fresh = cnc.facts().status && cnc.facts().status_at >= run->started_at;
  if (!run->offsets_answered || !fresh || run->streamer.certainty().horizon < run->order.first_line)
    return;
  if (!run->start_refusal.empty()) return dispatch(RigEvent::kChecksFailed, run->start_refusal);
  std::string all;
  for (const std::string& why :
       readiness_refusals(cnc.facts(), extruder.status(), run->g54, run->order.recovers())) {
    all += (all.empty() ? "" : " ") + why;
  }
  if (!all.empty()) return dispatch(RigEvent::kChecksFailed, all);
  run->acknowledged_at = now;
  dispatch(RigEvent::kChecksPassed);
}

void Sequencer::Impl::ask_horizon() {
  if (const auto line = run->streamer.wanted_horizon()) {
    actions.push_back(RequestHorizon{run->order.id, *line});
  }
}

void Sequencer::Impl::advance_stream() {
  Result<std::string> bytes = run->streamer.pump();
  if (!bytes) return dispatch(RigEvent::kProgramFault, bytes.error().sentence);
  if (!bytes->empty()) send(Link::kCnc, std::move(*bytes), false);
  ask_horizon();
  if (run->streamer.barrier_ahead() || run->streamer.checkpoint_ahead() || run->streamer.at_end()) {
    dispatch(RigEvent::kBarrierReached);
  }
}

void Sequencer::Impl::advance_drain() {
  Barrier& barrier = run->barrier;
  std::string bytes;
  if (!barrier.dwell_sent && run->streamer.pump_drain(bytes)) {
    barrier.dwell_sent = true;
    send(Link::kCnc, std::move(bytes), false);
  }
  if (!barrier.dwell_acknowledged || !barrier.idle_seen) return;
  run->streamer.mark_executed();
  if (run->streamer.checkpoint_ahead()) {
    run->streamer.pass_checkpoint();
    run->barrier = {};
    return dispatch(RigEvent::kCheckpointed);
  }
  dispatch(run->streamer.at_end() ? RigEvent::kFinished : RigEvent::kDrained);
}

void Sequencer::Impl::advance_barrier() {
  if (!run->barrier.done) return;
  const ExtruderOrder done = run->streamer.barrier_order();
  run->streamer.pass_barrier();
  run->barrier = {};
  ++run->relayed;
  run->acknowledged_at = now;
  if (done.m_code == 72) {
    run->bead = done;
    watch.extrusion_on(now);
  } else if (done.m_code == 71 || done.m_code == 73) {
    run->bead.reset();
    watch.extrusion_off();
  }
  dispatch(RigEvent::kBarrierDone);
}

void Sequencer::Impl::advance_resume() {
  if (run->interrupted_bead && extruder.busy()) return;
  dispatch(RigEvent::kRestored);
}

void Sequencer::Impl::take(const CncStatus& status) {
  if (status.state == CncRunState::kAlarm && state != RigState::kIdentifying) {
    return dispatch(RigEvent::kCncAlarm, "The CNC is in alarm.");
  }
  switch (state) {
    case RigState::kIdle:
      if (status.state == CncRunState::kHolding || status.state == CncRunState::kHeld ||
          status.state == CncRunState::kDoor) {
        dispatch(RigEvent::kFoundHolding, "The CNC says " + std::string(name(status.state)) +
                                              ": somebody holds it at the machine.");
      }
      return;
    case RigState::kRunning:
    case RigState::kDraining:
    case RigState::kBarrier:
      if (now >= settled_at) judge_running(status);
      return;
    case RigState::kHolding:
    case RigState::kStopping:
      return judge_coming_to_rest(status);
    case RigState::kHeld:
      if (status.state == CncRunState::kRun) {
        dispatch(RigEvent::kInterlock, "The CNC moves although it was held; it is held again.");
      }
      return;
    default:
      return;
  }
}

void Sequencer::Impl::judge_running(const CncStatus& status) {
  if (state != RigState::kBarrier) {
    const Duration dwells = seconds(run->streamer.dwell_in_flight_s());
    if (auto why = watch.judge(now, status.state, state == RigState::kDraining, dwells)) {
      return dispatch(RigEvent::kInterlock, std::move(*why));
    }
  }
  if (status.state != CncRunState::kRun && status.state != CncRunState::kIdle) {
    return dispatch(RigEvent::kFoundHolding, "The CNC says " + std::string(name(status.state)) +
                                                 ": it was held at the machine.");
  }
  if (acknowledgement_overdue(status)) {
    return dispatch(RigEvent::kAckOverdue,
                    "The CNC is Idle, yet line " +
                        std::to_string(run->streamer.next_unacknowledged()) +
                        " or the dwell behind it was never acknowledged: an acknowledgement was "
                        "lost.");
  }
  if (run->barrier.dwell_acknowledged && status.state == CncRunState::kIdle) {
    run->barrier.idle_seen = true;
  }
}

bool Sequencer::Impl::acknowledgement_overdue(const CncStatus& status) {
  if (status.state != CncRunState::kIdle || run->streamer.all_acknowledged()) {
    run->idle_since.reset();
    return false;
  }
  if (!run->idle_since) run->idle_since = now;
  const Duration patience = options.ack_overdue + seconds(run->streamer.dwell_in_flight_s()) +
                            seconds(rig.spindle.spin_up_s);
  return now - std::max(*run->idle_since, run->acknowledged_at) > patience;
}

void Sequencer::Impl::judge_coming_to_rest(const CncStatus& status) {
  switch (status.state) {
    case CncRunState::kRun:
    case CncRunState::kHolding:
    case CncRunState::kJog:
    case CncRunState::kHome:
      return;
    case CncRunState::kIdle:
      if (now - hold_sent_at < kIdleIsRest) return;
      break;
    default:
      break;
  }
  dispatch(RigEvent::kAtRest, sentence);
}

// A board that no longer pushes while the program has a bead on would leave a gap nobody sees; one
// that is warm without a job is left to its dead-man, since nothing may move.
void Sequencer::Impl::judge_extruder_status() {
  if (!run && warm_until == kNever && extruder.warm() && !extruder.busy() && !extruder.starving()) {
    stop_extrusion();
    extruder.starve(now);
    note(Note::Level::kWarning,
         "The extruder is warm without a job: its heat goes off by its dead-man.");
  }
  if (!watch.depositing() || !extruder.status()) return;
  if (state != RigState::kRunning && state != RigState::kDraining) return;
  const wire::State board = extruder.status()->state;
  if (board == wire::State::kExtruding || board == wire::State::kRestoring) return;
  dispatch(RigEvent::kExtruderFault, "The extruder has stopped pushing filament in mid-bead.");
}

}  // namespace reforge
