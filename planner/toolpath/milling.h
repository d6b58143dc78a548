// What every milling pass of a block needs to know, and the lowest place the cutter may go.
//
// Units: mm, s. Frame: the block's (height_map.h). Source: rig file; obstacles by mode (DESIGN.md,
// "Two constraint sets"): paper, V_R and the base plane for the tip; strict, V_R, table and
// fixture.
#pragma once

#include "planner/toolpath/block_stock.h"
#include "planner/toolpath/offset_surface.h"
#include "planner/toolpath/toolpath.h"

namespace reforge {

struct MillingOptions {
  Cutter cutter;
  double stepdown_mm = 1;
  double stepover_mm = 1.2;
  double allowance_mm = 0.2;    // roughing leaves this on V_R
  double scallop_mm = 0.02;     // finishing leaves ridges of at most this height
  bool tip_above_base = false;  // paper mode: the tip stays at z >= 0 of the part frame
};

MillingOptions milling_options(const RigDescription& rig, Mode mode);

// Lowest tip over (u, v) at which the cutter itself (not its holder) clears V_R grown by an
// allowance, the fixture grown by a margin, and the base plane where it counts. +infinity: nowhere.
class TipFloor {
 public:
  TipFloor(const Surroundings& solids, const Frame& frame, const MillingOptions& options,
           double allowance_mm);
  double operator()(double u, double v) const;
  bool allows(double u, double v, double tip) const;  // operator() <= tip, cheaper
  const OffsetSurface& part() const { return part_; }

 private:
  double base(double v) const;

  double ball_;
  OffsetSurface part_, fixture_;
  bool tip_above_base_;
  double base_per_v_, base_per_d_;  // height over the base = v * base_per_v + d * base_per_d
};

// Moves of one milling path, and the ways in and between them.
class PathWriter {
 public:
  PathWriter(BlockStock& stock, const Clearance& clearance, std::vector<Path>& out)
      : stock_(stock), clearance_(clearance), out_(out) {}

  // Lifts, crosses and comes down to the first point of `line`: straight where that is `clear_mm`
  // above the stock, else by a ramp back and forth along an open line or around a closed one. False
  // when the line is too short to ramp along; nothing is written then.
  bool enter(const std::vector<Vec3>& line, bool closed, double clear_mm);
  void cut_to(const Vec3& tip);
  bool at_work() const { return !out_.empty() && working_; }
  Vec3 position() const { return out_.back().moves.back().to; }

 private:
  void move(const Vec3& to, Motion motion);
  void come_down_to(const Vec3& start);

  BlockStock& stock_;
  const Clearance& clearance_;
  std::vector<Path>& out_;
  bool working_ = false;
};

}  // namespace reforge
