// The clock of a virtual rig, followed by the daemon: FORMATS.md, "Clock link".
//
// Time stands still from each tick until we have answered it, and we answer when everything the rig
// wrote was read, what was due was run, and no work that the machine would have to wait for is
// under way (the journal making a horizon durable): so wall time spent by the host costs the
// virtual machine nothing, and dead-men and latencies keep their meaning at any speed. When the rig
// goes away the clock stands still for good and `on_lost` is called.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "controller/io/clock.h"
#include "protocols/result.h"

namespace reforge {

struct LinkCounts {  // bytes
  std::uint64_t cnc_in = 0, cnc_out = 0, extruder_in = 0, extruder_out = 0;
};

class VirtualClock : public Clock {
 public:
  struct Hooks {
    // Has the port been read that far (or is it closed)?
    std::function<bool(std::uint64_t cnc, std::uint64_t extruder)> has_read;
    std::function<bool()> busy;  // work under way that virtual time has to wait for
    std::function<LinkCounts()> counts;
    std::function<bool()> idle;  // nothing runs: time may pass slowly, to spare the computer
    std::function<void(std::string)> on_lost;
  };

  // Connects and waits for the first tick, which starts the time.
  static Result<std::unique_ptr<VirtualClock>> connect(boost::asio::io_context& io,
                                                       const std::filesystem::path& socket);
  ~VirtualClock() override;

  // From now on ticks are taken and answered. Until then the first tick stands.
  void run(Hooks hooks);
  // The rig's counts in the tick that stands: where a port opened now begins to count.
  LinkCounts at_tick() const;
  // True between a tick and its answer: the only time at which a port may be opened.
  bool tick_stands() const;
  // Something `has_read` or `busy` speaks of has changed.
  void progress();
  // Something was written, perhaps outside a tick.
  void wrote();

  Instant now() const override;

 private:
  struct Impl;
  explicit VirtualClock(std::unique_ptr<Impl> impl);
  void deadline_changed() override;
  void read_next();
  void answer();
  std::unique_ptr<Impl> impl_;
  bool answering_ = false;
};

}  // namespace reforge
