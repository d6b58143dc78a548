// Programs written for small toolpaths, read back by the project's own reader.
#include "planner/program/post.h"

#include <gtest/gtest.h>

#include <sstream>

#include "planner/geometry/shapes.h"
#include "planner/program/program_writer.h"
#include "planner/program/rotary_choice.h"
#include "protocols/gcode/modal.h"

namespace reforge {
namespace {

RigDescription shipped_rig() {
  const auto rig = read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
  EXPECT_TRUE(rig.ok());
  return *rig;
}

// One cut of 10 mm along u over a box of 20, from the direction.
BlockToolpath one_cut(const Vec3& direction) {
  BlockToolpath block;
  block.kind = BlockKind::kMill;
  block.frame = Frame::along(direction);
  block.paths.push_back({{{{-5, 0, 14}, Motion::kRapid},
                          {{-5, 0, 11}, Motion::kRapid},
                          {{-3, 0, 9.5}, Motion::kRamp},
                          {{5, 0, 9.5}, Motion::kCut}},
                         false});
  return block;
}

BlockToolpath one_bead(double gap_to_second) {
  BlockToolpath block;
  block.kind = BlockKind::kPrint;
  block.frame = Frame::along(Vec3::UnitZ());
  const auto bead = [&](double v) {
    block.paths.push_back({{{{-5, v, 14}, Motion::kRapid},
                            {{-5, v, 10.2}, Motion::kRapid},
                            {{4.8, v, 10.2}, Motion::kDeposit},
                            {{5, v, 10.2}, Motion::kCoast}},
                           false});
  };
  bead(0);
  block.paths.push_back({{{{5, 0, 14}, Motion::kRapid},
                          {{5, gap_to_second, 14}, Motion::kRapid},
                          {{5, gap_to_second, 10.2}, Motion::kRapid},
                          {{-4.8, gap_to_second, 10.2}, Motion::kDeposit},
                          {{-5, gap_to_second, 10.2}, Motion::kCoast}},
                         false});
  return block;
}

const TriangleMesh kPart = make_box({-10, -10, 0}, {10, 10, 10});

PostJob job() {
  return {"test", Mode::kStrict, std::string(64, 'a'), {&kPart}};
}

// The whole program through the reader every other part of the project uses.
std::vector<gcode::ModalState> read_back(const RigDescription& rig, const std::string& text) {
  std::istringstream in(text);
  gcode::LineReader reader(in, gcode::dialect_of(rig.cnc, rig.kinematics.table));
  gcode::Line line;
  gcode::ModalState state;
  std::vector<gcode::ModalState> states;
  for (;;) {
    const Result<bool> more = reader.next(line);
    EXPECT_TRUE(more.ok()) << (more.ok() ? "" : more.error().sentence);
    if (!more.ok() || !*more) return states;
    const auto action = gcode::apply(line, reader.dialect(), state);
    EXPECT_TRUE(action.ok()) << (action.ok() ? "" : action.error().sentence);
    if (!action.ok()) return states;
    states.push_back(state);
  }
}

TEST(ProgramWriter, NumbersAreShort) {
  EXPECT_EQ(number(1.5, 3), "1.5");
  EXPECT_EQ(number(-0.0001, 3), "0");
  EXPECT_EQ(number(100, 3), "100");
  EXPECT_EQ(number(0.34662, 4), "0.3466");
}

TEST(ProgramWriter, LongHeaderValuesGoOnInTheNextLine) {
  CncLink link{};
  link.line_length_max = 40;
  ProgramWriter out(link, RotaryTable::kBC);
  out.header("stock", std::string(64, 'b'));
  const std::string text = out.take();
  std::istringstream in(text);
  std::string line, joined;
  while (std::getline(in, line)) {
    EXPECT_LE(line.size(), 40u);
    joined += line[2] == '+' ? line.substr(3) : line.substr(2);
  }
  EXPECT_EQ(joined, "stock: " + std::string(64, 'b'));
}

TEST(Post, ProgramIsUnderstoodAndEndsSafe) {
  const RigDescription rig = shipped_rig();
  const auto program = post_program(rig, job(), {one_cut(Vec3::UnitZ()), one_bead(0.5)});
  ASSERT_TRUE(program.ok()) << program.error().sentence;
  const auto states = read_back(rig, program->text);
  ASSERT_FALSE(states.empty());
  EXPECT_TRUE(states.back().ended);
  EXPECT_EQ(states.back().spindle, gcode::Spindle::kOff);
  EXPECT_FALSE(states.back().module_open);
  EXPECT_FALSE(states.back().extruding);
}

TEST(Post, SideCutIsTurnedUnderTheSpindle) {
  const RigDescription rig = shipped_rig();
  const auto program = post_program(rig, job(), {one_cut(Vec3::UnitX())});
  ASSERT_TRUE(program.ok()) << program.error().sentence;
  // Direction +x: B 90 C 0 or B -90 C 180. The pivot lies at z = -10, the tip at x = 9.5 of the
  // part: its height is 9.5 - 10 under either.
  bool reached = false;
  for (const auto& state : read_back(rig, program->text)) {
    if (!state.at(gcode::Axis::kZ)) continue;
    EXPECT_GE(*state.at(gcode::Axis::kZ), -0.5 - 1e-9);
    reached |= std::abs(*state.at(gcode::Axis::kZ) + 0.5) < 1e-9;
    if (std::abs(*state.at(gcode::Axis::kZ) + 0.5) < 1e-9) {
      EXPECT_NEAR(std::abs(*state.at(gcode::Axis::kTilt)), 90, 1e-9);
    }
  }
  EXPECT_TRUE(reached);
}

TEST(Post, NozzleIsBroughtWhereTheCutterIsProgrammed) {
  const RigDescription rig = shipped_rig();
  const auto program = post_program(rig, job(), {one_bead(0.5)});
  ASSERT_TRUE(program.ok()) << program.error().sentence;
  for (const auto& state : read_back(rig, program->text)) {
    if (!state.extruding) continue;
    EXPECT_NEAR(*state.at(gcode::Axis::kZ) + rig.nozzle.deployed_offset_mm.z, 10.2, 1e-9);
    EXPECT_LE(std::abs(*state.at(gcode::Axis::kX) + rig.nozzle.deployed_offset_mm.x), 5 + 1e-9);
  }
}

TEST(Post, ShortTravelIsNotRetractedLongOneIs) {
  const RigDescription rig = shipped_rig();
  const auto near = post_program(rig, job(), {one_bead(0.5)});
  const auto far = post_program(rig, job(), {one_bead(6)});
  ASSERT_TRUE(near.ok() && far.ok());
  EXPECT_EQ(near->toggles, 2);
  EXPECT_EQ(near->retracts, 1);  // at the end of the block
  EXPECT_EQ(far->retracts, 2);
}

TEST(Post, FilamentIsFlowTimesTime) {
  const RigDescription rig = shipped_rig();
  const auto program = post_program(rig, job(), {one_bead(0.5)});
  ASSERT_TRUE(program.ok());
  // Two beads of 9.8 mm at F500: 0.0416 of their length (RIG.md), and two primes of 0.1 s.
  const double speed = 500.0 / 60 * 0.0416;
  EXPECT_NEAR(program->filament_mm, 2 * 9.8 * 0.0416 + 2 * 0.1 * speed, 0.005);
}

TEST(Post, TravelBeyondAnAxisIsRefusedByName) {
  BlockToolpath block = one_cut(Vec3::UnitZ());
  for (Move& move : block.paths[0].moves) move.to.y() += 70;
  const auto program = post_program(shipped_rig(), job(), {block});
  ASSERT_FALSE(program.ok());
  EXPECT_EQ(program.error().code, Code::kUnreachable);
  EXPECT_NE(program.error().sentence.find("block 01"), std::string::npos);
  EXPECT_NE(program.error().sentence.find("Y would go to"), std::string::npos);
}

TEST(Post, OtherSolutionIsTakenWhenTravelAsks) {
  // The tip 85 mm up the part, seen from the side: under B 90 it lies at x = -95, under B -90 at
  // +95, where the X axis ends at 90.
  const RigDescription rig = shipped_rig();
  BlockToolpath block = one_cut(Vec3::UnitX());
  for (Move& move : block.paths[0].moves) move.to.y() += 85;  // v runs up the part
  const auto choice = choose_angles(rig, Mode::kPaper, {&kPart}, block, 100,
                                    {Radians::degrees(-90), Radians::degrees(180)});
  ASSERT_TRUE(choice.has_value());
  EXPECT_TRUE(choice->objection.empty()) << choice->objection;
  EXPECT_NEAR(choice->angles.tilt.in_degrees(), 90, 1e-9);
}

TEST(Post, GoldenProgramOfOneCut) {
  const auto program = post_program(shipped_rig(), job(), {one_cut(Vec3::UnitZ())});
  ASSERT_TRUE(program.ok());
  const size_t body = program->text.find("G21\n");
  ASSERT_NE(body, std::string::npos);
  EXPECT_EQ(program->text.substr(body),
            "G21\nG90\nG94\nG17\nG54\n"
            "; block 01 mill direction 0.000000 0.000000 1.000000\n"
            "; work 10.500 about X-0.190476 Y0.000000 Z9.678571 beads 0.000\n"
            "G0 Z29.595\nG0 B0 C0\nM3 S12000\nG4 P2\n"
            "; path 1\n"
            "X-5 Y0\nZ14\nZ11\n"
            "G1 X-3 Z9.5 F300\nX5 F800\n"
            "G0 Z29.595\nM5\nM30\n");
}

TEST(Post, SameInputSameBytes) {
  const RigDescription rig = shipped_rig();
  const std::vector<BlockToolpath> blocks{one_cut(Vec3(0.6, 0, 0.8)), one_bead(3)};
  EXPECT_EQ(post_program(rig, job(), blocks)->text, post_program(rig, job(), blocks)->text);
}

}  // namespace
}  // namespace reforge
