// The planner queue of the simulated CNC and the motion it makes: straight moves of five axes,
// trapezoids of speed, look-ahead over the whole queue.
//
// Speeds at corners follow junction deviation, as GRBL documents it; a queue that runs dry always
// ends at rest. Times are virtual nanoseconds; positions, speeds and accelerations as in
// cnc_axes.h. A pure function of its calls. Invariant: speed is continuous except at abort(), and
// never exceeds what any axis may do.
// An override changes how fast queued moves strive to be from now on; what is then too fast slows
// down at the blocks' acceleration, past a corner if that is how long it takes, as GRBL's does.
// Limits: no jerk limit, no arcs.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "tools/rig/cnc_axes.h"
#include "tools/rig/virtual_time.h"

namespace reforge {

struct FinishedMove {
  int64_t ns;
  Axes end;
  double speed;  // as asked for, a second; rapids: the axes' limit
  int64_t line;  // the caller's
};

class MotionQueue {
 public:
  struct Limits {
    Axes rate;
    Axes acceleration;
    double junction_deviation_mm;
  };
  static constexpr int kCapacity = 15;  // GRBL's 16 blocks, one of which always stays free

  MotionQueue(const Limits& limits, const Axes& start);

  bool full() const { return static_cast<int>(blocks_.size()) >= kCapacity; }
  bool empty() const { return blocks_.empty(); }
  int free_blocks() const { return kCapacity - static_cast<int>(blocks_.size()); }

  // Appends a move from the end of the last one. speed <= 0 asks for a rapid. A move of no length
  // is dropped, as GRBL does. Precondition: !full(). Begins at once unless held.
  void append(const Axes& end, double speed, int64_t line);

  void advance_to(int64_t ns);
  // When a block ends or a hold comes to rest; kNeverNs when nothing moves.
  int64_t next_event_ns() const;

  // Slows down along the path, at the blocks' acceleration, and keeps the rest of the queue.
  void hold();
  bool at_rest() const;  // nothing moves now
  void resume();
  // Motors stop dead and the queue is gone. Returns how far mass carries the axes beyond where the
  // controller believes them: the stopping distance.
  Axes abort();

  void set_limits(const Limits& limits);  // for moves appended from now on
  // Factors of what moves were asked for; rapids have one of their own.
  void set_overrides(double feed, double rapid);
  // The axes are here now (homing). Precondition: empty().
  void set_position(const Axes& here);

  Axes position() const;  // now
  const Axes& planned_end() const { return planned_end_; }
  double speed() const;        // along the path, now
  int64_t front_line() const;  // of the block under way, 0 = none
  std::vector<FinishedMove> take_finished();

 private:
  struct Block {
    Axes start, end, direction;
    double length;
    double acceleration;
    double asked;      // as appended, <= 0: rapid
    double fastest;    // what the axes allow
    double nominal;    // speed it strives for
    double corner;     // what the junction before it allows, whatever is striven for
    double max_entry;  // at that junction
    double entry;      // planned
    int64_t line;
  };
  // Constant acceleration for a while.
  struct Phase {
    double seconds, speed, acceleration;
  };

  void replan();
  void plan_front(double exit);
  void plan_front_hold();
  void settle_front();
  int64_t front_end_ns() const;
  double seconds_in() const;
  static double distance_in(const std::vector<Phase>& phases, double seconds, double& speed);
  double nominal_speed(const Block& block) const;
  double corner_speed(const Block& before, const Block& after) const;

  Limits limits_;
  std::deque<Block> blocks_;
  std::vector<Phase> phases_;  // of the front block, from phases_since_ns_ on
  int64_t phases_since_ns_ = 0;
  double done_ = 0;  // of the front block before phases_since_ns_
  double feed_override_ = 1, rapid_override_ = 1;
  bool held_ = false;
  int64_t now_ = 0;
  Axes planned_end_;
  std::vector<FinishedMove> finished_;
};

}  // namespace reforge
