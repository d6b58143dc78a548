#include "protocols/gcode/modal.h"

#include <gtest/gtest.h>

#include <sstream>

namespace reforge::gcode {
namespace {

const Dialect kGrbl = dialect_of(CncDialect::kGrbl, 80, RotaryTable::kBC);

// Applies a program; the error's sentence, or "".
std::string run(const std::string& program, ModalState& state, Action* last = nullptr,
                const Dialect& dialect = kGrbl) {
  std::istringstream in(program);
  LineReader reader(in, dialect);
  Line line;
  for (;;) {
    const Result<bool> read = reader.next(line);
    if (!read) return read.error().sentence;
    if (!*read) return "";
    const Result<Action> action = apply(line, dialect, state);
    if (!action) return action.error().sentence;
    if (last) *last = *action;
  }
}

std::string error_of(const std::string& program) {
  ModalState state;
  return run(program, state);
}

TEST(GcodeModal, CarriesMotionFeedAndPosition) {
  ModalState state;
  Action last;
  ASSERT_EQ(run("G21 G90\nG0 Z20\nG0 B-30 C45.5\nG1 X1 Y2 F300\nX3\n", state, &last), "");
  EXPECT_EQ(state.motion, Motion::kFeed);
  EXPECT_EQ(*state.feed_mm_per_min, 300);
  EXPECT_EQ(*state.at(Axis::kX), 3);
  EXPECT_EQ(*state.at(Axis::kTilt), -30);
  EXPECT_EQ(*state.at(Axis::kC), 45.5);
  EXPECT_EQ(last.kind, Action::Kind::kMove);
  EXPECT_TRUE(last.moved[0]);
  EXPECT_FALSE(last.moved[1]);
}

TEST(GcodeModal, PlacesNeverSaidStayUnknown) {
  ModalState state;
  ASSERT_EQ(run("G21 G90\nG0 Z20\n", state), "");
  EXPECT_FALSE(state.at(Axis::kX).has_value());
  EXPECT_TRUE(state.at(Axis::kZ).has_value());
}

TEST(GcodeModal, InchesAndRelativeMovesAreConverted) {
  ModalState state;
  ASSERT_EQ(run("G20 G90\nG0 X1 Z1\nG91\nG1 X0.5 F10\n", state), "");
  EXPECT_NEAR(*state.at(Axis::kX), 38.1, 1e-12);
  EXPECT_NEAR(*state.feed_mm_per_min, 254, 1e-12);
}

TEST(GcodeModal, DwellFollowsTheDialect) {
  ModalState state;
  Action last;
  ASSERT_EQ(run("G4 P0.1", state, &last), "");
  EXPECT_NEAR(last.dwell_s, 0.1, 1e-12);
  const Dialect fanuc = dialect_of(CncDialect::kFanuc, 80, RotaryTable::kBC);
  ASSERT_EQ(run("G4 P100", state, &last, fanuc), "");
  EXPECT_NEAR(last.dwell_s, 0.1, 1e-12);
}

TEST(GcodeModal, ModuleCodesKeepStateAndArgument) {
  ModalState state;
  Action last;
  ASSERT_EQ(run("M70 S205\nM72 P0.3466", state, &last), "");
  EXPECT_TRUE(state.module_open);
  EXPECT_TRUE(state.extruding);
  EXPECT_EQ(last.module_code, 72);
  EXPECT_EQ(*last.argument, 0.3466);
  ASSERT_EQ(run("M73\nM74 P1.0\nM75\nM71\n", state), "");
  EXPECT_FALSE(state.module_open);
  EXPECT_FALSE(state.extruding);
}

TEST(GcodeModal, RefusesWhatHasNoMeaning) {
  EXPECT_EQ(error_of("G21\nG2 X1"), "line 2, column 1: G2 is not a code this reader understands");
  EXPECT_EQ(error_of("G28.1"), "line 1, column 1: G28.1 is not a code this reader understands");
  EXPECT_EQ(error_of("M6"), "line 1, column 1: M6 is not a code this reader understands");
  EXPECT_NE(error_of("T1"), "");
  EXPECT_NE(error_of("G21 G90 G0 A5"), "");  // a BC table has no A
  EXPECT_NE(error_of("E1"), "");
}

TEST(GcodeModal, RefusesTwoOfOneKind) {
  EXPECT_EQ(error_of("G0 G1"), "line 1, column 4: G0 and G1 exclude each other on a line");
  EXPECT_EQ(error_of("G21 G90 G0 X1 X2"), "line 1, column 15: the word X stands twice");
}

TEST(GcodeModal, RefusesMotionThatDependsOnWhatTheControllerWasLeftIn) {
  EXPECT_NE(error_of("G90\nG0 X1"), "");
  EXPECT_NE(error_of("G21\nG0 X1"), "");
  EXPECT_NE(error_of("G21 G90\nX1"), "");
  EXPECT_NE(error_of("G21 G90\nG1 X1"), "");
  EXPECT_NE(error_of("G21 G91\nG0 X1"), "");
}

TEST(GcodeModal, ModuleCodesDwellAndEndStandAlone) {
  EXPECT_NE(error_of("M72 P1 M3 S100"), "");
  EXPECT_NE(error_of("M73 P1"), "");
  EXPECT_NE(error_of("M72 P0"), "");
  EXPECT_NE(error_of("G4"), "");
  EXPECT_NE(error_of("G21 G90 G0 X1 P2"), "");
  EXPECT_NE(error_of("M5 M30"), "");
  EXPECT_EQ(error_of("M30\nG21"), "line 2, column 1: the program goes on after its end");
  EXPECT_EQ(error_of("M30\n; done\n%\n"), "");
}

TEST(GcodeModal, SpindleNeedsASpeed) {
  EXPECT_NE(error_of("M3"), "");
  ModalState state;
  ASSERT_EQ(run("M3 S12000", state), "");
  EXPECT_EQ(state.spindle, Spindle::kClockwise);
  ASSERT_EQ(run("M5", state), "");
  EXPECT_EQ(state.spindle, Spindle::kOff);
}

TEST(GcodeModal, AnErrorLeavesTheStateAsItWas) {
  ModalState state;
  EXPECT_NE(run("G21 G90 G0 X1 Q2", state), "");
  EXPECT_EQ(state.unit, LengthUnit::kUnset);
}

}  // namespace
}  // namespace reforge::gcode
