// The kinds of findings that verify_program_test.cpp has no word of, each made to happen.
#include <gtest/gtest.h>

#include "tests/planner/verify_world.h"

namespace reforge::verify {
namespace {

bool has(const Verification& v, Fault fault) {
  return v.findings.of(fault).count > 0;
}

TEST(VerifyFindings, SpindleStartedWithTheExtruderOpenIsFound) {
  World world;
  world.insert_before("M72 P0.3465", "M3 S12000", 2);
  EXPECT_TRUE(has(world.verify(), Fault::kSpindleOn));
}

TEST(VerifyFindings, CuttingBeforeTheSpindleIsAtSpeedIsFound) {
  World world;
  world.drop("G4 P2");
  const Verification v = world.verify();
  // The way down and the first pass, in the air, take longer than that.
  EXPECT_FALSE(has(v, Fault::kSpindleOff)) << all_of(v);
  world.drop("M3 S12000");
  world.insert_before("G1 Y-11.250 F800", "M3 S12000");
  const Verification late = world.verify();
  EXPECT_TRUE(has(late, Fault::kSpindleOff)) << all_of(late);
}

TEST(VerifyFindings, CutterInThePedestalIsFound) {
  World world;
  world.replace("G0 Z-1", "G0 Z-6");
  world.replace("G1 X-9.000 F800", "G1 X-4.000 F800");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kCutterCollision)) << all_of(v);
}

TEST(VerifyFindings, NozzleBodyInThePartIsFound) {
  World world;
  world.replace("G0 Z11.200", "G0 Z9.200");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kNozzleCollision)) << all_of(v);
}

TEST(VerifyFindings, ParkedNozzleInThePartIsFound) {
  World world;
  world.inputs.rig.nozzle.parked_offset_mm = {12, 0, -5};
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kIdleCollision)) << all_of(v);
}

TEST(VerifyFindings, FeedMovesWithoutExtrusionAreFound) {
  World world;
  world.drop("M72 P0.3465", 1);
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kExtrusionMissing)) << all_of(v);
}

TEST(VerifyFindings, BeadFarFromThePartIsFound) {
  World world;
  world.replace("G1 X-86.25", "G1 X-70");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kDepositOutside)) << all_of(v);
}

TEST(VerifyFindings, SegmentsShorterThanTheLinkCanCarryAreFound) {
  World world;
  const std::size_t at = world.find("G1 X12");
  for (int k = 500; k > 0; --k) {
    char line[24];
    std::snprintf(line, sizeof line, "X%.3f", -12 + 0.004 * k);
    world.lines.insert(world.lines.begin() + static_cast<std::ptrdiff_t>(at), line);
  }
  const Verification v = world.verify();
  ASSERT_TRUE(has(v, Fault::kStarvation)) << all_of(v);
  EXPECT_GT(v.findings.of(Fault::kStarvation).worst.line, at);
  world.inputs.rig.cnc.baud = 1000000;
  const Verification fast = world.verify();
  EXPECT_TRUE(fast.pass) << all_of(fast);
}

TEST(VerifyFindings, AShortRunOfTinySegmentsIsCarriedByTheBuffers) {
  LinkModel link({CncDialect::kGrbl, 115200, 128, 80, MCodeRoute::kRelay});
  EXPECT_EQ(link.segment(12, 1.0), 0);
  for (int k = 0; k < 15; ++k) EXPECT_EQ(link.segment(12, 1e-4), 0) << k;
  double waited = 0;
  for (int k = 0; k < 40; ++k) waited += link.segment(12, 1e-4);
  // What goes on costs 12 bytes at 11,520 a second each, less its own 0.1 ms.
  EXPECT_GT(waited, 15 * (12 / 11520.0 - 1e-4));
  link.barrier();
  EXPECT_EQ(link.segment(12, 1e-4), 0);
}

TEST(VerifyFindings, ABlockThatDoesOtherWorkThanPlannedIsFound) {
  World world;
  const std::string block = "; block 03 print direction 0.000000 0.000000 1.000000";
  // Ten layers of 16 lines of 7.5 mm and 15 steps of 0.5 mm, of which 8 stand at x = 3.75 and 7 at
  // x = -3.75.
  const std::string right = "; work 1275.000 about X0.014706 Y0.000000 Z7.100000 beads 127.500";
  world.lines.insert(world.lines.begin() + static_cast<std::ptrdiff_t>(world.find(block)) + 1,
                     right);
  const Verification good = world.verify();
  EXPECT_TRUE(good.pass) << all_of(good);
  for (const char* wrong : {"; work 1275.200 about X0.014706 Y0.000000 Z7.100000 beads 127.500",
                            "; work 1275.000 about X0.024706 Y0.000000 Z7.100000 beads 127.500",
                            "; work 1275.000 about X0.014706 Y0.000000 Z7.100000 beads 128.200"}) {
    World other = world;
    other.replace(right, wrong);
    EXPECT_TRUE(has(other.verify(), Fault::kNotAsPlanned)) << wrong;
  }
}

// As a recovered job has it: what was done, a bridge and a preamble, and the rest.
TEST(VerifyFindings, ABlockInWhichTheSpindleStartsAnewIsNotComparedWithItsPlan) {
  World world;
  const std::string block = "; block 01 mill direction 0.000000 0.000000 1.000000";
  world.lines.insert(world.lines.begin() + static_cast<std::ptrdiff_t>(world.find(block)) + 1,
                     "; work 1.000 about X0.000000 Y0.000000 Z0.000000 beads 0.000");
  EXPECT_TRUE(has(world.verify(), Fault::kNotAsPlanned));
  for (const char* line : {"M5", "G0 Z80", "M3 S12000", "G4 P2", "G1 Z6 F300", "F800"}) {
    world.insert_before("G1 Y-1.250 F800", line);
  }
  const Verification v = world.verify();
  EXPECT_TRUE(v.pass) << all_of(v);
}

TEST(VerifyFindings, APlaceOnNoMachineIsRefusedInAnyMode) {
  World world;
  world.inputs.mode = Mode::kPaper;
  world.replace("G1 X-86.25", "G1 X-999999999");
  EXPECT_TRUE(has(world.verify(), Fault::kAxisLimit));
}

}  // namespace
}  // namespace reforge::verify
