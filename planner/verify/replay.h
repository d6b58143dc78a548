// The program run line by line: reader -> modal state -> rules and kinematics -> scene.
//
// Start: the machine's linear axes stand somewhere unknown, at the top of their travel or lower
// only where nothing is; the rotary axes at 0; the module closed; the spindle off. Until the
// program has said where X, Y and Z are, moves must stay above everything. After a line that is not
// understood nothing more is simulated: the rest has no defined meaning.
#pragma once

#include <functional>
#include <istream>

#include "planner/verify/extruder_rules.h"
#include "planner/verify/link_model.h"
#include "planner/verify/planned_work.h"
#include "planner/verify/program_header.h"
#include "planner/verify/scene.h"
#include "planner/verify/time_model.h"

namespace reforge::verify {

struct ReplayOptions {
  std::function<void(std::size_t line)> progress;  // now and then
  std::function<bool()> should_stop;
};

struct ReplayOutcome {
  std::size_t lines = 0;
  std::size_t moves = 0;
  int blocks = 0;
  double seconds = 0;
  double filament_mm = 0;
  double flow_mm3 = 0;
  bool stopped = false;  // by should_stop
};

class Replay {
 public:
  Replay(const RigDescription& rig, Mode mode, const std::string& stock_sha256,
         const TriangleMesh* fixture, Scene& scene, Findings& findings);

  Result<ReplayOutcome> run(std::istream& program, const ReplayOptions& options);

 private:
  void interpret(const gcode::Action& action, const gcode::ModalState& before);
  void move(const gcode::Action& action, const gcode::ModalState& before);
  void rotary(const gcode::ModalState& before, bool alone);
  void linear(const gcode::ModalState& before);
  void judge_limits(const gcode::ModalState& state);
  void judge_feed(const Vec3& delta);
  void judge_direction();
  void module_code(const gcode::Action& action, const gcode::ModalState& before);
  void spindle();
  void end(bool complete);
  void settle_link(bool at_rest);
  void pass_time(double seconds) { spin_up_left_s_ -= seconds; }
  void low(Fault fault, double swept_top, const char* what);
  double tools_lowest(const Vec3& programmed, bool module_open) const;
  double highest_at(const Pose& pose) const;
  std::optional<Vec3> programmed(const gcode::ModalState& state) const;
  Vec3 part_position() const;
  Pose pose_of(const gcode::ModalState& state) const;

  const RigDescription& rig_;
  Mode mode_;
  std::string stock_sha256_;
  const TriangleMesh* fixture_;
  Scene& scene_;
  Findings& findings_;
  ToolBodies tools_;
  ExtruderRules extruder_;
  TimeModel time_;
  LinkModel link_;
  struct Sent {
    std::size_t bytes;
    Place place;
    Vec3 at;
  };
  std::vector<Sent> sent_;         // moves whose durations are not known yet
  std::size_t unmoved_bytes_ = 0;  // of the lines since the last move
  double waited_s_ = 0;            // for lines, since the last barrier
  PlannedWork planned_;
  double spin_up_left_s_ = 0;  // until the spindle is at speed
  ProgramHeader header_;
  gcode::ModalState state_;
  Pose pose_;
  Place place_;
  std::optional<Vec3> announced_;  // the block's direction by its comment
  ReplayOutcome outcome_;
};

// How far a bead may run with nothing beneath it: across the infill of the layer below, crossing it
// at up to 60 degrees from square.
double bridge_length(const Extrusion& extrusion);

// The tools that count in a mode.
ToolBodies tools_of(const RigDescription& rig, Mode mode);

}  // namespace reforge::verify
