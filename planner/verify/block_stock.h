// The stock of this moment in the view of the block under way: cut and deposited move by move.
//
// All places are in the block's view, mm; the tool points along -w. A block is a run of moves at
// one rotary position that only cut or only deposit; `close` turns what it did into a layer of the
// Stock. Limits: a bead is a stadium of constant height under the nozzle's path (no squeeze, no
// sagging).
#pragma once

#include <optional>

#include "planner/verify/envelope.h"
#include "planner/verify/stock.h"

namespace reforge::verify {

struct Gouge {
  double depth = 0;  // along the tool, into what is to be kept; 0: none
  Vec3 where = Vec3::Zero();
};

struct Bead {
  int judged = 0;        // columns under the bead, but those it has only just laid
  int supported = 0;     // of those, with material less than a layer beneath, or a bead beside
  bool outside = false;  // beyond the grid: beyond the part and its margin
};

class BlockStock {
 public:
  BlockStock(const View& view, Material material);
  BlockStock(const BlockStock&) = delete;
  BlockStock& operator=(const BlockStock&) = delete;

  const View& view() const { return envelope_.view(); }
  Envelope& envelope() { return envelope_; }

  // Per column, what must not be cut below; -infinity where nothing is to be kept.
  void set_guard(std::vector<float> guard);

  bool cutting() const { return !cut_rect_.empty(); }
  bool depositing() const { return !deposit_rect_.empty(); }

  // Only when not depositing. Removes what a ball end sweeps from tip a to tip b. Reports the
  // deepest entry below the guard, when it is more than `tolerance`.
  Gouge cut(const Vec3& a, const Vec3& b, double radius, double tolerance);

  // Only when not cutting. Lays a bead of this width and height under the nozzle tip on its way
  // from a to b.
  // What was laid within the last two widths of path is no support to itself.
  Bead deposit(const Vec3& a, const Vec3& b, double width, double height);

  // What the block did so far, as a layer for the stock; afterwards the block goes on from there.
  void close(Stock& stock);

 private:
  struct TopRun {
    float lo, hi;
    float path_mm;  // laid up to then
  };
  float exact_top(std::size_t cell) const;
  void apply_cut();
  Columns take_deposit(const CellRect& rect);

  Envelope envelope_;
  Material material_;           // at the block's start
  std::vector<float> surface_;  // lowest the cutter has been; +infinity
  std::vector<float> guard_;
  CellRect cut_rect_, deposit_rect_;
  double path_mm_ = 0;       // deposited along so far
  std::vector<TopRun> run_;  // the topmost deposit of each column, while depositing
  struct Buried {
    std::uint32_t cell;
    Interval interval;
  };
  std::vector<Buried> buried_;  // deposits below a gap
};

}  // namespace reforge::verify
