#include "controller/io/simulated_rig.h"

#include <utility>

namespace reforge {

namespace {
constexpr Duration kLook = std::chrono::milliseconds(50);  // the board's dead-men have no event
}  // namespace

SimulatedRig::SimulatedRig(const RigDescription& rig, Clock& clock, Handlers handlers)
    : clock_(clock), handlers_(std::move(handlers)), cnc_(rig) {
  trouble_.fill("Not opened yet.");
}

void SimulatedRig::begin() {
  to_open_.fill(true);
  wake(clock_.now());
}

void SimulatedRig::perform(const Send& action) {
  const Instant now = clock_.now();
  if (action.link == Link::kCnc) {
    cnc_.receive(now, action.bytes);
  } else {
    extruder_.receive(now, action.bytes);
  }
  wake(now);
}

void SimulatedRig::perform(const Reopen& action) {
  to_open_[index(action.link)] = true;
  trouble_[index(action.link)] = action.sentence;
  wake(clock_.now());
}

void SimulatedRig::wake(Instant when) {
  if (when >= wakes_at_) return;
  wakes_at_ = when;
  clock_.wake_at(Timer::kSimulatedRig, when, [this] { run(); });
}

void SimulatedRig::run() {
  const Instant now = clock_.now();
  wakes_at_ = kNever;
  cnc_.advance(now);
  extruder_.advance(now);
  for (const Link link : {Link::kCnc, Link::kExtruder}) {
    if (std::exchange(to_open_[index(link)], false)) {
      trouble_[index(link)].clear();
      handlers_.on_open(link);
    }
    if (!trouble_[index(link)].empty()) continue;
    const std::string said =
        link == Link::kCnc ? cnc_.take_transmitted() : extruder_.take_transmitted();
    if (!said.empty()) handlers_.on_bytes(link, said);
  }
  wake(earlier(now + kLook, earlier(cnc_.next_event(), extruder_.next_event())));
}

}  // namespace reforge
