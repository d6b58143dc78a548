// The virtual rig's rim: carries bytes between the pseudo-terminals and the virtual rig, and
// decides how virtual time runs.
//
// Without a daemon on the clock link, virtual time follows the wall clock times `speed` (1 for
// "max"); when the computer cannot keep up, virtual time falls behind instead of rushing later.
// With one, time goes tick by tick and waits for the daemon's answer each time (FORMATS.md, "Clock
// link"); a finite `speed` then only bounds it. Pulls and exchanges ports when the rig's script
// says so. One thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "tools/rig/clock_link.h"
#include "tools/rig/modem_lines.h"
#include "tools/rig/pty_port.h"
#include "tools/rig/virtual_rig.h"

namespace reforge {

class RigServer {
 public:
  struct Ports {
    PtyPort cnc;
    PtyPort extruder;
    ModemLines modem;
    std::optional<ClockLink> clock;
  };
  struct Options {
    std::optional<double> speed;                  // nothing = as fast as it goes
    std::function<void(const std::string&)> say;  // for a person
  };

  RigServer(VirtualRig& rig, Ports& ports, Options options);

  // Until `stop_fd` becomes readable.
  void run(int stop_fd);

 private:
  using Wall = std::chrono::steady_clock;
  struct PortState {
    PtyPort* pty;
    int opened = 0;            // programs that have it open
    bool ever_opened = false;  // told by the modem lines
    bool dtr = false;
    bool overrun_noted = false;
    uint64_t out = 0;            // bytes handed to the host since the start
    uint64_t in = 0;             // bytes from the host since a daemon connected
    int64_t plug_ns = kNeverNs;  // plugged in again then
  };

  void run_free(int stop_fd);
  void run_with_daemon(int stop_fd);
  void begin_with_daemon();
  void take_answers();
  void take_counted(const ClockAnswer& answer);
  void take_in(Link link, std::string bytes);
  void take_modem_lines();
  void deliver();
  void handle_ports();
  void unplug(Link link, double seconds);
  void tick();
  bool wait(int stop_fd, int timeout_us, bool ports_too);
  void anchor();
  PortState& port(Link link) { return ports_state_[static_cast<size_t>(link)]; }
  Wall::time_point due(int64_t ns) const;

  VirtualRig& rig_;
  Ports& ports_;
  Options options_;
  std::array<PortState, 2> ports_state_;
  bool stopped_ = false;
  bool awaiting_ = false;  // a tick stands
  int64_t deadline_ns_ = 0;
  int64_t anchor_ns_ = 0;
  Wall::time_point anchor_wall_;
};

}  // namespace reforge
