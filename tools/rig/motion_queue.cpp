#include "tools/rig/motion_queue.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

namespace reforge {
namespace {

constexpr double kTinyLength = 1e-9;

double dot(const Axes& a, const Axes& b) {
  double sum = 0;
  for (int i = 0; i < kAxisCount; ++i) sum += a[i] * b[i];
  return sum;
}

// The most that no axis objects to when moving along a unit direction.
double limited(const Axes& direction, const Axes& per_axis) {
  double most = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kAxisCount; ++i) {
    if (direction[i] != 0) most = std::min(most, per_axis[i] / std::abs(direction[i]));
  }
  return most;
}

// Speed after speeding up from `speed` over `length`.
double reachable(double speed, double acceleration, double length) {
  return std::sqrt(speed * speed + 2 * acceleration * length);
}

// Speed after braking from `speed` over `length`.
double slowed(double speed, double acceleration, double length) {
  return std::sqrt(std::max(0.0, speed * speed - 2 * acceleration * length));
}

}  // namespace

MotionQueue::MotionQueue(const Limits& limits, const Axes& start)
    : limits_(limits), planned_end_(start) {}

double MotionQueue::nominal_speed(const Block& block) const {
  if (block.asked <= 0) return block.fastest * rapid_override_;
  return std::min(block.asked * feed_override_, block.fastest);
}

double MotionQueue::corner_speed(const Block& before, const Block& after) const {
  const double cosine = -dot(before.direction, after.direction);
  if (cosine > 0.999999) return 0;                                         // straight back
  if (cosine < -0.999999) return std::numeric_limits<double>::infinity();  // straight on
  const double sin_half = std::sqrt(0.5 * (1 - cosine));
  Axes turn{};
  for (int i = 0; i < kAxisCount; ++i) turn[i] = after.direction[i] - before.direction[i];
  const double norm = std::sqrt(dot(turn, turn));
  for (double& t : turn) t /= norm;
  const double acceleration = limited(turn, limits_.acceleration);
  return std::sqrt(acceleration * limits_.junction_deviation_mm * sin_half / (1 - sin_half));
}

void MotionQueue::append(const Axes& end, double speed, int64_t line) {
  assert(!full());
  Block block{};
  block.start = planned_end_;
  block.end = end;
  for (int i = 0; i < kAxisCount; ++i) block.direction[i] = end[i] - planned_end_[i];
  block.length = std::sqrt(dot(block.direction, block.direction));
  if (block.length < kTinyLength) return;
  for (double& d : block.direction) d /= block.length;
  block.acceleration = limited(block.direction, limits_.acceleration);
  block.asked = speed;
  block.fastest = limited(block.direction, limits_.rate);
  block.nominal = nominal_speed(block);
  block.corner = blocks_.empty() ? 0 : corner_speed(blocks_.back(), block);
  block.max_entry =
      blocks_.empty() ? 0 : std::min({block.corner, blocks_.back().nominal, block.nominal});
  block.line = line;
  if (blocks_.empty()) {
    done_ = 0;
    phases_.clear();
    phases_since_ns_ = now_;
  }
  blocks_.push_back(block);
  planned_end_ = end;
  if (!held_) replan();
}

// Backwards: enter each block no faster than it can be left; forwards: no faster than the one
// before allows. The front's entry is the speed it has now.
void MotionQueue::replan() {
  settle_front();
  Block& front = blocks_.front();
  double exit = 0;
  for (size_t i = blocks_.size(); i-- > 1;) {
    Block& block = blocks_[i];
    block.entry = std::min(block.max_entry, reachable(exit, block.acceleration, block.length));
    exit = block.entry;
  }
  double speed = reachable(front.entry, front.acceleration, front.length - done_);
  double least = slowed(front.entry, front.acceleration, front.length - done_);
  for (size_t i = 1; i < blocks_.size(); ++i) {
    Block& block = blocks_[i];
    // An override may have left too little way to slow down in; then it takes what it takes.
    block.entry = std::max(std::min(block.entry, speed), least);
    speed = reachable(block.entry, block.acceleration, block.length);
    least = slowed(block.entry, block.acceleration, block.length);
  }
  plan_front(blocks_.size() > 1 ? blocks_[1].entry : 0);
}

void MotionQueue::plan_front(double exit) {
  const Block& front = blocks_.front();
  const double a = front.acceleration;
  const double entry = front.entry;
  const double length = front.length - done_;
  // The fastest it could become and still leave at `exit`; braking distance always suffices up to
  // rounding, because the plan before this one could stop in the same length.
  const double summit = std::sqrt(std::max(0.0, a * length + (entry * entry + exit * exit) / 2));
  phases_.clear();
  if (entry > front.nominal && exit <= front.nominal) {
    // An override has lowered what it strives for: brake first.
    const double brake = (entry * entry - front.nominal * front.nominal) / (2 * a);
    const double last = (front.nominal * front.nominal - exit * exit) / (2 * a);
    phases_.push_back({(entry - front.nominal) / a, entry, -a});
    const double even = length - brake - last;
    if (even > kTinyLength) phases_.push_back({even / front.nominal, front.nominal, 0});
    if (front.nominal > exit) phases_.push_back({(front.nominal - exit) / a, front.nominal, -a});
    return;
  }
  const double top = std::max({entry, exit, std::min(summit, front.nominal)});
  const double up = (top * top - entry * entry) / (2 * a);
  const double down = (top * top - exit * exit) / (2 * a);
  if (top > entry) phases_.push_back({(top - entry) / a, entry, a});
  const double along = length - up - down;
  if (along > kTinyLength) phases_.push_back({along / top, top, 0});
  if (top > exit) phases_.push_back({(top - exit) / a, top, -a});
  if (phases_.empty()) phases_.push_back({0, entry, 0});  // nothing left: ends at once
}

// Slowing down from the front's present speed, at most to its end.
void MotionQueue::plan_front_hold() {
  const Block& front = blocks_.front();
  const double a = front.acceleration;
  const double length = front.length - done_;
  const double left = front.entry * front.entry - 2 * a * length;
  const double end_speed = left > 0 ? std::sqrt(left) : 0;
  phases_.clear();
  if (front.entry > end_speed) phases_.push_back({(front.entry - end_speed) / a, front.entry, -a});
}

double MotionQueue::seconds_in() const {
  return static_cast<double>(now_ - phases_since_ns_) / 1e9;
}

double MotionQueue::distance_in(const std::vector<Phase>& phases, double seconds, double& speed) {
  double distance = 0;
  speed = 0;
  for (const Phase& phase : phases) {
    const double t = std::min(seconds, phase.seconds);
    distance += phase.speed * t + 0.5 * phase.acceleration * t * t;
    speed = std::max(0.0, phase.speed + phase.acceleration * t);
    seconds -= t;
    if (seconds <= 0) break;
  }
  return distance;
}

// Makes the front block's plan begin now: what is done is done, its entry is the present speed.
void MotionQueue::settle_front() {
  Block& front = blocks_.front();
  double now_speed = 0;
  if (!phases_.empty()) {
    done_ = std::min(front.length, done_ + distance_in(phases_, seconds_in(), now_speed));
  }
  front.entry = now_speed;
  phases_since_ns_ = now_;
  phases_.clear();
}

int64_t MotionQueue::front_end_ns() const {
  double seconds = 0;
  for (const Phase& phase : phases_) seconds += phase.seconds;
  return phases_since_ns_ + static_cast<int64_t>(std::ceil(seconds * 1e9));
}

int64_t MotionQueue::next_event_ns() const {
  return at_rest() ? kNeverNs : front_end_ns();
}

bool MotionQueue::at_rest() const {
  return blocks_.empty() || phases_.empty();
}

void MotionQueue::advance_to(int64_t ns) {
  assert(ns >= now_);
  while (!at_rest() && front_end_ns() <= ns) {
    now_ = front_end_ns();
    double end_speed = 0;
    const double done = done_ + distance_in(phases_, seconds_in(), end_speed);
    Block& front = blocks_.front();
    // A hold that ends inside the block: at rest, with the rest of the block still to do.
    if (held_ && front.length - done > 1e-6) {
      settle_front();
      continue;
    }
    finished_.push_back({now_, front.end, front.nominal, front.line});
    blocks_.pop_front();
    done_ = 0;
    phases_.clear();
    phases_since_ns_ = now_;
    if (blocks_.empty()) break;
    if (held_) {
      blocks_.front().entry = end_speed < 1e-6 ? 0 : end_speed;
      plan_front_hold();
    } else {
      plan_front(blocks_.size() > 1 ? blocks_[1].entry : 0);
    }
  }
  now_ = ns;
}

void MotionQueue::hold() {
  if (held_) return;
  held_ = true;
  if (blocks_.empty()) return;
  settle_front();
  plan_front_hold();
}

void MotionQueue::resume() {
  if (!held_) return;
  held_ = false;
  if (!blocks_.empty()) replan();
}

Axes MotionQueue::abort() {
  Axes carried{};
  const Axes here = position();
  if (!at_rest()) {
    const Block& front = blocks_.front();
    const double v = speed();
    for (int i = 0; i < kAxisCount; ++i) {
      carried[i] = front.direction[i] * v * v / (2 * front.acceleration);
    }
  }
  blocks_.clear();
  phases_.clear();
  held_ = false;
  planned_end_ = here;
  return carried;
}

void MotionQueue::set_limits(const Limits& limits) {
  limits_ = limits;
}

void MotionQueue::set_overrides(double feed, double rapid) {
  feed_override_ = feed;
  rapid_override_ = rapid;
  for (size_t i = 0; i < blocks_.size(); ++i) {
    Block& block = blocks_[i];
    block.nominal = nominal_speed(block);
    if (i > 0) {
      block.max_entry = std::min({block.corner, blocks_[i - 1].nominal, block.nominal});
    }
  }
  if (!blocks_.empty() && !held_) replan();
}

void MotionQueue::set_position(const Axes& here) {
  assert(blocks_.empty());
  planned_end_ = here;
}

Axes MotionQueue::position() const {
  if (blocks_.empty()) return planned_end_;
  const Block& front = blocks_.front();
  double unused = 0;
  const double done = std::min(front.length, done_ + distance_in(phases_, seconds_in(), unused));
  Axes here = front.start;
  for (int i = 0; i < kAxisCount; ++i) here[i] += front.direction[i] * done;
  return here;
}

double MotionQueue::speed() const {
  double now_speed = 0;
  if (!at_rest()) distance_in(phases_, seconds_in(), now_speed);
  return now_speed;
}

int64_t MotionQueue::front_line() const {
  return blocks_.empty() ? 0 : blocks_.front().line;
}

std::vector<FinishedMove> MotionQueue::take_finished() {
  return std::exchange(finished_, {});
}

}  // namespace reforge
