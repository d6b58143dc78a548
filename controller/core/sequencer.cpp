#include "controller/core/sequencer.h"

#include <cassert>
#include <utility>

#include "controller/core/sequencer_impl.h"
#include "controller/core/start_checks.h"
#include "controller/devices/cnc_grbl.h"

namespace reforge {

namespace {

template <class... Ts>
struct Overloaded : Ts... {
  using Ts::operator()...;
};
template <class... Ts>
Overloaded(Ts...) -> Overloaded<Ts...>;

std::string joined(const std::vector<std::string>& sentences) {
  std::string out;
  for (const std::string& s : sentences) out += (out.empty() ? "" : " ") + s;
  return out;
}

RigEvent event_of(const OperatorOrder& order) {
  constexpr RigEvent kEvents[] = {RigEvent::kStart,    RigEvent::kHold,      RigEvent::kResume,
                                  RigEvent::kAbort,    RigEvent::kEmergency, RigEvent::kClear,
                                  RigEvent::kShutdown, RigEvent::kReheat};
  static_assert(std::size(kEvents) == std::variant_size_v<OperatorOrder>);
  return kEvents[order.index()];
}

constexpr std::string_view kWords[] = {
    "",
    "Held by the operator.",
    "",
    "Aborted by the operator.",
    "Emergency: the CNC was reset at once, its position is lost; extrusion and heat are off.",
    "Cleared by the operator.",
    "The daemon was stopped.",
    ""};

}  // namespace

std::string_view name(Link link) {
  return link == Link::kCnc ? "CNC" : "extruder";
}

Result<std::unique_ptr<CncDevice>> make_cnc_device(const CncLink& link) {
  if (link.dialect == CncDialect::kGrbl) return std::unique_ptr<CncDevice>(new CncGrbl(link));
  return Result<std::unique_ptr<CncDevice>>::fail(
      Code::kRefused, "The daemon does not speak this CNC dialect yet; only 'grbl' is built.");
}

Sequencer::Impl::Impl(RigDescription rig_description, std::unique_ptr<CncDevice> device,
                      CoreOptions core_options)
    : rig(std::move(rig_description)),
      options(core_options),
      cnc(std::move(device), options.cnc),
      extruder(rig, options.extruder, options.extruder_session),
      watch(options.deposit_grace) {}

void Sequencer::Impl::dispatch(RigEvent event, std::string why) {
  const Step next = step(state, event);
  assert(!next.refused());  // only the operator is refused, and order() asks first
  if (run) set_verdict(event, why);
  const RigState from = std::exchange(state, next.next);
  if (awaits_rest() && from != state) rest_by = now + options.rest;
  for (const Effect effect : next.effects) perform(effect, why);
  if (from == state) return;
  if (state != RigState::kIdle && state != RigState::kStarting) warm_until = kNever;
  sentence = why;
  waiting.clear();
  cnc.watch_closely(now, has_job(state) || state == RigState::kIdentifying);
  actions.push_back(StateChanged{from, state, std::move(why)});
}

void Sequencer::Impl::set_verdict(RigEvent event, const std::string& why) {
  if (run->verdict) return;
  const auto set = [&](JobState end) { run->verdict = Verdict{end, why}; };
  switch (event) {
    case RigEvent::kFinished:
      return set(JobState::kDone);
    case RigEvent::kAbort:
    case RigEvent::kEmergency:
      return set(JobState::kAborted);
    case RigEvent::kCncLost:
    case RigEvent::kExtruderLost:
    case RigEvent::kCncReset:
    case RigEvent::kAckOverdue:
    case RigEvent::kShutdown:
      return set(JobState::kInterrupted);
    case RigEvent::kCncError:
    case RigEvent::kCncAlarm:
    case RigEvent::kExtruderFault:
    case RigEvent::kProgramFault:
    case RigEvent::kRestOverdue:
      return set(JobState::kFailed);
    default:
      return;
  }
}

void Sequencer::Impl::link_opened(Link link) {
  open(link) = true;
  if (link == Link::kExtruder) {
    extruder.opened(now);
    return;
  }
  if (cnc_owed_hold) hold_cnc();
  cnc.opened(now);
}

void Sequencer::Impl::link_lost(Link link, std::string_view why) {
  if (!open(link)) return;
  open(link) = false;
  if (link == Link::kCnc) {
    cnc.closed();
  } else {
    extruder.closed();
    extruder_owed_stop = true;
  }
  dispatch(link == Link::kCnc ? RigEvent::kCncLost : RigEvent::kExtruderLost,
           "The " + std::string(name(link)) + "'s link was lost: " + std::string(why));
}

void Sequencer::Impl::take(const CncSession::Event& event) {
  std::visit(
      Overloaded{[&](const CncReport& e) { take(e); },
                 [&](const CncSession::Answered& e) {
                   if (e.question == CncSession::Question::kOffsets && run) {
                     run->offsets_answered = true;
                     run->start_refusal = e.error;
                   }
                   identity.answered(e);
                 },
                 [&](const CncSession::Silent& e) { dispatch(RigEvent::kCncLost, e.sentence); }},
      event);
}

void Sequencer::Impl::take(const CncReport& event) {
  std::visit(Overloaded{[&](const CncStatus& e) { take(e); },
                        [&](const cnc::Acknowledged&) { take_acknowledgement(); },
                        [&](const cnc::Rejected& e) { take_rejection(e); },
                        [&](const cnc::Alarm& e) {
                          dispatch(RigEvent::kCncAlarm, "The CNC reports " + e.sentence + ".");
                        },
                        [&](const cnc::Banner& e) {
                          if (state == RigState::kIdentifying && identity.banner()) return;
                          if (state == RigState::kResetting) return dispatch(RigEvent::kResetDone);
                          dispatch(RigEvent::kCncReset,
                                   "The CNC has restarted by itself (" + e.text + ").");
                        },
                        [&](const cnc::Message& e) { note(Note::Level::kInfo, "CNC: " + e.text); },
                        [&](const cnc::Garbage& e) { take_garbage(e); }, [&](const cnc::Resend&) {},
                        [](const cnc::Identity&) {}, [](const cnc::WorkOffset&) {}},
             event);
}

void Sequencer::Impl::take_acknowledgement() {
  if (!run) {
    if (state == RigState::kIdle) {
      note(Note::Level::kWarning, "The CNC has acknowledged a line that nobody sent.");
    }
    return;
  }
  switch (run->streamer.settle()) {
    case Streamer::Settled::kDrain:
      run->barrier.dwell_acknowledged = true;
      if (state == RigState::kDraining) cnc.query_status(now);
      [[fallthrough]];
    case Streamer::Settled::kLine:
      run->acknowledged_at = now;
      run->idle_since.reset();
      return;
    case Streamer::Settled::kUnexpected:
      if (state == RigState::kStarting) return;
      dispatch(
          RigEvent::kAckOverdue,
          "The CNC has acknowledged more lines than it was sent: nothing it acknowledged can be "
          "relied upon.");
  }
}

void Sequencer::Impl::take_rejection(const cnc::Rejected& rejected) {
  if (!run) {
    note(Note::Level::kWarning, "The CNC reports " + rejected.sentence + ".");
    return;
  }
  const LineNumber line = run->streamer.next_unacknowledged();
  dispatch(RigEvent::kCncError,
           "The CNC refused " +
               (line > 0 ? "line " + std::to_string(line) : std::string("the dwell of a drain")) +
               ": " + rejected.sentence + ".");
  if (run) run->streamer.settle();
}

void Sequencer::Impl::take_garbage(const cnc::Garbage& text) {
  // A flood is told at 1, 2, 4, 8, ... lines.
  ++garbage;
  if ((garbage & (garbage - 1)) != 0) return;
  std::string shown;
  for (const char c : text.text) shown += c >= 0x20 && c < 0x7F ? c : '.';
  note(Note::Level::kWarning, "The CNC's link carries what is not its language (" +
                                  std::to_string(garbage) + " lines so far): '" + shown + "'.");
}

void Sequencer::Impl::take(const ExtruderLink::Event& event) {
  std::visit(
      Overloaded{
          [&](const ExtruderLink::Identified& e) {
            note(Note::Level::kInfo, "Extruder board, firmware " + e.version + ".");
            if (std::exchange(extruder_owed_stop, false)) stop_extrusion();
          },
          [&](const ExtruderLink::WrongBoard& e) { dispatch(RigEvent::kFoundFault, e.sentence); },
          [&](const ExtruderLink::Done& e) {
            if (run && run->barrier.relayed && e.order == run->streamer.barrier_order()) {
              run->barrier.done = true;
            }
          },
          [&](const ExtruderLink::Refused& e) {
            const bool wanted = run && !run->verdict &&
                                ((run->barrier.relayed && !run->barrier.done &&
                                  e.order == run->streamer.barrier_order()) ||
                                 (state == RigState::kResuming && e.order.m_code == 72));
            if (wanted) return dispatch(RigEvent::kExtruderFault, e.sentence);
            if (state == RigState::kIdentifying && e.order.m_code == 71) {
              return identity.order_refused(e.sentence);
            }
            // A closed or faulted board refuses a precautionary M73; that is as good as done.
            if (e.order.m_code != 73) note(Note::Level::kWarning, e.sentence);
          },
          [&](const ExtruderLink::Fault& e) { dispatch(RigEvent::kExtruderFault, e.sentence); },
          [&](const ExtruderLink::Lost& e) { dispatch(RigEvent::kExtruderLost, e.sentence); }},
      event);
}

Status Sequencer::Impl::prepare(const StartOrder& start) {
  const auto refuse = [](std::string why) { return Error{Code::kRefused, std::move(why)}; };
  assert(start.job.program);
  if (auto why = start_refusals(rig, options.ports_are_virtual, start.job.mode); !why.empty()) {
    return refuse(joined(why));
  }
  if (start.job.program->line_count() == 0) return refuse("The program is empty.");
  Result<Point<MachineFrame>> g54 = g54_of_header(*start.job.program, rig);
  if (!g54) return g54.error();
  StreamerOptions streaming;
  streaming.horizon_ahead = options.horizon_ahead;
  streaming.first_line = start.job.first_line;
  streaming.checkpoint_every = options.checkpoint_every;
  streaming.relay = rig.cnc.m_codes == MCodeRoute::kRelay;
  run.emplace(start.job, *g54, cnc.device(), rig, streaming);
  run->started_at = now;
  run->reported = start.job.first_line - 1;
  return Unit{};
}

Status Sequencer::Impl::fits_reheat(const ReheatOrder& heat) const {
  if (!heat.temperature_c) return Unit{};
  const double least = rig.extrusion.minimum_temperature.value();
  const double most = rig.extrusion.maximum_temperature.value();
  if (*heat.temperature_c >= least && *heat.temperature_c <= most) return Unit{};
  return Error{Code::kOutOfRange, "The nozzle is heated to between " + std::to_string(least) +
                                      " and " + std::to_string(most) + " degrees C."};
}

Status Sequencer::Impl::order(const OperatorOrder& order) {
  const RigEvent event = event_of(order);
  if (const Step next = step(state, event); next.refused()) {
    return Error{Code::kRefused, std::string(next.refusal)};
  }
  if (const auto* resume = std::get_if<ResumeOrder>(&order);
      resume && run->interrupted_bead && !resume->bead_inspected) {
    return Error{
        Code::kRefused,
        "The hold ended a bead before line " +
            std::to_string(run->streamer.certainty().acknowledged + 1) +
            " was taken: look at the bead and the nozzle, then resume saying that the bead "
            "was inspected."};
  }
  const bool heats =
      std::holds_alternative<StartOrder>(order) || std::holds_alternative<ReheatOrder>(order);
  if (heats && extruder.starving()) {
    return Error{Code::kRefused,
                 "The extruder's heat is just going off by its dead-man: wait some seconds, then "
                 "clear its fault."};
  }
  if (const auto* start = std::get_if<StartOrder>(&order)) {
    if (Status prepared = prepare(*start); !prepared) return prepared;
  }
  if (const auto* clear = std::get_if<ClearOrder>(&order)) {
    module_may_retreat = clear->module_may_retreat;
  }
  if (const auto* heat = std::get_if<ReheatOrder>(&order)) {
    if (Status fits = fits_reheat(*heat); !fits) return fits;
    reheat_c = heat->temperature_c;
  }
  dispatch(event, std::string(kWords[order.index()]));
  return Unit{};
}

// --- The public face: set the time, take the event, follow it to its end.

Sequencer::Sequencer(RigDescription rig, std::unique_ptr<CncDevice> cnc, CoreOptions options)
    : impl_(std::make_unique<Impl>(std::move(rig), std::move(cnc), options)) {}
Sequencer::~Sequencer() = default;

void Sequencer::recover_interrupted() {
  assert(!impl_->open(Link::kCnc) && !impl_->open(Link::kExtruder));
  impl_->cnc_owed_hold = impl_->extruder_owed_stop = true;
}

void Sequencer::link_opened(Instant now, Link link) {
  impl_->now = now;
  impl_->link_opened(link);
  impl_->advance();
}

void Sequencer::link_lost(Instant now, Link link, std::string_view why) {
  impl_->now = now;
  impl_->link_lost(link, why);
  impl_->advance();
}

void Sequencer::receive(Instant now, Link link, std::string_view bytes) {
  impl_->now = now;
  if (!impl_->open(link)) return;
  if (link == Link::kCnc) {
    for (const CncSession::Event& event : impl_->cnc.receive(now, bytes)) {
      impl_->take(event);
    }
  } else {
    for (const ExtruderLink::Event& event : impl_->extruder.receive(now, bytes)) {
      impl_->take(event);
    }
    impl_->judge_extruder_status();
  }
  impl_->advance();
}

void Sequencer::horizon_durable(Instant now, JobId job, LineNumber line) {
  impl_->now = now;
  if (!impl_->run || impl_->run->order.id != job) return;
  impl_->run->streamer.horizon_durable(line);
  impl_->advance();
}

void Sequencer::tick(Instant now) {
  impl_->now = now;
  for (const CncSession::Event& event : impl_->cnc.tick(now)) impl_->take(event);
  for (const ExtruderLink::Event& event : impl_->extruder.tick(now)) impl_->take(event);
  if (now >= impl_->warm_until) impl_->end_reheat();
  if (impl_->awaits_rest() && now >= impl_->rest_by) {
    impl_->dispatch(RigEvent::kRestOverdue,
                    impl_->state == RigState::kResetting
                        ? "The CNC did not answer its reset: use the machine's E-stop."
                        : "The CNC did not come to rest after the hold, so it was reset in motion "
                          "and its position is lost.");
  }
  impl_->advance();
}

Status Sequencer::order(Instant now, const OperatorOrder& order) {
  impl_->now = now;
  Status done = impl_->order(order);
  impl_->advance();
  return done;
}

Instant Sequencer::next_deadline() const {
  const Instant devices = earlier(
      earlier(impl_->cnc.next_deadline(), impl_->extruder.next_deadline()), impl_->warm_until);
  return impl_->awaits_rest() ? earlier(devices, impl_->rest_by) : devices;
}

std::vector<Action> Sequencer::take_actions() {
  return std::exchange(impl_->actions, {});
}

RigSnapshot Sequencer::snapshot() const {
  RigSnapshot out;
  out.state = impl_->state;
  out.sentence = impl_->waiting.empty() ? impl_->sentence : impl_->waiting;
  out.cnc_open = impl_->open(Link::kCnc);
  out.extruder_open = impl_->open(Link::kExtruder);
  out.cnc = impl_->cnc.facts().status;
  out.cnc_version = impl_->cnc.facts().version;
  out.extruder = impl_->extruder.status();
  out.depositing = impl_->watch.depositing();
  if (impl_->run) {
    out.job = impl_->run->order.id;
    out.lines = impl_->run->order.program->line_count();
    out.certainty = impl_->run->streamer.certainty();
    out.unacknowledged_bytes = impl_->run->streamer.unacknowledged_bytes();
    out.relayed = impl_->run->relayed;
  }
  return out;
}

}  // namespace reforge
