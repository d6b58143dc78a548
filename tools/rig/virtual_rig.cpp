#include "tools/rig/virtual_rig.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

namespace reforge {
namespace {

constexpr double kTemperatureStep_c = 1;

double rounded(double value, double unit) {
  return std::round(value / unit) * unit + 0.0;
}

std::size_t index(Link link) {
  return static_cast<std::size_t>(link);
}

}  // namespace

VirtualRig::VirtualRig(const RigDescription& rig, bool homed, std::unique_ptr<ExtruderBoard> board,
                       Trace* trace, RigScript script)
    : board_(std::move(board)),
      cnc_(make_cnc(rig, homed, !board_->run_permitted())),
      script_(std::move(script)),
      to_device_{FaultyWire(4 * script_.seed()), FaultyWire(4 * script_.seed() + 1)},
      to_host_{FaultyWire(4 * script_.seed() + 2), FaultyWire(4 * script_.seed() + 3)},
      in_stream_(rig.cnc.m_codes == MCodeRoute::kInStream),
      trace_(trace),
      to_cnc_(rig.cnc.baud),
      from_cnc_(rig.cnc.baud),
      permitted_(board_->run_permitted()),
      noted_c_(board_->nozzle_c()) {
  if (in_stream_) cnc_->set_ready_input(ready_);
}

void VirtualRig::host_wrote(Link link, std::string_view bytes) {
  to_device_[index(link)].send(bytes, now_);
  pass_to_devices();
}

void VirtualRig::pass_to_devices() {
  to_cnc_.send(to_device_[index(Link::kCnc)].take(now_), now_);
  const std::string bytes = to_device_[index(Link::kExtruder)].take(now_);
  if (bytes.empty()) return;
  witness_.host_sent(bytes);
  board_->receive(bytes);
}

// --- the script

void VirtualRig::run_script() {
  for (const RigAction& action : script_.take_due(now_)) {
    write(now_, "script", {{"action", action.text}});
    act(action);
  }
}

void VirtualRig::act(const RigAction& action) {
  using Kind = RigAction::Kind;
  switch (action.kind) {
    case Kind::kBoard:
      board_->suffer(action.mishap);
      if (action.mishap <= BoardMishap::kPowerCycle) {
        witness_.was_reset(now_, action.mishap == BoardMishap::kReset      ? "button"
                                 : action.mishap == BoardMishap::kBrownOut ? "brown-out"
                                                                           : "power on");
        write_witness(cnc_->g54_position());
      }
      return;
    case Kind::kPanel:
      cnc_->press(action.button);
      return write_cnc_events();
    case Kind::kUnplug:
    case Kind::kSwapPorts:
      port_actions_.push_back(action);
      return;
    default:
      break;
  }
  const auto spoil = [&](FaultyWire& wire) {
    const int bytes = static_cast<int>(action.amount);
    const int64_t ns = std::llround(action.amount * 1e9);
    if (action.kind == Kind::kDrop) wire.drop(bytes);
    if (action.kind == Kind::kFlip) wire.flip(bytes);
    if (action.kind == Kind::kDuplicate) wire.duplicate(bytes);
    if (action.kind == Kind::kStall) wire.stall(now_ + ns);
    if (action.kind == Kind::kDelay) wire.delay(ns);
    if (action.kind == Kind::kNoise) wire.set_noise(action.noise);
  };
  if (action.to_host) spoil(to_host_[index(action.link)]);
  if (action.to_device) spoil(to_device_[index(action.link)]);
}

std::vector<RigAction> VirtualRig::take_port_actions() {
  return std::exchange(port_actions_, {});
}

void VirtualRig::dtr(Link link, bool high) {
  write(now_, "dtr", {{"port", link == Link::kCnc ? "cnc" : "extruder"}, {"high", high}});
  if (link != Link::kExtruder || !high) return;
  board_->reset();
  witness_.was_reset(now_, "DTR");
  write_witness(cnc_->g54_position());
}

std::string VirtualRig::take_for_host(Link link) {
  return std::exchange(for_host_[index(link)], {});
}

void VirtualRig::advance(int64_t until_ns) {
  assert(until_ns >= now_);
  while (now_ < until_ns) {
    step_to(std::min(until_ns, (now_ / kNsPerMs + 1) * kNsPerMs));
    if (!for_host_[0].empty() || !for_host_[1].empty() || !port_actions_.empty()) return;
  }
}

void VirtualRig::step_to(int64_t ns) {
  run_script();
  pass_to_devices();
  board_->advance_to(ns);
  const std::vector<FilamentStep> steps = board_->take_steps();
  witness_.stepped(steps);
  // Where the tool was at the last step: the board may be an instruction ahead of us.
  Axes at_last_step = cnc_->g54_position();
  if (!steps.empty()) {
    run_cnc_to(std::clamp(steps.back().ns, now_, ns));
    at_last_step = cnc_->g54_position();
  }
  write_witness(at_last_step);
  if (!steps.empty()) last_step_at_ = at_last_step;
  run_cnc_to(ns);
  now_ = ns;

  const std::string bytes = board_->take_transmitted();
  if (!bytes.empty()) witness_.board_sent(bytes, board_->last_transmit_start_ns());
  witness_.looked_at(ns);
  write_witness(cnc_->g54_position());
  to_host_[index(Link::kExtruder)].send(bytes, ns);
  to_host_[index(Link::kCnc)].send(from_cnc_.take_arrived(ns), ns);
  for (const Link link : kLinks) for_host_[index(link)] += to_host_[index(link)].take(ns);
  if (in_stream_) connect_in_stream();
  watch_board();
}

void VirtualRig::connect_in_stream() {
  if (const bool ready = board_->ready(); ready != ready_) {
    ready_ = ready;
    if (ready) ready_since_ns_ = now_;
    cnc_->set_ready_input(ready);
  }
  board_->set_cnc_outputs(cnc_->outputs());
}

void VirtualRig::run_cnc_to(int64_t ns) {
  while (true) {
    const int64_t next = std::min({ns, to_cnc_.next_arrival_ns(), cnc_->next_event_ns()});
    cnc_->advance_to(std::max(next, now_));
    now_ = std::max(next, now_);
    cnc_->receive(to_cnc_.take_arrived(now_));
    from_cnc_.send(cnc_->take_transmitted(), now_);
    if (std::min(to_cnc_.next_arrival_ns(), cnc_->next_event_ns()) > ns) break;
  }
  cnc_->advance_to(ns);
  now_ = ns;
  write_cnc_events();
}

void VirtualRig::watch_board() {
  const bool permitted = board_->run_permitted();
  if (permitted != permitted_) {
    permitted_ = permitted;
    write(now_, "permit", {{"run", permitted}});
    cnc_->set_hold_input(!permitted);
    write_cnc_events();
  }
  if (board_->module_open() != module_open_) {
    module_open_ = !module_open_;
    write(now_, "module_output", {{"open", module_open_}});
  }
  if (board_->resets_by_itself() != resets_seen_) {
    resets_seen_ = board_->resets_by_itself();
    witness_.was_reset(now_, "watchdog");
    write_witness(cnc_->g54_position());
  }
  if (board_->crashed() && !std::exchange(crash_noted_, true)) {
    note_fault("extruder", "the firmware executed what no chip would");
  }
  const double nozzle_c = board_->nozzle_c();
  if (std::abs(nozzle_c - noted_c_) >= kTemperatureStep_c) {
    noted_c_ = nozzle_c;
    write(now_, "temperature", {{"nozzle_c", rounded(nozzle_c, 0.01)}});
  }
}

void VirtualRig::note_fault(std::string_view who, const std::string& what) {
  write(now_, "fault", {{"who", std::string(who)}, {"what", what}});
}

void VirtualRig::write(int64_t ns, const char* event, nlohmann::ordered_json fields) {
  script_.note(event, now_);
  if (trace_) trace_->write({ns, event, std::move(fields)});
}

void VirtualRig::put_position(nlohmann::ordered_json& fields, const Axes& g54) const {
  for (int i = 0; i < kAxisCount; ++i) {
    const char key = static_cast<char>(cnc_->axes().letters[i] - 'A' + 'a');
    fields[std::string(1, key)] = std::round(g54[i] * 1e6) / 1e6 + 0.0;
  }
}

void VirtualRig::write_witness(const Axes& at) {
  for (TraceRecord& record : witness_.take()) {
    script_.note(record.event, now_);
    if (!trace_) continue;
    // That filament stands is found out later: the place belongs to its last step.
    const bool stands = record.event == "steps" && record.fields["moving"] == 0;
    put_position(record.fields, stands ? last_step_at_ : at);
    trace_->write(record);
  }
}

void VirtualRig::write_cnc_events() {
  using Kind = CncEvent::Kind;
  for (CncEvent& event : cnc_->take_events()) {
    nlohmann::ordered_json fields = nlohmann::ordered_json::object();
    const char* name = "";
    switch (event.kind) {
      case Kind::kLine:
        name = "line";
        fields = {{"n", event.line}, {"text", event.text}};
        break;
      case Kind::kMove:
        name = "move";
        fields = {{"n", event.line}, {"feed", rounded(event.value * 60, 1e-3)}};
        put_position(fields, event.g54);
        break;
      case Kind::kSpindle:
        name = "spindle";
        fields = {{"rpm", event.value}};
        break;
      case Kind::kDwell:
        name = "dwell";
        fields = {{"seconds", event.value}};
        break;
      case Kind::kHold:
        name = "hold";
        fields = {{"by", event.text}};
        break;
      case Kind::kHeld:
        name = "held";
        put_position(fields, event.g54);
        break;
      case Kind::kResume:
        name = "resume";
        break;
      case Kind::kHomed:
        name = "homed";
        break;
      case Kind::kAlarm:
        name = "alarm";
        fields = {{"code", static_cast<int>(event.value)}};
        put_position(fields, event.g54);
        break;
      case Kind::kReset:
        name = "reset";
        fields = {{"who", "cnc"}};
        break;
      case Kind::kEnd:
        name = "end";
        break;
      case Kind::kCustom:
        // The board has had the order 10 ms (its debouncing) after it was given, and was done when
        // its ready output rose; the controller looks 30 ms after giving it.
        witness_.in_stream_done(static_cast<int>(event.value),
                                std::max(event.ns - 20 * kNsPerMs, ready_since_ns_));
        write_witness(event.g54);
        continue;
      case Kind::kOverride:
        name = "override";
        fields = {{"of", event.text}, {"percent", event.value}};
        break;
      case Kind::kFault:
        name = "fault";
        fields = {{"who", "cnc"}, {"what", event.text}};
        break;
    }
    write(event.ns, name, std::move(fields));
  }
}

}  // namespace reforge
