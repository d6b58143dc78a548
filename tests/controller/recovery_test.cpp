#include "controller/core/recovery_plan.h"

#include <gtest/gtest.h>

#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

// Lines by number: 3 block, 7 path 1, 10 block, 11 M70, 12 path 2, 14 M72, 16 M73, 18 path 3,
// 20 M72, 22 M73, 24 M71.
std::shared_ptr<TextProgram> program() {
  return std::make_shared<TextProgram>(std::vector<std::string>{"; reforge-program: 1",
                                                                "G21 G90",
                                                                "; block 01 mill",
                                                                "G0 Z40",
                                                                "G0 B30 C10",
                                                                "M3 S9000",
                                                                "; path 1",
                                                                "G0 X1 Y2",
                                                                "G1 Z5 F300",
                                                                "; block 02 print",
                                                                "M70 S210",
                                                                "; path 2",
                                                                "G0 X3 Z20",
                                                                "M72 P0.3",
                                                                "G1 X9 F500",
                                                                "M73",
                                                                "G0 Z40",
                                                                "; path 3",
                                                                "G0 X4",
                                                                "M72",
                                                                "G1 X8 F500",
                                                                "M73",
                                                                "G0 Z40",
                                                                "M71",
                                                                "M30"});
}

RecoveryRequest after(LineNumber executed, LineNumber acknowledged, LineNumber horizon) {
  RecoveryRequest out;
  out.certainty = {executed, acknowledged, horizon, horizon};
  return out;
}

Result<RecoveryPlan> plan(const RecoveryRequest& request) {
  auto source = program();
  return plan_recovery(*source, bench_rig(), request);
}

TEST(RecoveryPlan, MillingGoesOnFromTheLastPathBeforeWhichAllIsExecuted) {
  const auto out = plan(after(6, 9, 9));
  ASSERT_TRUE(out.ok()) << out.error().sentence;
  EXPECT_EQ(out->from, 7);
  EXPECT_EQ(out->bridge, (std::vector<std::string>{"M5", "G0 Z40"}));
  EXPECT_EQ(out->preamble,
            (std::vector<std::string>{"G21", "G90", "G94", "G17", "G54", "G0 Z40", "G0 B30 C10",
                                      "M3 S9000", "G4 P2", "G1 Z40 F300", "G0"}));
  EXPECT_EQ(out->first_line, 9);
  EXPECT_EQ(plan(after(5, 9, 9))->from, 3);
}

TEST(RecoveryPlan, PrintingIsReheatedBeforeAnyAxisMoves) {
  const auto out = plan(after(16, 17, 19));
  ASSERT_TRUE(out.ok()) << out.error().sentence;
  EXPECT_EQ(out->from, 18);
  EXPECT_TRUE(out->printing);
  EXPECT_EQ(out->bridge, (std::vector<std::string>{"M5", "G0 Z40", "M71"}));
  std::size_t heat = 0, motion = 0, purge = 0;
  for (std::size_t i = out->preamble.size(); i-- > 0;) {
    if (out->preamble[i] == "M70 S210") heat = i;
    if (out->preamble[i] == "G0 Z40") motion = i;
    if (out->preamble[i] == "M72") purge = i;
  }
  EXPECT_LT(heat, motion);
  EXPECT_LT(motion, purge);
}

TEST(RecoveryPlan, BeadThatMayBeHalfLaidNeedsTheOperatorsWord) {
  RecoveryRequest request = after(14, 15, 15);
  request.sent_known = true;
  const auto refused = plan(request);
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().sentence.find("lines 14 to 16"), std::string::npos);
  request.bead = BeadWord::kRemoved;
  EXPECT_EQ(plan(request)->from, 12);
  request.bead = BeadWord::kAccepted;
  EXPECT_EQ(plan(request)->from, 18);
}

TEST(RecoveryPlan, AfterACrashABeadWithinTheHorizonMayHaveBegun) {
  EXPECT_FALSE(plan(after(13, 13, 14)).ok());
  RecoveryRequest request = after(13, 13, 13);
  EXPECT_EQ(plan(request)->from, 12);
  request = after(13, 13, 20);
  request.certainty.sent = 13;
  request.sent_known = true;  // the daemon saw the end: M72 was never given
  EXPECT_EQ(plan(request)->from, 12);
}

TEST(RecoveryPlan, WholeBeadIsNeverLaidAgain) {
  for (LineNumber executed = 16; executed <= 18; ++executed) {
    const auto out = plan(after(executed, executed, executed));
    ASSERT_TRUE(out.ok());
    EXPECT_EQ(out->from, 18);
  }
  EXPECT_FALSE(plan(after(22, 22, 22)).ok());  // the last one is whole: nothing is left
  RecoveryRequest request = after(16, 16, 16);
  request.path = 2;
  EXPECT_FALSE(plan(request).ok());
}

TEST(RecoveryPlan, PathOfTheOperatorsChoice) {
  RecoveryRequest request = after(2, 2, 2);
  request.path = 3;
  EXPECT_EQ(plan(request)->from, 18);
  request.path = 4;
  EXPECT_FALSE(plan(request).ok());
}

TEST(RecoveryPlan, NewProgramIsTheOldOneWithBridgeAndPreambleInBetween) {
  auto source = program();
  const auto out = plan(after(16, 16, 16));
  std::vector<std::string> lines;
  ASSERT_TRUE(write_recovered(*source, *out, [&](std::string_view l) { lines.emplace_back(l); }));
  ASSERT_EQ(static_cast<LineNumber>(lines.size()), out->lines);
  EXPECT_EQ(lines[16], "G0 Z40");
  EXPECT_EQ(lines[static_cast<std::size_t>(out->first_line) - 1], "G21");
  EXPECT_EQ(lines.back(), "M30");
}

TEST(RecoveryPlan, RecoveredProgramRunsFromItsPreambleOn) {
  RigBench bench;
  bench.plug_both();
  const auto out = plan(after(6, 6, 6));
  auto source = program();
  std::vector<std::string> lines = {"; g54: X0 Y0 Z0"};
  ASSERT_TRUE(write_recovered(*source, *out, [&](std::string_view l) { lines.emplace_back(l); }));
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }));
  const LineNumber first = out->first_line + 1;
  bench.horizon = first - 1;
  ASSERT_TRUE(bench.order(
      StartOrder{{JobId{7}, "job", Mode::kStrict, std::make_shared<TextProgram>(lines), first}}));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.m_codes(), (std::vector<int>{70, 72, 73, 72, 73, 71}));
  EXPECT_EQ(bench.cnc_bytes.find("B30"), bench.cnc_bytes.rfind("B30"));
}

TEST(Checkpoints, LongMillingIsDrainedAtPathsSoThatLittleIsUncertain) {
  std::vector<std::string> body = {"M3 S12000", "G0 X0 Y0 Z20"};
  for (int path = 1; path <= 8; ++path) {
    body.push_back("; path " + std::to_string(path));
    for (int i = 0; i < 20; ++i) body.push_back("G1 X" + std::to_string(i % 3) + " F600");
  }
  CoreOptions options = RigBench::virtual_ports();
  options.checkpoint_every = 30;
  RigBench bench(options);
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(body)));
  LineNumber executed = 0;
  ASSERT_TRUE(bench.run_until([&] {
    executed = std::max(executed, bench.core.snapshot().certainty.executed);
    return bench.core.snapshot().certainty.acknowledged > 120;
  }));
  EXPECT_GT(executed, 60);
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
}

TEST(Reheat, KeepsTheNozzleHotWithoutAJobUntilItsTimeIsOver) {
  CoreOptions options = RigBench::virtual_ports();
  options.reheat_max = std::chrono::minutes(1);
  RigBench bench(options);
  bench.plug_both();
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }));
  EXPECT_FALSE(bench.order(ReheatOrder{400.0}).ok());
  ASSERT_TRUE(bench.order(ReheatOrder{200.0}).ok());
  bench.run_for(std::chrono::seconds(50));
  EXPECT_TRUE(bench.extruder.hot());
  bench.run_for(std::chrono::seconds(20));
  EXPECT_FALSE(bench.extruder.hot());
}

}  // namespace
}  // namespace reforge
