// Clipping V~_R on sample points: what a local plane takes, and what then cannot be reached.
//
// Symbols: S_R sample points of V~_R (voxel centres); a *slot* is a place where one local plane c^L
// may
//   cut: at a printing base b_i, above matter that blocks a tool, or anywhere; T_i what the plane
//   of slot i takes, V_T their union, V_R = S_R without V_T.
// A local plane takes of V~_R beyond it only what is connected there to its slot's anchors
//   (REUSE-NOTES.md: cutting locally from the start).
// Feasible: every base that is not plano-convex is taken as a whole; every watched point is
// reachable;
//   every cap made can be milled and printed on.
// Watched points are those surface samples that V~_R blocks: V_R only loses matter, so all others
//   stay reachable. For each of them and each direction the samples that block it are known (G_cd):
//   reachable is "for some direction, blockers and V_R have nothing in common".
// Units: mm, part frame. Limits: sampled at `pitch`; what is decided here is proved later on the
// exact
//   volumes (exact_plan.h).
#pragma once

#include <memory>
#include <optional>
#include <unordered_set>
#include <vector>

#include "planner/geometry/plane.h"
#include "planner/geometry/voxel_set.h"
#include "planner/reuse/accessibility.h"
#include "planner/reuse/blockers.h"
#include "planner/reuse/printing_base.h"
#include "planner/reuse/run_graph.h"

namespace reforge {

struct Slot {
  std::vector<std::uint32_t> anchors;  // samples of V~_R
  std::vector<Vec3> points;            // must all lie beyond the plane
  std::vector<std::uint32_t> origins;  // facets of the base, if it is one
  std::vector<Vec3> normals;           // worth trying; unit, z >= 0
  bool required = false;               // a base that is not plano-convex
};

// A point on a cut face: milled, then printed on along the plane's normal.
struct CapPoint {
  Vec3 position;
  std::uint32_t beneath;  // the sample just below it; without it the cap is not there
  Blockers nozzle_blockers;
  // By direction; one of them must be clear. Empty: a nozzle that reaches leaves room for the
  // cutter.
  std::vector<Blockers> cutter_blockers;
};

struct Cut {
  std::size_t slot = 0;
  Plane plane;
  BitSet taken;  // T_i
  std::size_t count = 0;
  // Made when feasibility is first asked for:
  bool caps_made = false;
  Blockers above_caps;  // what is in the nozzle's way at every cap point
  std::vector<CapPoint> caps;
};

// The cuts of all slots (null: the slot is not used) and what follows.
struct Clipping {
  std::vector<std::shared_ptr<Cut>> cuts;
  BitSet taken;          // V_T, loose pieces included
  std::size_t kept = 0;  // samples in V_R
  int blocked = 0;       // watched and cap points out of reach
  int uncovered = 0;     // required bases not taken
  bool feasible() const { return blocked == 0 && uncovered == 0; }
};

// Which direction last served each watched point: where to look first.
using LastServed = std::vector<std::uint16_t>;

// A surface sample out of reach while all of V~_R stands.
struct WatchedPoint {
  SurfaceSample sample;
  std::int32_t matter = -1;        // the sample of V~_R it lies on, -1: none
  bool always_goes = false;        // it lies on a base that is taken as a whole
  bool cutter = false;             // by the cutter, else by the nozzle
  std::vector<Blockers> blockers;  // by direction, the least blocked first
};

struct ClippingOptions {
  double clearance_mm = 0.3;         // bodies are widened by this while searching
  double lowered_mm = 0.3;           // and their wider parts begin this much lower
  double watched_extra_mm = 0;       // the same for watched points, besides; may be negative
  double foot_kept = 0.5;            // share of the foot's samples that must stay
  std::size_t directions_kept = 24;  // per watched point
};

class ClippingModel {
 public:
  // `fixture` (may be empty) is an obstacle that never goes. `directions`: where tools may come
  // from.
  ClippingModel(const TriangleMesh& reused, double pitch_mm, const ToolBodies& tools,
                const TriangleMesh& fixture, std::vector<Vec3> directions,
                const ClippingOptions& options);

  const VoxelSet& samples() const { return samples_; }
  const std::vector<Slot>& slots() const { return slots_; }
  const std::vector<WatchedPoint>& watched() const { return watched_; }

  void add_base(const BaseComponent& base, const std::vector<Vec3>& normals);
  // Bases with one of these facets must be taken as a whole.
  void require(const std::vector<std::uint32_t>& origins);
  // Slots for whatever blocks a watched point along its least blocked direction.
  void add_blocker_slots(std::size_t most);
  // A slot from which everything above a height can be taken.
  void add_top_slot();
  // Watches those samples that `reach` finds blocked.
  void watch(const std::vector<SurfaceSample>& samples, const ReachTable& reach);
  // Watches samples whatever stands in their way, with bodies widened by another `extra_mm`.
  void watch_closely(const std::vector<SurfaceSample>& samples, double extra_mm);
  // Caps of this slot's cuts, made from now on, keep another `extra_mm` clear.
  void widen_caps(std::size_t slot, double extra_mm) { cap_extra_[slot] += extra_mm; }

  // The offset above which the slot's plane would leave some of its points behind.
  double highest_offset(const Slot& slot, const Vec3& normal) const;
  // Null if the plane takes nothing, or too much of the foot.
  std::shared_ptr<Cut> cut(std::size_t slot, const Plane& plane) const;
  // Whether a cut takes all of a slot's points.
  bool covers(const Cut& cut, const Slot& slot) const;

  // V_T, kept and uncovered; blocked is left at 0. If fewer than `needed` samples could be kept
  // even without counting loose pieces, it stops there with that number.
  Clipping combine(std::vector<std::shared_ptr<Cut>> cuts, double needed = 0) const;
  void count_blocked(Clipping& clipping, LastServed* last = nullptr) const;
  // What is out of reach: places, and the slot of a cap (slots().size(): no cap).
  struct OutOfReach {
    Vec3 position;
    std::size_t slot;
  };
  std::vector<OutOfReach> out_of_reach(const Clipping& clipping) const;
  // The same cut again, its caps not yet made.
  std::shared_ptr<Cut> afresh(const Cut& cut) const;

 private:
  struct Tools {
    ToolProfile cutter, nozzle;
  };
  Tools widened(double extra_mm) const;
  void watch_point(const SurfaceSample& sample, bool always_goes, bool cutter, double extra_mm);
  bool is_wanted(const WatchedPoint& point, const BitSet& taken) const;
  bool is_served(const WatchedPoint& point, const BitSet& taken, std::uint16_t* last) const;
  std::unordered_set<std::uint32_t> required_origins() const;
  void make_caps(Cut& cut) const;
  // Whether base or fixture keep a tool from standing there, along any direction or a common one.
  bool fixture_blocks(std::span<const ToolSection> sections, const Vec3& tip,
                      const Vec3& direction) const;
  bool fixture_blocks(bool cutter, const Vec3& tip, std::size_t direction) const;
  std::int32_t sample_near(const Vec3& point) const;
  std::vector<std::size_t> leaning_towards(const Vec3& normal) const;

  VoxelSet samples_;
  std::vector<Eigen::Vector3f> points_;  // of the samples, in single precision
  RunGraph runs_;
  std::vector<RunGraph::Seed> foot_seeds_;
  std::vector<std::vector<RunGraph::Seed>> anchor_seeds_;  // by slot
  BitSet all_, foot_;
  std::vector<std::uint32_t> foot_list_;
  ToolBodies tools_, wide_tools_;               // as they are, widened
  std::vector<Vec3> fixture_points_;            // on its surface
  std::vector<DirectionalReach> past_fixture_;  // by direction; empty without fixture
  std::vector<Vec3> directions_;
  std::vector<DirectedSamples> directed_;  // by direction
  ClippingOptions options_;
  std::vector<Slot> slots_;
  std::vector<double> cap_extra_;  // by slot
  std::vector<WatchedPoint> watched_;
};

}  // namespace reforge
