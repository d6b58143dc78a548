#include "controller/io/clock.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>

namespace reforge {

void Clock::wake_at(Timer timer, Instant deadline, std::function<void()> call) {
  slots_[static_cast<std::size_t>(timer)] = {deadline, std::move(call)};
  deadline_changed();
}

Instant Clock::next_deadline() const {
  return std::min_element(slots_.begin(), slots_.end(),
                          [](const Slot& a, const Slot& b) { return a.deadline < b.deadline; })
      ->deadline;
}

void Clock::run_due() {
  const Instant at = now();
  for (Slot& slot : slots_) {
    if (slot.deadline > at) continue;
    const std::function<void()> call = std::move(slot.call);
    slot = {};
    call();
  }
}

namespace {

class MonotonicClock : public Clock {
 public:
  explicit MonotonicClock(boost::asio::io_context& io) : timer_(io) {}

  Instant now() const override { return std::chrono::steady_clock::now().time_since_epoch(); }

 private:
  void deadline_changed() override {
    const Instant deadline = next_deadline();
    if (deadline == armed_for_) return;
    armed_for_ = deadline;
    if (deadline == kNever) {
      timer_.cancel();
      return;
    }
    timer_.expires_at(std::chrono::steady_clock::time_point(deadline));
    timer_.async_wait([this](const boost::system::error_code& failed) {
      if (failed) return;
      armed_for_ = kNever;
      run_due();
      deadline_changed();
    });
  }

  boost::asio::steady_timer timer_;
  Instant armed_for_ = kNever;
};

}  // namespace

std::unique_ptr<Clock> monotonic_clock(boost::asio::io_context& io) {
  return std::make_unique<MonotonicClock>(io);
}

}  // namespace reforge
