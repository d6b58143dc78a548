#include <cassert>

#include "controller/core/recovery.h"
#include "controller/core/sequencer_impl.h"

namespace reforge {

namespace {
constexpr std::size_t kZ = 2;  // of the controller's axes
constexpr double kClearSlackMm = 0.05;
constexpr Duration kSettle = std::chrono::milliseconds(250);
}  // namespace

void Sequencer::Impl::perform(Effect effect, const std::string& why) {
  switch (effect) {
    case Effect::kIdentify:
      return identity.begin();
    case Effect::kClearFaults:
      return identity.begin_clear(module_may_retreat);
    case Effect::kCheckStart:
      run->streamer.limit_window(cnc.facts().receive_buffer);
      cnc.ask(now, CncSession::Question::kOffsets);
      cnc.query_status(now);
      return ask_horizon();
    case Effect::kRelay:
      run->streamer.begin_barrier();
      if (!run->barrier.relayed) extruder.order(now, run->streamer.barrier_order());
      run->barrier.relayed = true;
      return;
    case Effect::kPauseExtrusion:
      return pause_extrusion();
    case Effect::kStopExtrusion:
      return stop_extrusion();
    case Effect::kStarve:
      return extruder.starve(now);
    case Effect::kMakeSafe:
      return make_safe();
    case Effect::kHoldCnc:
      return hold_cnc();
    case Effect::kResumeCnc:
      send(Link::kCnc, cnc.device().resume(), true);
      settled_at = now + kSettle;
      run->acknowledged_at = now;
      if (run->interrupted_bead) watch.extrusion_on(settled_at);
      run->interrupted_bead.reset();
      return;
    case Effect::kDropUnsent:
      if (open(Link::kCnc)) actions.push_back(DropUnsent{Link::kCnc});
      return;
    case Effect::kResetCnc:
      return reset_cnc();
    case Effect::kReopenCnc:
      return reopen(Link::kCnc, why);
    case Effect::kReopenExtruder:
      return reopen(Link::kExtruder, why);
    case Effect::kOweHold:
      cnc_owed_hold = true;
      return;
    case Effect::kReheat:
      return reheat();
    case Effect::kRestore:
      if (run->interrupted_bead) extruder.order(now, *run->interrupted_bead);
      return;
    case Effect::kJobRefused:
      return end_job({JobState::kReady, "Not started, nothing was sent. " + why});
    case Effect::kJobRunning:
      actions.push_back(JobChanged{
          run->order.id, JobState::kRunning, run->streamer.certainty(), {}, run->relayed});
      return;
    case Effect::kJobHeld:
      actions.push_back(
          JobChanged{run->order.id, JobState::kHeld, run->streamer.certainty(), why, run->relayed});
      return;
    case Effect::kJobOver:
      assert(run->verdict);
      return end_job(*run->verdict);
  }
}

void Sequencer::Impl::pause_extrusion() {
  Barrier& barrier = run->barrier;
  const bool relaying = barrier.relayed && !barrier.done;
  const int m_code = relaying ? run->streamer.barrier_order().m_code : 0;
  const bool ending = m_code == 71 || m_code == 73;  // the bead has its end already
  if (run->bead && !ending) run->interrupted_bead = run->bead;
  if (m_code == 72) barrier.relayed = false;  // given again after the hold
  watch.extrusion_off();
  if ((run->bead && !ending) || m_code == 72) stop_extrusion();
}

void Sequencer::Impl::stop_extrusion() {
  extruder.order(now, {73});
  watch.extrusion_off();
  send(Link::kExtruder, extruder.take_output(), true);
}

void Sequencer::Impl::reheat() {
  if (!reheat_c) return end_reheat();
  extruder.order(now, {70, *reheat_c});
  warm_until = now + options.reheat_max;
}

// The module stays where it is: nobody knows whether it stands in the part.
void Sequencer::Impl::end_reheat() {
  warm_until = kNever;
  stop_extrusion();
  extruder.starve(now);
  note(Note::Level::kInfo, "The nozzle is no longer kept hot.");
}

bool Sequencer::Impl::module_is_clear() const {
  const CncFacts& facts = cnc.facts();
  if (!facts.status || !facts.status->has_position || !facts.g54) return false;
  if (facts.status->axes < 3 || facts.g54->axes < 3) return false;
  const bool rests =
      facts.status->state == CncRunState::kIdle || facts.status->state == CncRunState::kHeld;
  const double z = facts.status->machine_position[kZ] - facts.g54->offset[kZ];
  return rests && z >= rig.clear_height_mm - kClearSlackMm;
}

void Sequencer::Impl::make_safe() {
  if (extruder.status() && extruder.status()->state == wire::State::kClosed) return;
  const bool clear = cnc.facts().status ? module_is_clear() : module_was_clear;
  if (clear) {
    extruder.order(now, {71});
  } else {
    extruder.starve(now);
    note(Note::Level::kWarning,
         "The extruder module is not clear of the part, so it stays where it is; its heat goes off "
         "by its dead-man.");
  }
}

void Sequencer::Impl::hold_cnc() {
  if (!open(Link::kCnc)) return;
  send(Link::kCnc, cnc.device().hold(), true);
  hold_sent_at = now;
  rest_by = now + options.rest;
  if (run) run->barrier.idle_seen = false;
  if (run) run->idle_since.reset();
}

void Sequencer::Impl::reset_cnc() {
  if (!open(Link::kCnc)) return;
  module_was_clear = module_is_clear();
  send(Link::kCnc, cnc.device().reset(), true);
  cnc.reset_sent(now);
  rest_by = now + options.rest;
}

void Sequencer::Impl::reopen(Link link, const std::string& why) {
  if (link == Link::kExtruder) extruder_owed_stop = true;
  if (!open(link)) return;
  open(link) = false;
  if (link == Link::kCnc) {
    cnc.closed();
  } else {
    extruder.closed();
  }
  actions.push_back(Reopen{link, why});
}

void Sequencer::Impl::end_job(const Verdict& verdict) {
  report_acknowledged();
  std::string text = verdict.sentence;
  const LineCertainty& certainty = run->streamer.certainty();
  if (is_over(verdict.state) && verdict.state != JobState::kDone) {
    text += (text.empty() ? "" : " ") + interruption_sentence(certainty, true);
  }
  actions.push_back(
      JobChanged{run->order.id, verdict.state, certainty, std::move(text), run->relayed});
  watch.extrusion_off();
  run.reset();
}

void Sequencer::Impl::report_acknowledged() {
  if (!run || run->streamer.certainty().acknowledged == run->reported) return;
  run->reported = run->streamer.certainty().acknowledged;
  actions.push_back(Acknowledged{run->order.id, run->streamer.certainty(), run->relayed});
}

void Sequencer::Impl::send(Link link, std::string bytes, bool urgent) {
  if (open(link) && !bytes.empty()) actions.push_back(Send{link, std::move(bytes), urgent});
}

void Sequencer::Impl::collect_output() {
  std::string bytes = cnc.take_output();
  const bool query = bytes == cnc.device().status_query();  // a real-time byte waits for no line
  send(Link::kCnc, std::move(bytes), query);
  send(Link::kExtruder, extruder.take_output(), false);
}

void Sequencer::Impl::note(Note::Level level, std::string text) {
  actions.push_back(Note{level, std::move(text)});
}

bool Sequencer::Impl::awaits_rest() const {
  return state == RigState::kHolding || state == RigState::kStopping ||
         state == RigState::kResetting;
}

}  // namespace reforge
