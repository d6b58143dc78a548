// A clean program has no findings; each single fault is found.
#include <gtest/gtest.h>

#include "tests/planner/verify_world.h"

namespace reforge::verify {
namespace {

bool has(const Verification& v, Fault fault) {
  return v.findings.of(fault).count > 0;
}

TEST(VerifyProgram, ACleanProgramHasNoFindings) {
  const World world;
  const Verification v = world.verify(0.1);
  EXPECT_TRUE(v.pass) << all_of(v);
  EXPECT_EQ(v.program.blocks, 3);
  // V_R 19 x 20 x 6, less the scallops' inverse: what is left over.
  EXPECT_NEAR(v.part.reused, 2280, 2280 * 0.005);
  EXPECT_NEAR(v.part.removed, 4000 - 2280, 2280 * 0.005);
  EXPECT_LT(v.part.kept_cut, 0.5);
  EXPECT_NEAR(v.part.added, 128, 128 * 0.05);
  EXPECT_NEAR(v.program.flow_mm3, 128, 128 * 0.1);
  EXPECT_NEAR(v.part.plan_covered, 128, 1.0);
  ASSERT_TRUE(v.part.milled);
  EXPECT_GT(v.part.milled->least, -0.02);
  EXPECT_LT(v.part.milled->p99, 0.04);
  ASSERT_TRUE(v.part.kept);
  EXPECT_NEAR(v.part.kept->p50, 0, 1e-3);
}

TEST(VerifyProgram, SameInputsGiveTheSameBytes) {
  const World world;
  const auto bytes = [&] { return canonical_json(certificate_of(world.verify(), world.inputs)); };
  EXPECT_EQ(bytes(), bytes());
}

TEST(VerifyProgram, CutterLoweredIntoThePartIsAGouge) {
  World world;
  world.replace("G0 Z6", "G0 Z5.7");
  const Verification v = world.verify();
  ASSERT_TRUE(has(v, Fault::kGouge)) << all_of(v);
  EXPECT_NEAR(v.findings.of(Fault::kGouge).worst.depth_mm, 0.3, 0.02);
  EXPECT_TRUE(has(v, Fault::kDeviation)) << all_of(v);
}

TEST(VerifyProgram, DroppedRetractBeforeRotaryIsFound) {
  World world;
  world.drop("G0 Z80", 1);
  EXPECT_TRUE(has(world.verify(), Fault::kRotaryLow));
}

TEST(VerifyProgram, FlippedRotarySignIsFound) {
  World world;
  world.replace("G0 B90 C0", "G0 B-90 C0");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kHeader)) << all_of(v);
  world.drop("; block 02 mill direction 1.000000 0.000000 0.000000");
  EXPECT_GT(world.verify().part.left_over, 100);
}

TEST(VerifyProgram, ShiftedPivotIsFound) {
  World world;
  world.inputs.rig.kinematics.tilt_offset_mm.z += 1;
  EXPECT_TRUE(has(world.verify(), Fault::kGouge));
  world.inputs.rig.kinematics.tilt_offset_mm.z -= 2;
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kLeftOver)) << all_of(v);
  EXPECT_NEAR(v.findings.of(Fault::kLeftOver).worst.depth_mm, 6, 0.5);
}

TEST(VerifyProgram, RapidThroughMaterialIsFound) {
  World world;
  world.insert_before("G1 Y-11.750 F800", "G0 X5 Y5");
  EXPECT_TRUE(has(world.verify(), Fault::kRapidInMaterial));
}

TEST(VerifyProgram, StoppedSpindleIsFound) {
  World world;
  world.drop("M3 S12000");
  EXPECT_TRUE(has(world.verify(), Fault::kSpindleOff));
}

TEST(VerifyProgram, SpindleSpeedOutOfRangeIsFound) {
  World world;
  world.replace("M3 S12000", "M3 S120000");
  EXPECT_TRUE(has(world.verify(), Fault::kSpindleRange));
}

TEST(VerifyProgram, FeedTimesTenIsFound) {
  World world;
  world.replace("G1 Y-11.750 F800", "G1 Y-11.750 F8000");
  EXPECT_TRUE(has(world.verify(), Fault::kFeedRange));
  World printing;
  printing.replace("G1 Y-3.750 F500", "G1 Y-3.750 F5000");
  printing.replace("G1 Y-3.250 F500", "G1 Y-3.250");
  EXPECT_TRUE(has(printing.verify(), Fault::kExtrusionRate));
}

TEST(VerifyProgram, LongerCarriageIsFound) {
  World world;
  world.inputs.rig.cutter.flute_length_mm = 3;
  world.inputs.rig.cutter.holder = {{1.5, 3, 1.5, 1.5}, {3, 60, 25, 25}};
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kHolderCollision)) << all_of(v);
}

TEST(VerifyProgram, ShiftedStockIsFoundByItsHash) {
  World world;
  world.inputs.initial = translated(world.inputs.initial, {2, 0, 0});
  world.inputs.initial_sha256 = std::string(64, 'b');
  world.lines.insert(world.lines.begin(),
                     {"; reforge-program: 1", "; stock: " + std::string(64, 'a')});
  EXPECT_TRUE(has(world.verify(), Fault::kHeader));
}

TEST(VerifyProgram, AxisBeyondItsTravelIsFound) {
  World world;
  world.replace("G0 X-13 Y-13", "G0 X-13 Y-63");
  EXPECT_TRUE(has(world.verify(), Fault::kAxisLimit));
}

TEST(VerifyProgram, RotaryBesideOtherWordsIsFound) {
  World world;
  world.replace("G0 B90 C0", "G0 B90 C0 Z80");
  EXPECT_TRUE(has(world.verify(), Fault::kRotaryNotAlone));
}

TEST(VerifyProgram, MotionBeforeTheStartIsKnownIsFound) {
  World world;
  world.replace("G0 Z80", "G0 X0 Z3");
  EXPECT_TRUE(has(world.verify(), Fault::kStart));
}

TEST(VerifyProgram, MissingM70IsFound) {
  World world;
  world.drop("M70 S205");
  EXPECT_TRUE(has(world.verify(), Fault::kModuleState));
}

TEST(VerifyProgram, MissingM72IsFound) {
  World world;
  world.drop("M72 P0.3465", 3);
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kModuleState)) << all_of(v);
}

TEST(VerifyProgram, DroppedM73IsFound) {
  World world;
  world.drop("M73", 4);
  EXPECT_TRUE(has(world.verify(), Fault::kModuleState));
}

TEST(VerifyProgram, ExtrusionLeftOnOverATravelIsFound) {
  World world;
  world.drop("M73");
  world.drop("M74 P1.0");
  world.drop("M75");
  EXPECT_TRUE(has(world.verify(), Fault::kExtrusionOnTravel));
}

TEST(VerifyProgram, MissingRetractionIsFound) {
  World world;
  world.drop("M74 P1.0");
  world.drop("M75");
  EXPECT_TRUE(has(world.verify(), Fault::kNotRetracted));
}

TEST(VerifyProgram, BeadInTheAirIsFound) {
  World world;
  world.replace("G0 Z11.200", "G0 Z11.700");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kUnsupported)) << all_of(v);
}

TEST(VerifyProgram, NozzleThroughPrintedMaterialIsFound) {
  World world;
  world.replace("G0 Z12.000", "G0 Z11.400");
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kNozzleDrag)) << all_of(v);
}

TEST(VerifyProgram, ModuleOpenedLowIsFound) {
  World world;
  world.insert_before("M70 S205", "G0 Z12");
  EXPECT_TRUE(has(world.verify(), Fault::kModuleLow));
}

TEST(VerifyProgram, EndWithHeaterOrSpindleOnIsFound) {
  World hot;
  hot.drop("M71");
  EXPECT_TRUE(has(hot.verify(), Fault::kEndState));
  World cut;
  cut.drop("M30");
  EXPECT_TRUE(has(cut.verify(), Fault::kEndState));
}

TEST(VerifyProgram, RelativeInsteadOfAbsoluteIsFound) {
  World world;
  world.insert_before("; path 1", "G91");
  EXPECT_FALSE(world.verify().pass);
}

TEST(VerifyProgram, InchesInsteadOfMillimetresAreFound) {
  World world;
  world.replace("G21 G90 G94 G17 G54", "G20 G90 G94 G17 G54");
  EXPECT_FALSE(world.verify().pass);
}

TEST(VerifyProgram, WhatIsNotUnderstoodIsAFindingWithItsLine) {
  World world;
  const std::size_t at = world.find("M5");
  world.lines[at] = "M6 T2";
  const Verification v = world.verify();
  ASSERT_TRUE(has(v, Fault::kNotUnderstood));
  EXPECT_EQ(v.findings.of(Fault::kNotUnderstood).worst.line, at + 1);
}

TEST(VerifyProgram, ALineTooLongForTheControllerIsFound) {
  World world;
  world.insert_before("M5", "; " + std::string(100, '-'));
  EXPECT_TRUE(has(world.verify(), Fault::kLineTooLong));
}

TEST(VerifyProgram, LostPassesLeaveMaterialThatIsMeasured) {
  World world;
  world.drop("G1 X12", 10);
  world.drop("G1 X-12", 10);
  const Verification clean = World().verify();
  const Verification v = world.verify();
  EXPECT_GT(v.part.left_over, clean.part.left_over + 0.5);
  EXPECT_GT(v.part.milled->most, 0.1);
}

TEST(VerifyProgram, ALostBlockLeavesALump) {
  World world;
  const std::size_t first = world.find("G1 X-12", 8);
  world.lines.erase(world.lines.begin() + static_cast<std::ptrdiff_t>(first),
                    world.lines.begin() + static_cast<std::ptrdiff_t>(first + 24));
  const Verification v = world.verify();
  EXPECT_TRUE(has(v, Fault::kLeftOver)) << all_of(v);
}

TEST(VerifyProgram, LayersNeverPrintedAreFound) {
  World world;
  const std::size_t first = world.find("; path 10");
  const std::size_t end = world.find("G0 Z80", 3);
  world.lines.erase(world.lines.begin() + static_cast<std::ptrdiff_t>(first),
                    world.lines.begin() + static_cast<std::ptrdiff_t>(end));
  EXPECT_TRUE(has(world.verify(), Fault::kNotPrinted));
}

TEST(VerifyProgram, PaperModeKnowsNeitherTravelNorFixture) {
  World world;
  world.inputs.mode = Mode::kPaper;
  world.inputs.rig.x.max_mm = 0;
  const Verification v = world.verify();
  EXPECT_FALSE(has(v, Fault::kAxisLimit));
  EXPECT_FALSE(has(v, Fault::kCutterCollision));
  World low;
  low.inputs.mode = Mode::kPaper;
  low.replace("G1 X-9.000 F800", "G1 X-5.000 F800");
  EXPECT_TRUE(has(low.verify(), Fault::kBelowBase));
}

TEST(VerifyProgram, StopsWhenAsked) {
  World world;
  for (int k = 0; k < 3000; ++k) world.lines.insert(world.lines.begin(), "; nothing");
  std::istringstream in(world.text());
  VerifyOptions options;
  options.should_stop = [] { return true; };
  const Result<Verification> v = verify_program(in, world.inputs, options);
  ASSERT_FALSE(v);
  EXPECT_EQ(v.error().code, Code::kInterrupted);
}

}  // namespace
}  // namespace reforge::verify
