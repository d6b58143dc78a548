#include "tools/rig/marlin_controller.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "tests/rig/shipped_rig.h"

namespace reforge {
namespace {

RigDescription marlin_rig() {
  RigDescription rig = shipped_rig();
  rig.cnc.dialect = CncDialect::kMarlin;
  rig.cnc.line_length_max = 95;
  return rig;
}

std::string numbered(int n, const std::string& words) {
  std::string line = "N" + std::to_string(n) + " " + words;
  unsigned sum = 0;
  for (const char c : line) sum ^= static_cast<unsigned char>(c);
  return line + "*" + std::to_string(sum) + "\n";
}

struct Marlin {
  Marlin() { marlin.take_transmitted(); }
  std::string say(const std::string& bytes, double seconds = 0.05) {
    marlin.receive(bytes);
    now += static_cast<int64_t>(seconds * 1e9);
    marlin.advance_to(now);
    return marlin.take_transmitted();
  }
  MarlinController marlin{marlin_rig()};
  int64_t now = 0;
};

TEST(Marlin, TakesNumberedLinesInOrder) {
  Marlin m;
  EXPECT_EQ(m.say(numbered(1, "G90") + numbered(2, "G1 X80 F1200")), "ok\nok\n");
  EXPECT_EQ(m.say("", 2), "");
  EXPECT_EQ(m.marlin.g54_position()[0], 80);
  EXPECT_EQ(m.say(numbered(0, "M110") + numbered(1, "G1 X81")), "ok\nok\n");
}

TEST(Marlin, AsksAgainForWhatIsSpoiledMissingOrBare) {
  const std::string resend = "Resend: 2\nok\n";
  for (const std::string& bad : {std::string("N2 G1 X80 F1200*1\n"), numbered(3, "G1 X80"),
                                 std::string("N2 G1 X80\n"), std::string("G1 X80*12\n")}) {
    Marlin m;
    m.say(numbered(1, "G90"));
    const std::string answer = m.say(bad);
    EXPECT_TRUE(answer.starts_with("Error:")) << answer;
    EXPECT_TRUE(answer.ends_with(resend)) << answer;
    EXPECT_EQ(m.say(numbered(2, "G1 X80 F1200")), "ok\n");
  }
}

TEST(Marlin, M400IsAnsweredWhenMotionIsOver) {
  Marlin m;
  EXPECT_EQ(m.say("G1 X59 F1200\nM400\n", 1), "ok\n");
  EXPECT_EQ(m.say("", 0.5), "");
  EXPECT_EQ(m.say("", 1), "ok\n");
  EXPECT_EQ(m.marlin.state_name(), "Idle");
}

TEST(Marlin, SaysItIsBusyWhileAnOkIsOwed) {
  Marlin m;
  EXPECT_EQ(m.say("G4 P3000\n", 2.5), "echo:busy: processing\n");
  EXPECT_EQ(m.say("", 1), "ok\n");
}

TEST(Marlin, OurCodesAreUnknownOrMeanSomethingElse) {
  Marlin m;
  EXPECT_EQ(m.say("M72\n"), "echo:Unknown command: \"M72\"\nok\n");
  EXPECT_EQ(m.say("M73 P50\n"), "ok\n");
  EXPECT_FALSE(m.marlin.outputs().extrude);
}

TEST(Marlin, TargetsBeyondTheTravelAreClamped) {
  Marlin m;
  EXPECT_EQ(m.say("G1 X500 F3000\n", 5), "ok\n");
  EXPECT_EQ(m.marlin.g54_position()[0], 90);
}

TEST(Marlin, ALineTooLongIsCutSilently) {
  Marlin m;
  const std::string answer = m.say(numbered(1, "G1 X80 F1200 ;" + std::string(90, 'x')));
  EXPECT_TRUE(answer.starts_with("Error:No Checksum")) << answer;
}

TEST(Marlin, KilledIsSilentUntilReset) {
  Marlin m;
  m.say("G1 X0 F1200\n", 1);
  EXPECT_EQ(m.say("M112\n"), "Error:Printer halted. kill() called!\n");
  const double x = m.marlin.g54_position()[0];
  EXPECT_EQ(m.say("G1 X80\n", 1), "");
  EXPECT_EQ(m.marlin.g54_position()[0], x);
  m.marlin.press(CncButton::kReset);
  EXPECT_TRUE(m.say("").starts_with("start\n"));
}

}  // namespace
}  // namespace reforge
