// The machine's clock: every deadline that concerns the machine is measured and awaited here.
//
// Instants (core/instant.h); never goes back. Two kinds: the monotonic clock of the
// computer, and the virtual clock that follows a virtual rig's (io/virtual_clock.h). What concerns
// people and the system (the pace of notifications, the service's watchdog) stays on wall time.
// Lives in one thread, that of the io_context.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>

#include "controller/core/instant.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

// Each waits for at most one moment at a time.
enum class Timer { kCore, kReopenCnc, kReopenExtruder, kSimulatedRig };
constexpr int kTimerCount = 4;

class Clock {
 public:
  virtual ~Clock() = default;
  virtual Instant now() const = 0;

  // Replaces what the timer waited for. A moment already past comes due at once, but never inside
  // this call. kNever disarms.
  void wake_at(Timer timer, Instant deadline, std::function<void()> call);
  void disarm(Timer timer) { wake_at(timer, kNever, {}); }

 protected:
  Instant next_deadline() const;
  void run_due();

 private:
  virtual void deadline_changed() = 0;

  struct Slot {
    Instant deadline = kNever;
    std::function<void()> call;
  };
  std::array<Slot, kTimerCount> slots_;
};

std::unique_ptr<Clock> monotonic_clock(boost::asio::io_context& io);

}  // namespace reforge
