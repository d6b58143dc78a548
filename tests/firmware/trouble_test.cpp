// A quick look at what tools/bench firmware measures at length.
#include <gtest/gtest.h>

#include "tests/firmware/fault_world.h"
#include "tests/firmware/frame_storm.h"
#include "tests/firmware/step_sequences.h"

namespace reforge {
namespace {

RigDescription shipped_rig() {
  auto rig = read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
  EXPECT_TRUE(rig) << (rig ? "" : rig.error().sentence);
  return *rig;
}

TEST(Trouble, AStormOfFramesLeavesOutputsSafe) {
  const FrameOutcome outcome = run_frame_storm(4000, 7);
  EXPECT_EQ(outcome.wrong, 0) << outcome.first;
  EXPECT_GT(outcome.taken, 300);
}

TEST(Trouble, FaultScriptsEndInAgreement) {
  const RigDescription rig = shipped_rig();
  int64_t steps = 0;
  for (uint64_t seed = 1; seed <= 60; ++seed) {
    const auto board = logic_board();
    const ScriptOutcome outcome = run_fault_script(*board, rig, seed);
    EXPECT_FALSE(outcome.wrong) << "seed " << seed << " " << *outcome.wrong;
    steps += outcome.steps;
  }
  EXPECT_GT(steps, 1000);
}

TEST(Trouble, FaultScriptsEndInAgreementOnTheRealFirmware) {
  const RigDescription rig = shipped_rig();
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    const auto board = avr_board(REFORGE_FIRMWARE_ELF);
    ASSERT_NE(board, nullptr);
    const ScriptOutcome outcome = run_fault_script(*board, rig, seed);
    EXPECT_FALSE(outcome.wrong) << "seed " << seed << " " << *outcome.wrong;
  }
}

TEST(Trouble, StepsCommandedAreStepsMade) {
  const auto logic = stepped_logic();
  const SequenceOutcome host = run_step_sequences(*logic, 500, 3);
  EXPECT_EQ(host.wrong, 0) << host.first;
  const auto avr = stepped_avr(REFORGE_FIRMWARE_ELF);
  ASSERT_NE(avr, nullptr);
  const SequenceOutcome real = run_step_sequences(*avr, 20, 3);
  EXPECT_EQ(real.wrong, 0) << real.first;
  EXPECT_GT(real.steps, 1000);
}

}  // namespace
}  // namespace reforge
