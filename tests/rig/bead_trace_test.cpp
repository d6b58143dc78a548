// A program of two beads, and traces of it written by hand.
#include "tools/reforge/bead_trace.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>

#include "tests/rig/scratch_folder.h"
#include "tests/rig/shipped_rig.h"

namespace reforge {
namespace {

class BeadTrace : public ::testing::Test {
 protected:
  void SetUp() override {
    rig_ = shipped_rig();
    std::ofstream(scratch_.path / "program.nc")
        << "G21\nG90\nG0 Z50\nG0 X0 Y0\nM70\nG0 Z1\n"
           "M72 P0.5\nG4 P0.1\nG1 X10 F600\nM73\nM74\nM75\n"
           "G0 Y5\nM72 P0.5\nG4 P0.1\nG1 X0\nM73\nM74\nM75\nG0 Z50\nM71\nM30\n";
  }
  // Records of one bead along X at height y, from x0 to x1 in 1 s after 0.1 s of priming; filament
  // begins `late` seconds late and 420 steps make a millimetre.
  void bead(double t, double y, double x0, double x1, double late, double steps) {
    const double way = x1 - x0;
    const auto at = [&](double s) { return x0 + way * std::clamp(s - 0.1, 0.0, 1.0); };
    const auto put = [&](double s, const std::string& event, double n, const std::string& more) {
      trace_ += "{\"t\":" + std::to_string(t + s) + ",\"ev\":\"" + event +
                "\",\"steps\":" + std::to_string(static_cast<int>(n)) + more +
                ",\"x\":" + std::to_string(at(s)) + ",\"y\":" + std::to_string(y) +
                ",\"z\":1.0,\"b\":0.0,\"c\":0.0}\n";
    };
    put(0, "extrude_on", steps, ",\"filament_mm_per_s\":0.5");
    put(late, "steps", steps, ",\"moving\":1");
    for (double s = 0.2; s < 1.1; s += 0.2) put(s, "flow", steps + 210 * (s - late), "");
    put(1.1, "steps", steps + 210 * (1.1 - late), ",\"moving\":0");
    put(1.1, "extrude_off", steps + 210 * (1.1 - late), ",\"by\":\"M73\"");
  }
  Result<TraceComparison> compare() {
    std::ofstream(scratch_.path / "trace.jsonl") << trace_;
    return compare_trace(scratch_.path / "program.nc", rig_, scratch_.path / "trace.jsonl");
  }

  ScratchFolder scratch_;
  RigDescription rig_;
  std::string trace_;
};

TEST_F(BeadTrace, FilamentThatComesOutInItsPlaceIsGood) {
  bead(10, 0, 0, 10, 0, 0);
  bead(20, 5, 10, 0, 0, 231);
  const Result<TraceComparison> c = compare();
  ASSERT_TRUE(c) << c.error().sentence;
  ASSERT_EQ(c->beads.size(), 2u);
  EXPECT_TRUE(c->good(0.3));
  EXPECT_EQ(c->beads[1].line, 14u);
  EXPECT_NEAR(c->beads[1].length_mm, 10, 1e-9);
  EXPECT_NEAR(c->worst_start()->start_error_mm, 0, 1e-6);
  EXPECT_NEAR(c->worst_end()->end_error_mm, 0, 1e-6);
  EXPECT_NEAR(c->beads[0].planned_mm, 0.55, 1e-9);
  EXPECT_NEAR(c->beads[0].counted_mm, 0.55, 1e-9);
  EXPECT_TRUE(c->flow_recorded);
  EXPECT_LT(c->beads[0].lag_mm, 0.06);  // a step is 0.05 mm of bead
}

TEST_F(BeadTrace, LateFilamentIsMeasuredWhereItBegan) {
  bead(10, 0, 0, 10, 0, 0);
  bead(20, 5, 10, 0, 0.15, 231);  // 0.05 s after the nozzle has left, at 10 mm/s
  const Result<TraceComparison> c = compare();
  ASSERT_TRUE(c);
  EXPECT_FALSE(c->good(0.3));
  EXPECT_EQ(c->worst_start()->line, 14u);
  EXPECT_NEAR(c->worst_start()->start_error_mm, 0.5, 1e-6);
  EXPECT_NEAR(c->beads[1].lag_mm, 1.5, 0.06);
}

TEST_F(BeadTrace, AMissingBeadIsNotGood) {
  bead(10, 0, 0, 10, 0, 0);
  const Result<TraceComparison> c = compare();
  ASSERT_TRUE(c);
  EXPECT_EQ(c->program_beads, 2u);
  EXPECT_EQ(c->trace_beads, 1u);
  EXPECT_FALSE(c->good(0.3));
}

TEST_F(BeadTrace, AnythingElseIsNoTrace) {
  trace_ = "{\"t\":1}\n";
  const Result<TraceComparison> c = compare();
  ASSERT_FALSE(c);
  EXPECT_NE(c.error().sentence.find("trace.jsonl:1"), std::string::npos);
}

}  // namespace
}  // namespace reforge
