// The extruder's side of a program: M70-M75 in an order it obeys, extrusion only where a bead is
// wanted, the bead's width from the commanded flow, and how much filament that was.
//
// The bead's section is width x height with the rig's layer height; its width is filament speed x
// filament area / multiplier / feed / height (the multiplier corrects what really comes out, so the
// commanded flow carries it and the bead does not). Units: mm, mm^3, seconds.
#pragma once

#include "planner/verify/findings.h"
#include "planner/verify/scene.h"
#include "protocols/gcode/modal.h"
#include "protocols/rig.h"

namespace reforge::verify {

class ExtruderRules {
 public:
  ExtruderRules(const Extrusion& extrusion, Findings& findings)
      : rig_(extrusion), findings_(findings) {}

  // An M70-M75; `before` is the modal state ahead of the line.
  void module_code(const gcode::Action& action, const gcode::ModalState& before, const Place& place,
                   const Vec3& at);
  // A straight move of the linear axes with the module open. Returns the bead's width (its section
  // over the layer height), 0 for none.
  double move(const gcode::ModalState& state, bool rapid, double feed_mm_per_s, const Vec3& delta,
              const Place& place, const Vec3& at);
  void rotary(const gcode::ModalState& state, const Place& place, const Vec3& at);
  void dwell(const gcode::ModalState& state, double seconds);

  double filament_mm() const { return filament_mm_; }  // fed while extruding, priming included
  double flow_mm3() const { return flow_mm3_; }        // what came out
  double retract_seconds(const gcode::ModalState& state) const;

 private:
  double filament_speed(const gcode::ModalState& state) const;
  double section_mm2() const;

  const Extrusion& rig_;
  Findings& findings_;
  bool at_mouth_ = false;  // filament not retracted since it was last extruded
  double dry_mm_ = 0;      // fed along without extrusion since M73
  double travel_mm_ = 0;   // unretracted, since M73
  double filament_mm_ = 0;
  double flow_mm3_ = 0;
};

}  // namespace reforge::verify
