// Executes blocks of a program on the motion queue for controllers that take one block at a time:
// the panel and Marlin. (GRBL has an order of its own, grbl_execution.cpp.)
//
// A block is given when ready_for_block(); it waits until the queue is dry where its words need
// that (M-codes, dwell, spindle, end), or until the queue has room. M70-M75 switch the outputs and
// end when the extruder board says ready, not before its inputs have had time to see the change. In
// Hold nothing goes on. No I/O, no clock. Units: cnc_axes.h.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "protocols/rig.h"
#include "tools/rig/cnc_controller.h"
#include "tools/rig/gcode_line.h"
#include "tools/rig/motion_queue.h"

namespace reforge {

class BlockExecutor {
 public:
  enum class BeyondTravel { kAlarm, kClamp };  // what a target outside the travel does
  BlockExecutor(const RigDescription& rig, double dwell_seconds_per_p, BeyondTravel beyond);

  void advance_to(int64_t ns);
  int64_t next_event_ns() const;

  bool ready_for_block() const { return !pending_ && !hold_ && alarm_ == 0; }
  bool drained() const { return !pending_ && motion_.empty(); }
  // `number`: of its line, for the trace. Precondition: ready_for_block(). Executes what it can.
  void take(const GcodeLine& block, int64_t number);
  // Z up, then X and Y, then the rotary axes. Precondition: drained().
  void home();

  void hold(const char* who);
  void resume();  // ignored until at rest
  bool held() const { return hold_; }
  // Coming to rest with the queue lost; until clear().
  void alarm(int number);
  int alarm_number() const { return alarm_; }
  // Everything stops dead, outputs fall, modes are as after power-on.
  void clear();

  void set_ready_input(bool ready);
  CncOutputs outputs() const { return outputs_; }  // without `running`
  bool at_rest() const { return motion_.at_rest(); }
  // True once after M2 or M30.
  bool take_end();

  const CncAxes& axes() const { return axes_; }
  Axes position() const;  // machine coordinates, physical
  Axes g54_position() const;
  void event(CncEvent::Kind kind, double value = 0, std::string text = {}, int64_t line = 0);
  std::vector<CncEvent> take_events();

 private:
  void pump();
  bool step();
  bool needs_dry_queue() const;
  bool custom_done();
  bool dwell_done();
  bool move_done();
  void apply_modes();
  void finish_block();
  Axes target() const;
  void note_motion();

  CncAxes axes_;
  double dwell_seconds_per_p_;
  BeyondTravel beyond_;
  double min_rpm_, max_rpm_;
  MotionQueue motion_;
  std::array<Axes, 6> offsets_{};
  Axes carried_{};  // physical minus believed position
  Axes parser_position_;
  int64_t now_ = 0;

  // Modes.
  int motion_mode_ = 0, system_ = 0, spindle_ = 5;
  bool inches_ = false, incremental_ = false;
  double feed_per_min_ = 0, rpm_ = 0;

  std::optional<GcodeLine> pending_;
  int64_t number_ = 0;
  enum class Stage { kSync, kCustom, kDwell, kMove, kFlow } stage_ = Stage::kSync;
  int64_t until_ns_ = -1;  // of a dwell, or the least of an M-code; -1: not begun
  int64_t left_ns_ = 0;    // of it while held
  bool pause_held_ = false;
  int home_phase_ = -1;

  bool hold_ = false, held_noted_ = false;
  int alarm_ = 0;
  bool ended_ = false;
  bool ready_input_ = true;
  CncOutputs outputs_;
  std::vector<CncEvent> events_;
};

}  // namespace reforge
