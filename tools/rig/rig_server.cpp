#include "tools/rig/rig_server.h"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <utility>
#include <vector>

namespace reforge {
namespace {

using std::chrono::duration_cast;
using std::chrono::microseconds;
using std::chrono::nanoseconds;

constexpr int64_t kTickMaxNs = 10 * kNsPerMs;
constexpr auto kBehindMax = std::chrono::milliseconds(50);
// Bytes the daemon has counted are in the kernel already; a wait this long means they were thrown
// away on the way (a flush of the output), and waiting on would stop time for good.
constexpr auto kCountedBytesWait = std::chrono::seconds(5);

}  // namespace

RigServer::RigServer(VirtualRig& rig, Ports& ports, Options options)
    : rig_(rig),
      ports_(ports),
      options_(std::move(options)),
      ports_state_{PortState{&ports.cnc}, PortState{&ports.extruder}} {
  anchor();
}

void RigServer::anchor() {
  anchor_ns_ = rig_.now_ns();
  anchor_wall_ = Wall::now();
}

RigServer::Wall::time_point RigServer::due(int64_t ns) const {
  const double wall_ns = static_cast<double>(ns - anchor_ns_) / options_.speed.value_or(1);
  return anchor_wall_ + nanoseconds(static_cast<int64_t>(wall_ns));
}

void RigServer::run(int stop_fd) {
  while (!stopped_) {
    const bool daemon = ports_.clock && ports_.clock->connected();
    daemon ? run_with_daemon(stop_fd) : run_free(stop_fd);
  }
}

// One wait and what follows from it; time by the wall clock.
void RigServer::run_free(int stop_fd) {
  const double speed = options_.speed.value_or(1);
  const auto elapsed = duration_cast<nanoseconds>(Wall::now() - anchor_wall_).count();
  const int64_t target = anchor_ns_ + static_cast<int64_t>(static_cast<double>(elapsed) * speed);
  const auto begun = Wall::now();
  while (rig_.now_ns() < target && Wall::now() - begun < kBehindMax) {
    rig_.advance(target);
    deliver();
    handle_ports();
  }
  if (rig_.now_ns() < target) anchor();

  const auto next = due((rig_.now_ns() / kNsPerMs + 1) * kNsPerMs);
  const auto left = duration_cast<microseconds>(next - Wall::now()).count();
  if (!wait(stop_fd, static_cast<int>(std::clamp<int64_t>(left, 0, 10'000)), true)) return;
  take_modem_lines();
  for (const Link link : kLinks) take_in(link, port(link).pty->read());
  if (ports_.clock && ports_.clock->accept()) begin_with_daemon();
}

void RigServer::begin_with_daemon() {
  for (PortState& state : ports_state_) state.in = 0;
  deadline_ns_ = kNeverNs;
  anchor();
  tick();
}

void RigServer::tick() {
  awaiting_ = true;
  ports_.clock->send_tick(rig_.now_ns(), port(Link::kCnc).out, port(Link::kExtruder).out);
}

// One wait for the daemon, or one stretch of time up to the next tick.
void RigServer::run_with_daemon(int stop_fd) {
  int timeout_us = 100'000;
  if (!awaiting_) {
    // A deadline in the past is the daemon's mistake; time goes on all the same.
    const int64_t target =
        std::max(std::min(deadline_ns_, rig_.now_ns() + kTickMaxNs), rig_.now_ns() + 1'000);
    const auto early =
        options_.speed ? duration_cast<microseconds>(due(target) - Wall::now()).count() : 0;
    if (early <= 0) {
      if (options_.speed && -early > duration_cast<microseconds>(kBehindMax).count()) anchor();
      rig_.advance(target);
      deliver();
      handle_ports();
      tick();
    } else {
      timeout_us = static_cast<int>(std::min<int64_t>(early, timeout_us));
    }
  }
  if (!wait(stop_fd, timeout_us, false)) return;
  take_answers();
  if (!ports_.clock->connected()) {
    options_.say("The daemon left the clock link: " + ports_.clock->why() +
                 ". Virtual time follows the wall clock.");
    awaiting_ = false;
    anchor();
  }
}

void RigServer::take_answers() {
  for (const ClockAnswer& answer : ports_.clock->take()) {
    take_modem_lines();
    take_counted(answer);
    const uint64_t sent = ports_.clock->tick();
    if (awaiting_ && answer.tick == sent) {
      awaiting_ = false;
      deadline_ns_ = answer.deadline_ns;
    } else if (!awaiting_ && answer.tick == sent) {
      deadline_ns_ = answer.deadline_ns;  // unasked, between ticks
    } else if (answer.tick + 1 != sent) {
      options_.say("The daemon answered tick " + std::to_string(answer.tick) + " instead of " +
                   std::to_string(sent) + ".");
      ports_.clock->drop();
      return;
    }
  }
}

void RigServer::take_counted(const ClockAnswer& answer) {
  const std::array<uint64_t, 2> counted{answer.cnc_out, answer.extruder_out};
  const auto give_up = Wall::now() + kCountedBytesWait;
  for (const Link link : kLinks) {
    PortState& state = port(link);
    const uint64_t count = counted[static_cast<size_t>(link)];
    while (true) {
      take_in(link, state.pty->read());
      if (!state.pty->plugged()) state.in = std::max(state.in, count);  // lost with the cable
      if (state.in >= count) break;
      if (Wall::now() > give_up) {
        rig_.note_fault(
            "host", std::to_string(count - state.in) + " bytes written to a port never arrived");
        state.in = count;
        break;
      }
      pollfd ready{state.pty->fd(), POLLIN, 0};
      ::poll(&ready, 1, 10);
    }
  }
}

void RigServer::take_in(Link link, std::string bytes) {
  if (bytes.empty()) return;
  port(link).in += bytes.size();
  rig_.host_wrote(link, bytes);
}

void RigServer::take_modem_lines() {
  using Kind = ModemEvent::Kind;
  for (const ModemEvent& event : ports_.modem.take()) {
    for (const Link link : kLinks) {
      PortState& state = port(link);
      if (state.pty->device() != event.device) continue;
      bool dtr = state.dtr;
      if (event.kind == Kind::kOpened) {
        state.ever_opened = true;
        ++state.opened;
        dtr = true;
      } else if (event.kind == Kind::kClosed) {
        if (state.opened > 0) --state.opened;
        if (state.opened == 0 && state.pty->drops_dtr_on_close()) dtr = false;
      } else {
        dtr = event.kind == Kind::kDtrHigh;
      }
      if (dtr != state.dtr) rig_.dtr(link, dtr);
      state.dtr = dtr;
    }
  }
}

// What comes while no program has the port open goes nowhere, as on a real one. A program that was
// not told of by the modem lines is taken to have it open always.
void RigServer::deliver() {
  for (const Link link : kLinks) {
    PortState& state = port(link);
    const std::string bytes = rig_.take_for_host(link);
    if (bytes.empty() || !state.pty->plugged()) continue;
    if (state.ever_opened && state.opened == 0) continue;
    const size_t taken = state.pty->write(bytes);
    state.out += taken;
    const bool lost = taken < bytes.size();
    if (lost && !state.overrun_noted) rig_.note_fault("host", "does not read its port: bytes lost");
    state.overrun_noted = lost;
  }
}

void RigServer::unplug(Link link, double seconds) {
  PortState& state = port(link);
  take_in(link, state.pty->read());  // what was on its way still arrives
  state.pty->unplug();
  state.opened = 0;
  state.plug_ns = rig_.now_ns() + static_cast<int64_t>(seconds * 1e9);
  if (std::exchange(state.dtr, false)) rig_.dtr(link, false);
}

void RigServer::handle_ports() {
  for (const RigAction& action : rig_.take_port_actions()) {
    if (action.kind == RigAction::Kind::kSwapPorts) {
      for (const Link link : kLinks) unplug(link, action.amount);
      PtyPort::swap_names(ports_.cnc, ports_.extruder);
    } else {
      unplug(action.link, action.amount);
    }
  }
  for (PortState& state : ports_state_) {
    if (rig_.now_ns() < state.plug_ns) continue;
    state.plug_ns = kNeverNs;
    const auto plugged = state.pty->plug();
    if (!plugged) options_.say(plugged.error().sentence);
  }
}

// False when it is time to stop.
bool RigServer::wait(int stop_fd, int timeout_us, bool ports_too) {
  std::vector<pollfd> ready{{stop_fd, POLLIN, 0}};
  if (ports_too) {
    for (const PortState& state : ports_state_) ready.push_back({state.pty->fd(), POLLIN, 0});
    for (const int fd : ports_.modem.fds()) ready.push_back({fd, POLLIN, 0});
  }
  if (ports_.clock) {
    const bool connected = ports_.clock->connected();
    const int fd = connected ? ports_.clock->daemon_fd() : ports_.clock->listener_fd();
    ready.push_back({fd, POLLIN, 0});
  }
  const timespec timeout{timeout_us / 1'000'000, (timeout_us % 1'000'000) * 1'000L};
  ::ppoll(ready.data(), ready.size(), &timeout, nullptr);
  if (ready[0].revents != 0) stopped_ = true;
  return !stopped_;
}

}  // namespace reforge
