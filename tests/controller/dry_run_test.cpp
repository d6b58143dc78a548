#include "controller/dry_run.h"

#include <gtest/gtest.h>

#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

DryRun run_of(const std::vector<std::string>& body) {
  return dry_run(bench_rig(), {JobId{1}, "job", Mode::kStrict, bench_program(body)});
}

TEST(DryRun, MillingAndPrintingComeToTheirEnd) {
  std::vector<std::string> body = milling(60);
  const auto beads = printing();
  body.insert(body.end(), beads.begin(), beads.end());
  const DryRun run = run_of(body);
  EXPECT_EQ(run.state, JobState::kDone) << run.sentence;
  EXPECT_EQ(run.relayed, 10);
  EXPECT_LE(run.unacknowledged_peak, 128);
  EXPECT_GT(run.machine_s, 20);
  EXPECT_EQ(run.certainty.executed, run.certainty.horizon);
}

TEST(DryRun, SameProgramGivesTheSameDigest) {
  const DryRun once = run_of(printing());
  EXPECT_EQ(once.digest, run_of(printing()).digest);
  EXPECT_NE(once.digest, run_of(printing(21)).digest);
}

TEST(DryRun, ProgramTheStreamMayNotSendFails) {
  const DryRun run = run_of({"G0 X0 Y0 Z20", "M72 P0.3"});
  EXPECT_EQ(run.state, JobState::kFailed);
  EXPECT_NE(run.sentence.find("M72 before M70"), std::string::npos) << run.sentence;
}

}  // namespace
}  // namespace reforge
